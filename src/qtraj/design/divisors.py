"""The numbers by which limits are divided, or their quantities multiplied, so that they apply to simple ratios."""

from collections.abc import Iterable
from typing import Any

import jax.numpy as jnp
import numpy as np

from qtraj.foundation.arrays import concrete
from qtraj.path.path_quantity import PathQuantity
from qtraj.path.quantity import quantity
from qtraj.path.road_parameters import RoadParameters
from qtraj.path.vehicle import fixed_parameters

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


def reduced(limits: Any, dtype: Any = None) -> dict[str, Any]:
    """Return the limits that are set, divided by their `divisors` or as tangents, as searches use them.

    The results are NumPy arrays if limits and vehicle have concrete values.
    """
    results = {}
    for name, limit in limits.constant().items():
        known = concrete(limit)
        divisor = divisors([name], limits.road(limit.dtype if dtype is None else dtype))[name]
        results[name] = quantity(name).tangent(limit if known is None else np.asarray(known)) / divisor
    return results


def factors(limits: Any, dtype: Any = None) -> tuple[Any, ...]:
    """Return `PathQuantity.scale` of each quantity whose limit is set, in the order of `Limits.given`.

    It depends on the inertia of the vehicle, and is 1 for a quantity without a factor.
    """
    return tuple(quantity(name).scale(fixed_parameters(limits.vehicle, dtype)) for name in limits.given())


def _divisor(entry: PathQuantity, road: RoadParameters) -> Any:
    total = road.inertia_tangent + road.inertia_binormal
    eps = float(jnp.finfo(total.dtype).eps)
    # A divisor of zero would make the quotient infinite.
    return entry.scale(road) + total * (TINY + FACTOR_ROUNDINGS * eps * (road.sin != 0).astype(total.dtype))
