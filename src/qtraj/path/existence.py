"""Check at sampled instants whether a frame exists on a path."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from qtraj.path.frame_axes import MINIMIZING, NATURAL, THRUST_ALIGNED, UPRIGHT
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.trihedral import AbstractFrame, trihedral

MISSING = {
    NATURAL: "zero speed or zero curvature",
    UPRIGHT: "zero speed or vertical motion",
    THRUST_ALIGNED: "zero speed, free fall, or thrust along the velocity or the heading",
    MINIMIZING: "zero speed",
}
"""The conditions under which a frame does not exist, by the name of the frame."""

SAMPLES = 257
"""Number of equally spaced instants at which a frame must exist."""


def first_undefined(path: AbstractHodograph, frame: AbstractFrame, samples: int = SAMPLES) -> float | None:
    """Return the first of `samples` equally spaced instants [s] at which a frame does not exist.

    If the frame exists at all of them, return None.
    """
    times = jnp.linspace(0.0, path.duration, samples)
    defined = np.asarray(_defined(path, frame, times))
    return None if defined.all() else float(times[int(np.argmin(defined))])


@eqx.filter_jit
def _defined(path: AbstractHodograph, frame: AbstractFrame, times: Float[Array, " n"]) -> Bool[Array, " n"]:
    return jax.vmap(lambda t: trihedral(path, t, frame).defined)(times)
