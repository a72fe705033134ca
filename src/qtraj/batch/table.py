"""Define the result of a batched evaluation: labelled arrays over instants."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation.data_frame import data_frame
from qtraj.foundation.drawing import draw
from qtraj.foundation.extras import require_package
from qtraj.foundation.record import Quantity, Record, require_concrete
from qtraj.foundation.result import AbstractResult, batch_prefix, times_text
from qtraj.path.channel import CHANNELS
from qtraj.path.frame_axes import framed, labels_of
from qtraj.path.own_name import OwnName, name_of
from qtraj.path.own_quantity import Quantity as OwnQuantity
from qtraj.path.rate_axes import BODY, in_axes

if TYPE_CHECKING:
    import pandas
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
        if unknown := [name for name in values if name not in CHANNELS]:
            raise TypeError(f"unknown output {min(unknown)!r}; the known outputs are {', '.join(CHANNELS)}")
        self.time = time
        self.values = {name: x for name, x in values.items() if x is not None}
        self.batched, self.components, self.frame, self.axes = batched, components, frame, axes

    def __getattr__(self, name: str) -> Any:
        if name in CHANNELS or name in self.__dict__.get("values", ()):
            return self.values.get(name)
        raise AttributeError(f"a table has no attribute {name!r}")

    def __getitem__(self, name: str | OwnQuantity) -> Array:
        """Return an output by its name, such as `table["curvature"]`, or the times: `table["time"]`.

        A `Quantity` stands for its name.

        **Raises:** KeyError with the names of the outputs, for another name.
        """
        key: str = name_of(name)
        if key == "time":
            return self.time
        if key not in self.values:
            raise KeyError(f"the table has no output {key!r}; its outputs are {', '.join(self.values)}")
        return self.values[key]

    def __contains__(self, name: object) -> bool:
        return name == "time" or name in self.values

    def __iter__(self) -> Iterator[str]:
        return iter(self.values)

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

    def to_dataframe(self) -> "pandas.DataFrame":
        """Convert the table to a pandas DataFrame, with one row for each instant.

        The columns are `time` [s] and the outputs; vectors and attitudes have one column for each component, such as
        `position_x` [m], `quaternion_w` or `dcm_tangent_x`. For a batch, the column `path` has the number of the path,
        from 0, and the rows of one path follow those of another.

        **Raises:** ModuleNotFoundError if pandas is missing; ValueError inside a trace.

        Example:
            >>> import qtraj as qt
            >>> path = qt.SpiralHelix([20.0], [0.0, 0.3], [0.0, 0.5], 10.0)
            >>> list(qt.evaluate(path, [0.0, 5.0], ("position", "curvature")).to_dataframe().columns)
            ['time', 'position_x', 'position_y', 'position_z', 'curvature']
        """
        require_concrete(self)
        require_package("pandas", "a data frame", extra=None)
        return data_frame(self.record(), "path" if self.batched else None)

    def record(self) -> Record:
        """Return the arrays over `path` (for a batch) and `time`, or `sample` if each path has its own instants."""
        along = "time" if self.time.ndim == 1 else "sample"  # times that differ between paths cannot be an axis
        instants = ("path", along) if self.batched else (along,)
        variables = {}
        own = [name for name in self.values if isinstance(name, OwnName)]
        for name in (*CHANNELS, *own):
            if name in self.values:
                entry = in_axes(CHANNELS[name], self.axes)
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
