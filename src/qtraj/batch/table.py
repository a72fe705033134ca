"""Define the result of a batched evaluation: labelled arrays over instants."""

from typing import TYPE_CHECKING, Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation.drawing import draw
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, batch_prefix, times_text
from qtraj.path.channel import CHANNELS
from qtraj.path.frame_axes import framed, labels_of
from qtraj.path.rate_axes import BODY, in_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Table(AbstractResult):
    """Arrays (n, …) over n instants, or (b, n, …) over b paths and n instants.

    The last axes are component axes; with `components="first"`, they are the first axes instead.

    Each output of `evaluate` is an attribute, such as `table.position`, `table.curvature` or `table.yaw_rate`; outputs
    that were not requested are None. `time` [s], (n,) or (b, n), is measured from the start of each path. `axes`,
    "body" or "inertial", are the axes of `rate`, `angular_acceleration`, `force` and `moment`.

    **Raises:** TypeError for an unknown name of an array.
    """

    time: Float[Array, "*rows n"]
    values: dict[str, Array]
    batched: bool = eqx.field(static=True)
    components: str = eqx.field(static=True)
    frame: str = eqx.field(static=True)
    axes: str = eqx.field(static=True)

    def __init__(
        self,
        time: "Array",
        *,
        batched: bool = False,
        components: str = "last",
        frame: str = "natural",
        axes: str = BODY,
        **values: "Array | None",
    ):
        if unknown := values.keys() - CHANNELS.keys():
            raise TypeError(f"unknown output {min(unknown)!r}; the known outputs are {', '.join(CHANNELS)}")
        self.time = time
        self.values = {name: x for name, x in values.items() if x is not None}
        self.batched, self.components, self.frame, self.axes = batched, components, frame, axes

    def __getattr__(self, name: str) -> Any:
        if name in CHANNELS:
            return self.values.get(name)
        raise AttributeError(f"a table has no attribute {name!r}")

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *CHANNELS]

    def plot(self, *names: str) -> "Figure":
        """Plot outputs over time, one panel each, as a matplotlib figure (extra `viz`).

        By default all outputs except `dcm` and `defined` are plotted. Components have the labels of the frame's axes.
        If there are many paths, only the first eight are plotted.

        **Raises:** ModuleNotFoundError with the extra to install, if matplotlib is missing; ValueError for an output
        that the table does not contain.
        """
        return draw("table_plot", self, names)

    def record(self) -> Record:
        """Return the arrays over `path` (for a batch) and `time`, or `sample` if each path has its own instants."""
        along = "time" if self.time.ndim == 1 else "sample"  # times that differ between paths cannot be an axis
        instants = ("path", along) if self.batched else (along,)
        variables = {}
        for name, entry in CHANNELS.items():
            if name in self.values:
                entry = in_axes(entry, self.axes)
                dims = (*instants, *entry.axes) if self.components == "last" else (*entry.axes, *instants)
                variables[name] = Quantity(self.values[name], entry.unit, entry.meaning, dims)
        time = Quantity(self.time, "s", "time from the start of the path", instants[-self.time.ndim :])
        paths = [np.shape(q.values)[q.axes.index("path")] for q in variables.values() if "path" in q.axes][:1]
        return Record(
            f"{batch_prefix(tuple(paths), 'paths')}{times_text(self.time)}, {self.frame} frame: {', '.join(variables)}",
            variables,
            {"time": time},
            framed(self.frame),
            labels_of(self.frame),
        )
