"""The outputs of one block of paths and instants, each component an array of its own."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.foundation.arrays import as_float
from qtraj.foundation.types import Scalar
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.natural_components import natural_components
from qtraj.path.quantities import AXES
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.trihedral import AbstractFrame, Natural

Channels = dict[str, tuple[Array, ...]]
"""By the name of an output its components, each (paths, instants)."""


def channels(
    paths: AbstractHodograph, t: Float[Array, "rows instants"], frame: AbstractFrame, names: tuple[str, ...]
) -> Channels:
    """The named outputs of a stack of paths (every array with a leading axis) at `t` [s], one row or one for each path.

    Spiral-helices with the natural trihedral are worked out in components; any other path or frame instant by instant.
    """
    shape = (paths.duration.shape[0], t.shape[1])
    if isinstance(paths, SpiralHelix) and isinstance(frame, Natural):
        known = natural_components(paths, t.astype(paths.radius.dtype))
        return {name: tuple(jnp.broadcast_to(x, shape) for x in known[name]) for name in names}
    along = lambda path, t: jax.vmap(lambda t: _instant(path, t, frame, names))(t)  # noqa: E731
    values = eqx.filter_vmap(along, in_axes=(eqx.if_array(0), 0))(paths, jnp.broadcast_to(t, shape))
    return {name: tuple(v.reshape(*shape, -1)[..., k] for k in range(width(name))) for name, v in values.items()}


def width(name: str) -> int:
    """How many components an output has."""
    sizes = {"world": 3, "body": 3, "quaternion_component": 4}
    result = 1
    for axis in AXES[name]:
        result *= sizes[axis]
    return result


def _instant(path: AbstractHodograph, t: Scalar, frame: AbstractFrame, names: tuple[str, ...]) -> dict[str, Array]:
    r = path.derivatives(t, 4)
    trihedral = frame.trihedral(r, as_float(path.duration))
    known = {
        "position": lambda: r[0],
        "velocity": lambda: r[1],
        "acceleration": lambda: r[2],
        "jerk": lambda: r[3],
        "dcm": trihedral.dcm,
        "quaternion": trihedral.quaternion,
        "gibbs": trihedral.gibbs,
        "speed": lambda: trihedral.speed,
        "curvature": lambda: trihedral.curvature,
        "torsion": lambda: trihedral.torsion,
        "rate": lambda: trihedral.rate,
        "angular_acceleration": lambda: trihedral.acceleration,
        "defined": lambda: trihedral.defined,
    }
    return {name: known[name]() for name in names}
