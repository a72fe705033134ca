"""Compute the polynomials of segments of constant jerk."""

from jaxtyping import Array, Float

from qtraj.foundation.namespace import xp
from qtraj.foundation.types import Scalar


def jerk_pieces(
    widths: Float[Array, " n"],
    jerks: Float[Array, " n"],
    rate: Scalar | float = 0.0,
    acceleration: Scalar | float = 0.0,
) -> Float[Array, "n 4"]:
    """Return the ascending coefficients of the angle in each segment, in a variable from 0 to 1.

    `rate` and `acceleration` are the values at the start of the first segment, where the angle is 0.
    """
    acceleration_steps = jerks * widths
    accelerations = acceleration + (xp.cumsum(acceleration_steps) - acceleration_steps)
    rate_steps = (accelerations + acceleration_steps / 2) * widths
    rates = rate + (xp.cumsum(rate_steps) - rate_steps)
    powers = xp.stack([rates * widths, accelerations * widths**2 / 2, acceleration_steps * widths**2 / 6], axis=1)
    angle_steps = xp.sum(powers, axis=1)
    angles = xp.cumsum(angle_steps) - angle_steps
    return xp.concatenate([angles[:, None], powers], axis=1)
