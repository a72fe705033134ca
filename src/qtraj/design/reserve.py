"""Scales of limits on one side of a signed value, as searches impose them.

With the sign of the side, the limit is x ≤ b, where b is positive if the limit allows zero. Searches impose it as
(x + s)/(b + s) ≤ 1 with the shift s, which is zero for b > 0. Otherwise b + s, the *room*, is |b|, or the size of other
limits in the same unit if b is almost zero.
"""

from collections.abc import Mapping
from typing import Any

from qtraj.foundation.namespace import namespace
from qtraj.foundation.types import Scalar
from qtraj.path.quantity import quantity

ALMOST_ZERO = 0.01
"""Fraction of other limits in the same unit below which a bound counts as zero."""


def reserve(name: str, bounds: Mapping[str, Scalar]) -> tuple[Any, Any]:
    """Return the room and the shift of one limit; `bounds` are all limits by name."""
    b = quantity(name).side * bounds[name]
    xp, size = namespace(*bounds.values()), abs(b)
    room = xp.where((b > 0) | (size > ALMOST_ZERO * _typical(name, bounds)), size, _typical(name, bounds))
    room = xp.where(room > 0, room, 1.0)
    return room, xp.where(b > 0, 0.0, room) - xp.where(b > 0, 0.0, b)  # a limit may be infinite


def _typical(name: str, bounds: Mapping[str, Scalar]) -> Any:
    """Return the size of the other limits on quantities of this unit, or 0 without any."""
    unit, found = quantity(name).unit, 0.0
    for other, bound in bounds.items():
        if other != name and quantity(other).unit == unit:
            found = namespace(found, bound).maximum(found, abs(bound))
    return found


def tightened(name: str, bounds: Mapping[str, Scalar], fraction: float) -> Scalar:
    """Return a limit on one side that is stricter by `fraction` of its room."""
    limit, side = bounds[name], quantity(name).side
    xp, allows_zero = namespace(*bounds.values()), side * limit > 0
    room = xp.where(allows_zero, 0.0, reserve(name, bounds)[0])
    return xp.where(allows_zero, limit * (1 - fraction), limit - side * fraction * room)


def value_at(usage: Any, name: str, bounds: Mapping[str, Scalar]) -> Any:
    """Return the value for which the imposed quotient (x + s)/(b + s) is `usage`."""
    room, shift = reserve(name, bounds)
    return quantity(name).side * (usage * room - shift)
