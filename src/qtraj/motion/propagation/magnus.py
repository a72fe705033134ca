"""Compute Magnus expansions of 2λ̇ = λ∘ω(t): the rotation vector of a step from the rates at its Gauss points.

The expansion has order 4 with two nodes, and order 6 with three nodes. The increment is the exponential of the rotation
vector, so |λ| is constant by construction.
"""

import math

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra import rotation
from qtraj.algebra.vector import cross
from qtraj.foundation.argument import is_whole
from qtraj.motion.propagation.gauss_legendre import tableau
from qtraj.motion.propagation.increment import AbstractIncrement


class Magnus(AbstractIncrement):
    """The Magnus expansion of `order` 4 or 6.

    **Raises:** ValueError for an order other than 4 or 6.
    """

    order: int = eqx.field(static=True, default=6)

    def __check_init__(self):
        if not is_whole(self.order) or self.order not in (4, 6):
            raise ValueError(f"the order of a Magnus expansion must be 4 or 6, but {self.order!r} was given")

    @property
    def nodes(self) -> np.ndarray:
        """The Gauss points (order/2,) on [0, 1]."""
        return tableau(self.order // 2).c

    @property
    def weights(self) -> np.ndarray:
        """The weights (order/2,) of the Gauss quadrature."""
        return tableau(self.order // 2).b

    def increment(self, rates: Float[Array, "*batch s 3"], h: Float[Array, "*batch"]) -> Float[Array, "*batch 4"]:
        """Return the unit quaternion E with λ(t+h) = λ(t)∘E, from `rates` [rad/s] at the nodes of a step of `h` [s]."""
        vector = fourth_order(rates, h) if self.order == 4 else sixth_order(rates, h)[0]
        return rotation.from_rotation_vector(vector)


def fourth_order(rates: Float[Array, "*batch 2 3"], h: Float[Array, "*batch"]) -> Float[Array, "*batch 3"]:
    """Return the rotation vector [rad] of a step of `h` [s], from the body rates at ½ ∓ √3/6 of the step."""
    first, second = (rates[..., k, :] for k in range(2))
    h = h[..., None]
    return 0.5 * h * (first + second) + (math.sqrt(3) / 12) * h * h * cross(first, second)


def sixth_order(
    rates: Float[Array, "*batch 3 3"], h: Float[Array, "*batch"]
) -> tuple[Float[Array, "*batch 3"], Float[Array, "*batch 3"]]:
    """Return the rotation vectors [rad] of order 6 and of order 4 (embedded) of a step of `h` [s].

    `rates` (3, 3) are the body rates at ½ − √15/10, ½ and ½ + √15/10 of the step.
    """
    first, middle, last = (rates[..., k, :] for k in range(3))
    h = h[..., None]
    a1 = h * middle
    a2 = (math.sqrt(15) / 3) * h * (last - first)
    a3 = (10 / 3) * h * (last - 2 * middle + first)
    c1 = -cross(a1, a2)
    c2 = cross(a1, 2 * a3 + c1) / 60
    quadrature = a1 + a3 / 12
    return quadrature - cross(c1 - 20 * a1 - a3, a2 + c2) / 240, quadrature - c1 / 12
