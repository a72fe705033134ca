"""What a batched evaluation returns: labelled arrays."""

from typing import TYPE_CHECKING, Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float

from qtraj._version import __version__

if TYPE_CHECKING:
    import xarray

AXES: dict[str, tuple[str, ...]] = {
    "position": ("world",),
    "velocity": ("world",),
    "acceleration": ("world",),
    "jerk": ("world",),
    "dcm": ("body", "world"),
    "quaternion": ("quaternion_component",),
    "gibbs": ("body",),
    "speed": (),
    "curvature": (),
    "torsion": (),
    "rate": ("body",),
    "angular_acceleration": ("body",),
    "defined": (),
}
"""The component axes of every output, by the labels of their coordinates."""

LABELS = {
    "world": ["x", "y", "z"],
    "body": ["tangent", "normal", "binormal"],
    "quaternion_component": ["w", "x", "y", "z"],
}

DESCRIPTIONS: dict[str, tuple[str, str]] = {
    "position": ("m", "position, world axes"),
    "velocity": ("m s-1", "velocity, world axes"),
    "acceleration": ("m s-2", "acceleration, world axes"),
    "jerk": ("m s-3", "jerk, world axes"),
    "dcm": ("1", "direction cosines: rows are the body axes in world components; maps world to body"),
    "quaternion": ("1", "unit quaternion, scalar first, Hamilton, body to world"),
    "gibbs": ("1", "Gibbs vector e tan(angle/2)"),
    "speed": ("m s-1", "speed"),
    "curvature": ("m-1", "curvature of the path"),
    "torsion": ("m-1", "torsion of the path"),
    "rate": ("rad s-1", "angular rate of the frame, body axes"),
    "angular_acceleration": ("rad s-2", "angular acceleration of the frame, body axes"),
    "defined": ("1", "whether the frame exists; where it does not, its numbers are finite fillers"),
}
"""Unit and meaning of every output."""


class Table(eqx.Module):
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

    def to_xarray(self) -> "xarray.Dataset":
        """The table as an `xarray.Dataset` with units, axes and conventions in its attributes (extra `io`)."""
        import xarray

        along = "time" if self.time.ndim == 1 else "sample"  # times of each path's own are no axis
        instants = ("path", along) if self.batched else (along,)
        variables: dict[str, Any] = {}
        for name, axes in AXES.items():
            values = getattr(self, name)
            if values is not None:
                unit, meaning = DESCRIPTIONS[name]
                dims = (*instants, *axes) if self.components == "last" else (*axes, *instants)
                variables[name] = (dims, np.asarray(values), {"units": unit, "long_name": meaning})
        used = {axis for name in variables for axis in AXES[name]}
        coordinates = {axis: labels for axis, labels in LABELS.items() if axis in used}
        time = (
            instants[-self.time.ndim :],
            np.asarray(self.time),
            {"units": "s", "long_name": "time from the start of the path"},
        )
        attributes = {
            "source": f"qtraj {__version__}",
            "quaternion_convention": "scalar first, Hamilton product, body to world, unit norm",
            "frame": self.frame,
            "frame_convention": "right-handed; body axes x = tangent (forward), y = normal, z = binormal",
        }
        return xarray.Dataset(variables, {"time": time, **coordinates}, attributes)
