"""The figures drawn by `plot()` of a path, a table or a tuned path."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from qtraj.batch.table import Table
from qtraj.design.tuning.outcome import Tuned
from qtraj.motion.programs.rotation_minimizing import Frame
from qtraj.path.hodograph import AbstractHodograph
from qtraj.viz.drawable import drawable
from qtraj.viz.history import tuning_figure
from qtraj.viz.space import path_figure
from qtraj.viz.table_figure import table_figure


def path_plot(path: AbstractHodograph, frame: Frame | None = None, trihedra: int = 6) -> Figure:
    """One path in space.

    **Raises:** ValueError for a batch of paths.
    """
    return path_figure(drawable(path, frame), trihedra)


def tuned_plot(tuned: Tuned, frame: Frame | None = None) -> Figure:
    """The tuned path, with its limits.

    **Raises:** ValueError for a batch of results.
    """
    return tuning_figure(drawable(tuned, frame))


def table_plot(table: Table, names: Sequence[str] = ()) -> Figure:
    """The outputs of a table over time."""
    return table_figure(table.to_xarray(), names)
