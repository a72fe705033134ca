"""The numbers by which limits on moments are divided, so that they apply to ratios of polynomials."""

from collections.abc import Iterable
from typing import Any

import jax.numpy as jnp

from qtraj.path.path_quantity import PathQuantity
from qtraj.path.quantity import quantity
from qtraj.path.vehicle import RoadParameters

FACTOR_ROUNDINGS, TINY = 16, 1e-30
"""Terms that are added to a divisor, relative to the sum of the moments of inertia about τ and b.

The divisor is a difference of moments of inertia. The first term is used only on a banked road; it is a bound on the
rounding error, in machine epsilons. The second term is a negligible number that keeps the divisor positive. The moment
about n is at most the sum, so the sum bounds all moments.
"""


def divisors(names: Iterable[str], road: RoadParameters) -> dict[str, Any]:
    """Return, by name, the positive numbers by which limits are divided.

    The divided limits apply to quantities whose squares are ratios of polynomials. For the three moments, the divisor
    is the factor that depends on the inertia (`PathQuantity.factor`), plus a negligible number; otherwise it is 1.
    Without a bank angle, the only rounding error of a factor is from one subtraction of moments of inertia. With a bank
    angle, a bound on the rounding errors of the moments of inertia is added to the divisor, and proofs include it.
    """
    return {name: 1.0 if quantity(name).factor is None else _divisor(quantity(name), road) for name in names}


def _divisor(entry: PathQuantity, road: RoadParameters) -> Any:
    total = road.inertia_tangent + road.inertia_binormal
    eps = float(jnp.finfo(total.dtype).eps)
    # A divisor of zero would make the quotient infinite.
    return entry.scale(road) + total * (TINY + FACTOR_ROUNDINGS * eps * (road.sin != 0).astype(total.dtype))
