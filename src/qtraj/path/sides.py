"""Lower and upper bounds on signed values, as entries of the registry of path quantities.

A limit that is one number bounds the magnitude of a quantity. A limit that is a pair bounds its signed value on two
sides. Each side is an entry of its own, so proofs, searches and tables treat a side like any other limit: the name of
the quantity with `_min` for the lower bound, and with `_max` for the upper bound. For quantities that are never
negative, such as the speed, their own entry is the upper side.
"""

from collections.abc import Iterable
from dataclasses import replace

from qtraj.path.path_quantity import PathQuantity

LOWER, UPPER = "_min", "_max"
"""The endings of the names of the two sides."""


def sides_of(entries: Iterable[PathQuantity]) -> dict[str, PathQuantity]:
    """Return the lower and the upper sides of quantities by name, except upper sides that are the quantity itself."""
    return {side.name: side for entry in entries if has_sides(entry) for side in _sides(entry)}


def has_sides(entry: PathQuantity) -> bool:
    """Return whether a limit on the quantity may have two sides.

    The error bound of a `factor` is only valid for upper bounds.
    """
    return entry.factor is None


def upper_side(entry: PathQuantity) -> str:
    """Return the name of the upper side of a quantity."""
    return entry.name + UPPER if entry.component or entry.signed else entry.name


def _sides(entry: PathQuantity) -> list[PathQuantity]:
    value, ratio = replace(entry, output=entry.variable, base=entry.name, bounds_speed=False), entry.component
    if ratio is not None:
        value = replace(
            value,
            symbol=entry.symbol.strip("|"),
            meaning=ratio.meaning,
            numerator=ratio.numerator,
            denominator=ratio.denominator,
            signed=ratio.value,
            square=None,
            output=entry.name,
            divisor=ratio.divisor or entry.divisor,
        )
    lower = replace(value, name=entry.name + LOWER, lower=True)
    return [lower] if upper_side(entry) == entry.name else [lower, replace(value, name=upper_side(entry))]
