"""Parse units in netCDF notation ("m s-2"), and convert them to their display form ("m/s²").

A unit is a string of factors, separated by spaces. Each factor is followed by its exponent, unless the exponent is 1.
"1" is the dimensionless unit.
"""

import re
from functools import cache

SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
FACTOR = re.compile(r"([^\W\d_]+)(-?\d+)?")

DERIVED = {"N": {"kg": 1, "m": 1, "s": -2}, "W": {"kg": 1, "m": 2, "s": -3}}
"""Derived units that have a symbol, as exponents of base units."""


@cache
def powers(unit: str) -> dict[str, int]:
    """Return the exponent of each factor, for example {"m": 1, "s": -2} for "m s-2".

    **Raises:** ValueError if the string is not a unit.
    """
    exponents: dict[str, int] = {}
    for factor in () if unit in ("", "1") else unit.split(" "):
        match = FACTOR.fullmatch(factor)
        if match is None:
            raise ValueError(f"{unit!r} is not a unit: write factors with their exponents, such as 'm s-2'")
        exponents[match[1]] = exponents.get(match[1], 0) + int(match[2] or 1)
    return exponents


@cache
def base_powers(unit: str) -> dict[str, int]:
    """Return the exponent of each base unit, for example {"kg": 1, "m": 1, "s": -2} for "N"."""
    exponents: dict[str, int] = {}
    for name, power in powers(unit).items():
        for base, k in DERIVED.get(name, {name: 1}).items():
            exponents[base] = exponents.get(base, 0) + k * power
    return exponents


@cache
def symbol(unit: str) -> str:
    """Return the display form of a unit: "m/s²" for "m s-2", and an empty string for "1"."""
    numerator = "·".join(_factor(name, power) for name, power in powers(unit).items() if power > 0)
    denominator = "".join("/" + _factor(name, -power) for name, power in powers(unit).items() if power < 0)
    return f"{numerator or '1'}{denominator}" if denominator else numerator


def spelled(exponents: dict[str, int]) -> str:
    """Return the unit with these exponents, in netCDF notation; the inverse of `powers`."""
    return " ".join(name + ("" if power == 1 else str(power)) for name, power in exponents.items() if power) or "1"


def per_time(unit: str) -> int:
    """Return the exponent of 1/s in the base units of `unit`.

    With the exponent k, a kinematic quantity is multiplied by 2^k if the path is traversed in half the time.
    """
    return -base_powers(unit).get("s", 0)


def integrated(unit: str) -> str:
    """Return the unit of the integral over time of a quantity in `unit`."""
    exponents = dict(powers(unit))
    exponents["s"] = exponents.get("s", 0) + 1
    return spelled(exponents)


def with_unit(value: float, unit: str) -> str:
    """Format a value with its unit, for example as "0.05 1/m"."""
    return f"{value:.6g} {symbol(unit)}".rstrip()


def _factor(name: str, power: int) -> str:
    return name if power == 1 else name + str(power).translate(SUPERSCRIPTS)
