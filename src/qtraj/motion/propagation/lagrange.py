"""Evaluate Lagrange basis polynomials."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation.types import Scalar


def lagrange(x: Scalar, knots: Float[Array, " w"]) -> Float[Array, " w"]:
    """Return the values (w,) at `x` of the Lagrange basis polynomials of the `knots`.

    The values are computed as products, so that their derivatives are finite at the knots.
    """
    size = knots.shape[0]
    other = ~np.eye(size, dtype=bool)
    above = jnp.where(other, jnp.broadcast_to(x - knots, (size, size)), 1.0)
    below = jnp.where(other, knots[:, None] - knots[None, :], 1.0)
    return jnp.prod(above / below, axis=1)
