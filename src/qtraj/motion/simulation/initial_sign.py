"""The initial sign of λ: λ and −λ are the same attitude, but the closed loop moves differently from each of them."""

import jax.numpy as jnp
from jax.lax import stop_gradient

from qtraj.foundation.types import Quat
from qtraj.motion.attitude import Attitude

NEARER, AS_GIVEN = "nearer", "as given"
SIGNS = (NEARER, AS_GIVEN)


def require_sign(sign: str) -> None:
    """Raise a ValueError for a sign that is not one of `SIGNS`."""
    if sign not in SIGNS:
        raise ValueError(
            f"sign must be 'nearer' (of λ and −λ, the one nearer to the program) or 'as given', but {sign!r} was given"
        )


def start_quaternion(sign: str, reference: Attitude, quaternion: Quat) -> Quat:
    """λ with the requested sign: "nearer", so that μ0 ≥ 0, or "as given"."""
    if sign == AS_GIVEN:
        return quaternion
    far = stop_gradient(jnp.sum(reference.quaternion.astype(quaternion.dtype) * quaternion)) < 0
    return jnp.where(far, -quaternion, quaternion)
