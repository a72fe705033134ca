"""Limits on one side of a signed value, as searches impose them.

With the sign of the side, the limit is x ≤ b, where b is positive if the limit allows zero. Searches impose it as
(x + s)/(b + s) ≤ 1. The shift s is zero for b > 0. Otherwise the scale b + s is |b|, or the size of other limits in the
same unit if b is almost zero.
"""

from collections.abc import Mapping
from typing import Any

from qtraj.foundation.namespace import namespace
from qtraj.foundation.types import Scalar
from qtraj.path.quantity import quantity

ALMOST_ZERO = 0.01
"""Fraction of other limits in the same unit below which a bound counts as zero."""


def scale_and_shift(name: str, bounds: Mapping[str, Scalar]) -> tuple[Any, Any]:
    """Return the scale b + s and the shift s of one limit; `bounds` are all limits by name."""
    b = quantity(name).side * bounds[name]
    xp, size, others = namespace(*bounds.values()), abs(b), _size_of_others(name, bounds)
    scale = xp.where((b > 0) | (size > ALMOST_ZERO * others), size, others)
    scale = xp.where(scale > 0, scale, 1.0)
    return scale, xp.where(b > 0, 0.0, scale) - xp.where(b > 0, 0.0, b)  # a limit may be infinite


def _size_of_others(name: str, bounds: Mapping[str, Scalar]) -> Any:
    """Return the size of the other limits on quantities of this unit, or 0 without any."""
    unit, found = quantity(name).unit, 0.0
    for other, bound in bounds.items():
        if other != name and quantity(other).unit == unit:
            found = namespace(found, bound).maximum(found, abs(bound))
    return found


def stricter(name: str, bounds: Mapping[str, Scalar], fraction: float) -> Scalar:
    """Return a limit that is stricter by `fraction` of its scale."""
    limit, side = bounds[name], quantity(name).side
    xp, allows_zero = namespace(*bounds.values()), side * limit > 0
    scale = xp.where(allows_zero, 0.0, scale_and_shift(name, bounds)[0])
    return xp.where(allows_zero, limit * (1 - fraction), limit - side * fraction * scale)


def value_at(usage: Any, name: str, bounds: Mapping[str, Scalar]) -> Any:
    """Return the value for which the imposed quotient (x + s)/(b + s) is `usage`."""
    scale, shift = scale_and_shift(name, bounds)
    return quantity(name).side * (usage * scale - shift)
