"""What a batched evaluation returns: labelled arrays."""

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float

from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, in_lanes, over
from qtraj.path.quantities import AXES, DESCRIPTIONS, LABELS, framed


class Table(AbstractResult):
    """Arrays over instants (n,) or over paths and instants (b, n), components on the last axis (or the first).

    Fields that were not asked for are None. `time` [s], (n,) or (b, n), is measured from each path's own start.
    """

    time: Float[Array, "*rows n"]
    position: Float[Array, "..."] | None = None
    velocity: Float[Array, "..."] | None = None
    acceleration: Float[Array, "..."] | None = None
    jerk: Float[Array, "..."] | None = None
    dcm: Float[Array, "..."] | None = None
    quaternion: Float[Array, "..."] | None = None
    gibbs: Float[Array, "..."] | None = None
    speed: Float[Array, "..."] | None = None
    curvature: Float[Array, "..."] | None = None
    torsion: Float[Array, "..."] | None = None
    rate: Float[Array, "..."] | None = None
    angular_acceleration: Float[Array, "..."] | None = None
    defined: Bool[Array, "..."] | None = None
    batched: bool = eqx.field(static=True, default=False)
    components: str = eqx.field(static=True, default="last")
    frame: str = eqx.field(static=True, default="natural")

    def record(self) -> Record:
        """The arrays over `time`, or over `sample` where each path has instants of its own, and over `path`."""
        along = "time" if self.time.ndim == 1 else "sample"  # times of each path's own are no axis
        instants = ("path", along) if self.batched else (along,)
        variables = {}
        for name, axes in AXES.items():
            values = getattr(self, name)
            if values is not None:
                dims = (*instants, *axes) if self.components == "last" else (*axes, *instants)
                variables[name] = Quantity(values, *DESCRIPTIONS[name], dims)
        time = Quantity(self.time, "s", "time from the start of the path", instants[-self.time.ndim :])
        paths = [np.shape(q.values)[q.axes.index("path")] for q in variables.values() if "path" in q.axes][:1]
        return Record(
            f"{in_lanes(tuple(paths), 'paths')}{over(self.time)}, {self.frame} frame: {', '.join(variables)}",
            variables,
            {"time": time},
            framed(self.frame),
            LABELS,
        )
