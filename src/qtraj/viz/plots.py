"""Draw the figures for the method `plot()` of paths, tables, results, speed profiles and atlases."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from qtraj.batch.table import Table
from qtraj.design.speed_profile import SpeedProfile, speed_profile
from qtraj.design.timing.outcome import Retimed
from qtraj.design.tuning.outcome import Tuned
from qtraj.design.uncertainty.margin_uncertainty import MarginUncertainty
from qtraj.design.uncertainty.quantity_expansion import HEADING
from qtraj.design.uncertainty.uncertainty import Uncertainty
from qtraj.motion.programs.rotation_minimizing import Frame
from qtraj.path.hodograph import AbstractHodograph
from qtraj.sweeps.atlas.outcome import Atlas
from qtraj.viz.atlas_figure import atlas_figure
from qtraj.viz.drawable import drawable
from qtraj.viz.history import tuning_figure
from qtraj.viz.space import path_figure
from qtraj.viz.speed_profile_figure import speed_profile_figure
from qtraj.viz.table_figure import table_figure
from qtraj.viz.uncertainty_figure import uncertainty_figure, without_turns


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


def uncertainty_plot(found: Uncertainty, names: Sequence[str] = ()) -> Figure:
    """Plot quantities over time with their standard deviations; the heading without jumps by a whole turn."""
    dataset = found.to_xarray()
    if HEADING.name in dataset:
        dataset[HEADING.name] = dataset[HEADING.name].copy(data=without_turns(dataset[HEADING.name].values))
    return uncertainty_figure(dataset, {name: f"{name}_sigma" for name in names or found.values})


def margin_plot(found: MarginUncertainty, names: Sequence[str] = ()) -> Figure:
    """Plot margins over time with their standard deviations; they are zero at the limits."""
    bands = {f"{name}_margin": f"{name}_sigma" for name in names or found.margin}
    return uncertainty_figure(found.to_xarray(), bands, 0.0)


def retimed_plot(timed: Retimed, title: str = "") -> Figure:
    """Plot the speed along a retimed path, and the limits that bound the speed.

    **Raises:** ValueError for a batch of results.
    """
    return speed_profile_plot(speed_profile(timed), title)


def speed_profile_plot(profile: SpeedProfile, title: str = "") -> Figure:
    """Plot a speed profile, and the limits that bound the speed."""
    return speed_profile_figure(profile.to_xarray({"title": title}))


def atlas_plot(atlas: Atlas, value: str | None = None) -> Figure:
    """Plot an atlas, with a value as colour in the feasible region."""
    return atlas_figure(atlas, value)
