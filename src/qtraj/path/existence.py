"""Check at sampled instants whether a frame exists on a path."""

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Bool, Float

from qtraj.foundation.arrays import as_float
from qtraj.foundation.namespace import in_numpy, xp
from qtraj.path.frame_axes import MINIMIZING, NATURAL, THRUST_ALIGNED, UPRIGHT
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.trihedral import AbstractFrame, frames, trihedral

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
    times = np.linspace(0.0, float(path.duration), samples)
    compute = _defined if path.supports_numpy and frame.supports_numpy else _compiled_defined
    defined = np.asarray(compute(path, frame, as_float(times)))
    return None if defined.all() else float(times[int(np.argmin(defined))])


def require_defined(path: AbstractHodograph, frame: AbstractFrame) -> None:
    """Raise a ValueError if a frame does not exist everywhere on the path.

    The frame is checked at `SAMPLES` instants. The message contains the first instant at which the frame does not
    exist, and the names of other frames.
    """
    if (when := first_undefined(path, frame)) is not None:
        reason = f" ({MISSING[frame.name]})" if frame.name in MISSING else ""
        other = NATURAL if frame.name == UPRIGHT else UPRIGHT
        raise ValueError(
            f"the {frame.name} frame of this path does not exist at t = {when:.6g} s{reason}: use the frame '{other}' "
            f"or '{MINIMIZING}'"
        )


def _jax_defined(path: AbstractHodograph, frame: AbstractFrame, times: Float[Array, " n"]) -> Bool[Array, " n"]:
    found = frames(path, times, frame)[3]
    if found is None:
        return jax.vmap(lambda t: trihedral(path, t, frame).defined)(times)
    return xp.broadcast_to(found.defined, times.shape)


_compiled_defined = eqx.filter_jit(_jax_defined)
_defined = in_numpy(_jax_defined, _compiled_defined)
