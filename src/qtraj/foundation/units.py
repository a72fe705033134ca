"""Units: spelled as netCDF spells them, shown as people write them.

A unit is a text such as "m s-2": factors apart by spaces, an exponent behind its factor. "1" is a number without unit.
"""

import re
from functools import cache

SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
FACTOR = re.compile(r"([^\W\d_]+)(-?\d+)?")


@cache
def powers(unit: str) -> dict[str, int]:
    """The exponent of each factor: "m s-2" is {"m": 1, "s": -2}.

    **Raises:** ValueError for a text that is no unit.
    """
    found: dict[str, int] = {}
    for factor in () if unit in ("", "1") else unit.split(" "):
        match = FACTOR.fullmatch(factor)
        if match is None:
            raise ValueError(f"{unit!r} is no unit: write factors with their exponents, such as 'm s-2'")
        found[match[1]] = found.get(match[1], 0) + int(match[2] or 1)
    return found


@cache
def symbol(unit: str) -> str:
    """The unit as people write it: "m s-2" is "m/s²", "1" is empty."""
    above = "·".join(_factor(name, power) for name, power in powers(unit).items() if power > 0)
    below = "".join("/" + _factor(name, -power) for name, power in powers(unit).items() if power < 0)
    return f"{above or '1'}{below}" if below else above


def spelled(factors: dict[str, int]) -> str:
    """The unit of these exponents, as netCDF spells it."""
    return " ".join(name + ("" if power == 1 else str(power)) for name, power in factors.items() if power) or "1"


def per_time(unit: str) -> int:
    """The power of 1/s: a path driven in half the time has 2 to this power times the value."""
    return -powers(unit).get("s", 0)


def integrated(unit: str) -> str:
    """The unit of an integral over time."""
    factors = dict(powers(unit))
    factors["s"] = factors.get("s", 0) + 1
    return spelled(factors)


def with_unit(value: float, unit: str) -> str:
    """A value and its unit: "0.05 1/m"."""
    return f"{value:.6g} {symbol(unit)}".rstrip()


def _factor(name: str, power: int) -> str:
    return name if power == 1 else name + str(power).translate(SUPERSCRIPTS)
