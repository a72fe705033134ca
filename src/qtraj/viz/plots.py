"""Draw the figures for the method `plot()` of paths, tables, tuned paths and speed profiles."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from qtraj.batch.table import Table
from qtraj.design.speed_profile import SpeedProfile, speed_profile
from qtraj.design.timing.outcome import Retimed
from qtraj.design.tuning.outcome import Tuned
from qtraj.motion.programs.rotation_minimizing import Frame
from qtraj.path.hodograph import AbstractHodograph
from qtraj.viz.drawable import drawable
from qtraj.viz.history import tuning_figure
from qtraj.viz.space import path_figure
from qtraj.viz.speed_profile_figure import speed_profile_figure
from qtraj.viz.table_figure import table_figure


def path_plot(path: AbstractHodograph, frame: Frame | None = None, trihedra: int = 6) -> Figure:
    """Plot one path in space.

    **Raises:** ValueError for a batch of paths.
    """
    return path_figure(drawable(path, frame), trihedra)


def tuned_plot(tuned: Tuned, frame: Frame | None = None) -> Figure:
    """Plot a tuned path with its limits.

    **Raises:** ValueError for a batch of results.
    """
    return tuning_figure(drawable(tuned, frame))


def table_plot(table: Table, names: Sequence[str] = ()) -> Figure:
    """Plot the outputs of a table over time."""
    return table_figure(table.to_xarray(), names)


def retimed_plot(timed: Retimed, title: str = "") -> Figure:
    """Plot the speed along a retimed path, and the limits that bound the speed.

    **Raises:** ValueError for a batch of results.
    """
    return speed_profile_plot(speed_profile(timed), title)


def speed_profile_plot(profile: SpeedProfile, title: str = "") -> Figure:
    """Plot a speed profile, and the limits that bound the speed."""
    return speed_profile_figure(profile.to_xarray({"title": title}))
