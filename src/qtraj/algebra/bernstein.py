"""Polynomials on [0, 1] by their Bernstein coefficients, for many polynomials at once: values, parts, interpolation.

A polynomial lies between its smallest and its largest Bernstein coefficient. With two coefficients it is the line
between them.
"""

from functools import lru_cache
from itertools import pairwise
from math import comb
from typing import Any

import numpy as np
from jaxtyping import Float

from qtraj.algebra.bounded import BoundedPolynomial
from qtraj.algebra.exact import ExactPolynomial

Coefficients = Float[np.ndarray, "n terms"]

INTERPOLATED = 6
"""Number of coefficients of the polynomials that interpolate smooth functions in proofs."""

ROUNDING = 2.0**-42
"""Fraction of the largest value that exceeds the rounding errors of an interpolation."""


def values(coefficients: Coefficients, z: Float[np.ndarray, "*k n"]) -> Float[np.ndarray, "*k n"]:
    """Return the values of polynomials at `z`."""
    rows = [coefficients[:, k] for k in range(coefficients.shape[1])]
    while len(rows) > 1:  # de Casteljau; equal coefficients, also infinite ones, are the value
        rows = [_between(a, b, z) for a, b in pairwise(rows)]
    return np.broadcast_to(rows[0], np.broadcast_shapes(np.shape(rows[0]), np.shape(z)))


def restricted(
    coefficients: Coefficients, start: Float[np.ndarray, " n"], end: Float[np.ndarray, " n"]
) -> Coefficients:
    """Return the polynomials on parts of [0, 1] from `start` to `end`; rounding errors are a few of each level."""
    count, rows = coefficients.shape[1], list(coefficients.T)
    found = []
    for k in range(count):  # the blossom: k arguments are the end, the others the start
        own = rows
        for level in range(count - 1):
            at = end if level < k else start
            own = [_between(a, b, at) for a, b in pairwise(own)]
        found.append(own[0])
    return np.stack(found, axis=1)


def _between(a: np.ndarray, b: np.ndarray, z: np.ndarray) -> np.ndarray:
    with np.errstate(invalid="ignore"):
        return np.where(a == b, a, a + z * (b - a))


def elevated(coefficients: Coefficients, terms: int) -> Coefficients:
    """Return the same polynomials with more coefficients, to within rounding errors; constant ones exactly."""
    while (n := coefficients.shape[1]) < terms:
        first, last = coefficients[:, :1], coefficients[:, -1:]
        inner = _between(coefficients[:, 1:], coefficients[:, :-1], np.arange(1, n) / n)
        coefficients = np.concatenate([first, inner, last], axis=1)
    return coefficients


@lru_cache
def _to_powers(terms: int) -> np.ndarray:
    """Return the integer matrix that converts Bernstein coefficients to those of powers of z."""
    n = terms - 1
    return np.array(
        [[(-1) ** (j - i) * comb(n, j) * comb(j, i) if i <= j else 0 for i in range(terms)] for j in range(terms)]
    )


def in_integers(coefficients: Float[np.ndarray, " terms"]) -> ExactPolynomial:
    """Return one polynomial exactly, from coefficients that are finite floats."""
    if (coefficients == coefficients[0]).all():
        return ExactPolynomial.of(coefficients[0])
    whole = ExactPolynomial.from_floats(coefficients)
    own = [*whole.numbers, *[0] * (len(coefficients) - len(whole.numbers))]
    powers = [sum(int(m) * x for m, x in zip(row, own, strict=True)) for row in _to_powers(len(coefficients))]
    while len(powers) > 1 and not powers[-1]:
        powers.pop()
    return ExactPolynomial(powers, whole.exponent)


def in_floats(coefficients: Coefficients, k: int = 0) -> BoundedPolynomial:
    """Return polynomials with bounds on their rounding errors; each coefficient has `k` roundings."""
    matrix = _to_powers(coefficients.shape[1]).astype(float)
    return BoundedPolynomial(
        matrix @ coefficients.T, np.abs(matrix) @ np.abs(coefficients.T), k + coefficients.shape[1] + 1
    )


@lru_cache
def nodes(terms: int) -> Float[np.ndarray, " terms"]:
    """Return the Chebyshev nodes in [0, 1]; Π|z − nodes| is at most 2/4ⁿ for n nodes."""
    return 0.5 - 0.5 * np.cos(np.pi * (np.arange(terms) + 0.5) / terms)


@lru_cache
def _from_values(terms: int) -> np.ndarray:
    n, z = terms - 1, nodes(terms)[:, None]
    k = np.arange(terms)
    basis: Any = np.array([comb(n, i) for i in k]) * z**k * (1 - z) ** (n - k)
    return np.linalg.inv(basis)


def interpolated(at_nodes: Float[np.ndarray, "n terms"]) -> Coefficients:
    """Return the polynomials with these values at the `nodes`."""
    return at_nodes @ _from_values(at_nodes.shape[1]).T


def error(remainder: Float[np.ndarray, " n"], terms: int) -> Float[np.ndarray, " n"]:
    """Return bounds on the errors of interpolations from bounds on the Taylor coefficients of the order `terms`."""
    return 2.0 * 4.0**-terms * (1 + ROUNDING) * remainder


def derivative_bounds(coefficients: Coefficients) -> list[Float[np.ndarray, " n"]]:
    """Return bounds on the magnitudes of the Taylor coefficients p⁽ᵏ⁾/k! of polynomials at any point of [0, 1]."""
    n, found, own = coefficients.shape[1] - 1, [], coefficients
    for k in range(n + 1):
        found.append(comb(n, k) * np.abs(own).max(axis=1))
        own = np.diff(own, axis=1)
    return found
