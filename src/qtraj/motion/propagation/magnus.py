"""Magnus expansions of 2λ̇ = λ∘ω(t): the rotation vector of a step from the rates at its Gauss points.

Two nodes give order 4, three nodes order 6. The result is an exponential, so |λ| is constant by construction.
"""

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra import rotation
from qtraj.foundation.types import Quat, Scalar, Vec3
from qtraj.motion.propagation.gauss_legendre import tableau
from qtraj.motion.propagation.increment import AbstractIncrement


class Magnus(AbstractIncrement):
    """The Magnus expansion of `order` 4 or 6 (ValueError for others)."""

    order: int = eqx.field(static=True, default=6)

    def __check_init__(self):
        if self.order not in (4, 6):
            raise ValueError(f"the order of a Magnus expansion must be 4 or 6, but {self.order!r} was given")

    @property
    def nodes(self) -> np.ndarray:
        """The Gauss points on [0, 1] (order/2,)."""
        return tableau(self.order // 2).c

    @property
    def weights(self) -> np.ndarray:
        """The weights of the Gauss quadrature (order/2,)."""
        return tableau(self.order // 2).b

    def increment(self, rates: Float[Array, "s 3"], h: Scalar) -> Quat:
        """The unit quaternion E with λ(t+h) = λ(t)∘E, from `rates` [rad/s] at the nodes of a step of `h` [s]."""
        vector = fourth_order(rates, h) if self.order == 4 else sixth_order(rates, h)[0]
        return rotation.from_rotation_vector(vector)


def fourth_order(rates: Float[Array, "2 3"], h: Scalar) -> Vec3:
    """The rotation vector [rad] of a step of `h` [s], from the body rates at ½ ∓ √3/6."""
    first, second = rates
    return 0.5 * h * (first + second) + (math.sqrt(3) / 12) * h * h * jnp.cross(first, second)


def sixth_order(rates: Float[Array, "3 3"], h: Scalar) -> tuple[Vec3, Vec3]:
    """The rotation vector [rad] from the body rates at ½, ½ ∓ √15/10 (ascending), and an embedded one of order 4."""
    first, middle, last = rates
    a1 = h * middle
    a2 = (math.sqrt(15) / 3) * h * (last - first)
    a3 = (10 / 3) * h * (last - 2 * middle + first)
    c1 = -jnp.cross(a1, a2)
    c2 = jnp.cross(a1, 2 * a3 + c1) / 60
    quadrature = a1 + a3 / 12
    return quadrature - jnp.cross(c1 - 20 * a1 - a3, a2 + c2) / 240, quadrature - c1 / 12
