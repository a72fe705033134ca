"""What `plot()` of a path, a table or a tuned path draws."""

from collections.abc import Sequence

import jax.numpy as jnp
from matplotlib.figure import Figure

from qtraj.batch.table import Table
from qtraj.design.limits import Limits
from qtraj.design.tuning.outcome import Tuned
from qtraj.io.dataset import path_dataset
from qtraj.motion.programs.rotation_minimizing import Frame
from qtraj.path.hodograph import AbstractHodograph
from qtraj.viz.history import tuning_figure
from qtraj.viz.space import path_figure
from qtraj.viz.table_figure import table_figure


def path_plot(path: AbstractHodograph, frame: Frame | None = None, trihedra: int = 6) -> Figure:
    """One path in space.

    **Raises:** ValueError for many paths.
    """
    if jnp.ndim(path.duration):
        raise ValueError(
            f"a plot shows one path, but {path.duration.shape[0]} stacked ones were given: plot one of them, "
            "jax.tree.map(lambda x: x[k], paths), or the table of qtraj.evaluate"
        )
    return path_figure(path_dataset({"path": path}, frame=frame), trihedra)


def tuned_plot(tuned: Tuned, frame: Frame | None = None) -> Figure:
    """The path of one tuning, with its limits.

    **Raises:** ValueError for the outcome of many problems.
    """
    if tuned.code.ndim:
        raise ValueError(f"a plot shows one outcome, but there are {len(tuned)}: plot one of them, outcome[k].plot()")
    return tuning_figure(path_dataset({"after": tuned.path}, limits_of(tuned), frame=frame))


def table_plot(table: Table, names: Sequence[str] = ()) -> Figure:
    """The outputs of a table over time."""
    return table_figure(table.to_xarray(), names)


def limits_of(tuned: Tuned) -> Limits:
    """The limits that a tuning was given, as its certificate knows them."""
    return Limits(**{name: limit for name, (_, _, limit) in tuned.certificate.worst.items()})
