"""Units of quantities of one's own: their notation, and what unit a function has."""

from __future__ import annotations

import re
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np

from qtraj.foundation import units
from qtraj.path.frenet import Invariants
from qtraj.path.product import Factor, Product
from qtraj.path.product_vector import Basic
from qtraj.path.road_parameters import NO_VEHICLE, RoadParameters

BASES = ("m", "s", "kg")
KNOWN = (*BASES, "rad", *units.DERIVED)
"""The factors of a unit; the radian is the number 1."""

FACTOR = re.compile(r"([A-Za-z]+|1)\s*\^?\s*(-?\d+)?")
DIGITS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹·*", "-0123456789  ")

PARAMETERS = {"mass": (0, 0, 1), "gravity": (1, -2, 0), "drag": (-1, 0, 0), "wheelbase": (1, 0, 0)}
"""The exponents of m, s and kg in the units of the vehicle's parameters; the others are numbers."""

STATES, FACTORS = 8, (2.0, 3.0, 5.0)
"""Number of motions at which a function is computed, and the factors by which their m, s and kg are multiplied."""

NEARLY = 1e-4
"""Accuracy of the exponents of a function that is not a formula; it may be computed in float32."""


def unit_of(text: str) -> str:
    """Return a unit such as "m/s^2" in the notation of the library, "m s-2".

    **Raises:** ValueError for a text that is not a product of powers of m, s, kg, rad, N and W.
    """
    exponents: dict[str, int] = {}
    for k, part in enumerate(text.translate(DIGITS).split("/")):
        for factor in re.sub(r"\s*\^\s*", "^", part).split():
            match = FACTOR.fullmatch(factor)
            if match is None or match[1] not in (*KNOWN, "1"):
                raise ValueError(
                    f"{text!r} is not a unit: write a product of powers of {', '.join(KNOWN)}, such as 'm/s^2' or '1'"
                )
            if match[1] != "1":
                exponents[match[1]] = exponents.get(match[1], 0) + (1 if k == 0 else -1) * int(match[2] or 1)
    return units.spelled(exponents)


def exponents_of(unit: str) -> tuple[Fraction, ...]:
    """Return the exponents of m, s and kg in a unit."""
    powers = units.base_powers(unit)
    return tuple(Fraction(powers.get(base, 0)) for base in BASES)


def exponents_of_formula(formula: Product) -> tuple[Fraction, ...] | None:
    """Return the exponents of m, s and kg in the unit of a formula, or None if it adds numbers with different units."""
    found = [formula.degree(lambda f, k=k: _exponent(f, k)) for k in range(len(BASES))]
    return None if any(x is None for x in found) else tuple(found)  # type: ignore[arg-type]


def exponents_of_function(value: Callable[[Invariants], Any], order: int) -> tuple[Fraction, ...] | None:
    """Return the same for a function of invariants, from its values at random motions."""
    own = np.abs(value(invariants_with(order, (1.0, 1.0, 1.0))))
    found = []
    for k, factor in enumerate(FACTORS):
        scales = tuple(factor if k == j else 1.0 for j in range(len(BASES)))
        with np.errstate(all="ignore"):
            powers = np.log(np.abs(value(invariants_with(order, scales))) / own) / np.log(factor)
        nearest = np.round(4 * np.mean(powers)) / 4 if np.all(np.isfinite(powers)) else np.nan
        if not np.all(np.abs(powers - nearest) < NEARLY):
            return None
        found.append(Fraction(nearest))
    return tuple(found)


def invariants_with(order: int, scales: tuple[float, ...]) -> Invariants:
    """Return the invariants of random motions, with a vehicle, whose m, s and kg are multiplied by `scales`."""
    m, s, kg = scales
    random = np.random.default_rng(7)
    rows = [tuple(row * m / s**k for row in random.normal(size=(3, STATES))) for k in range(order + 1)]
    ones = np.ones(STATES)
    known = {name: 1.5 * ones * m**a * s**b * kg**c for name, (a, b, c) in PARAMETERS.items()}
    road = RoadParameters(*[0.8 * ones] * len(NO_VEHICLE.numbers))._replace(**known)
    return Invariants(rows, None, road)


def text_of(exponents: tuple[Fraction, ...]) -> str:
    """Return the unit with these exponents of m, s and kg as a text."""
    if all(x.denominator == 1 for x in exponents):
        unit = units.spelled({base: int(x) for base, x in zip(("m", "s", "kg"), exponents, strict=True)})
        return units.symbol(unit) or "1"
    return " ".join(f"{base}^({x})" for base, x in zip(BASES, exponents, strict=True) if x)


def _exponent(f: Factor, k: int) -> Fraction:
    if f.kind == "parameter":
        return Fraction(PARAMETERS.get(f.parts[0], (0, 0, 0))[k])
    return sum((_of_vector(x, k) for x in f.vectors), Fraction(0))


def _of_vector(basic: Basic, k: int) -> Fraction:
    if basic[0] == "derivative":
        return Fraction((1, -basic[1], 0)[k])
    if basic[0] == "cross":
        return _of_vector(basic[1], k) + _of_vector(basic[2], k)
    return Fraction(0)
