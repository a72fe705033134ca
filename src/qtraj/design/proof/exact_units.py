"""Multiply exact polynomials by powers of a unit."""

from __future__ import annotations

from typing import Any

from qtraj.algebra.exact import ExactPolynomial


def times_power(x: Any, base: float, exponent: int) -> Any:
    """Return x·base^exponent, exactly."""
    factor = ExactPolynomial.of(base)
    for _ in range(exponent):
        x = x * factor
    return x
