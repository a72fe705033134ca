"""Places where a quantity of one's own does not exist: it divides by zero, or takes the root of a negative number."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from qtraj.algebra.bounded import BoundedPolynomial
from qtraj.algebra.exact import ExactPolynomial
from qtraj.design.proof.certificate import PROVED, UNDECIDED, UNDEFINED
from qtraj.design.proof.deciding import decided
from qtraj.design.proof.limit_claims import MIN_RELATIVE_DIVISOR, Formulas
from qtraj.design.proof.maxima import find_maxima
from qtraj.design.proof.sources import Source
from qtraj.design.proof.units import unit_of_time
from qtraj.foundation.namespace import xp
from qtraj.path.formula import evaluated
from qtraj.path.frenet import Invariants
from qtraj.path.own_facts import Guard

ROUNDING = 1e-12
"""Negative values of a sampled radicand, relative to its largest magnitude, that count as zero."""


class GuardFormulas(NamedTuple):
    """The formulas of the paths: the invariants at instants, the `grid` of samples, in floats, and in integers."""

    at: Callable[[np.ndarray], Invariants]
    grid: np.ndarray
    bounded: Callable[[], Formulas | None]
    exact: Callable[[int], Formulas]


def state_of(
    guard: Guard, of: GuardFormulas, source: Source, in_si: bool, provable: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the state of a guard (PROVED satisfied, UNDECIDED or UNDEFINED), and the instant of its worst violation.

    `in_si` indicates whether the invariants are in SI units, or in those of `source`.
    """
    grid = of.grid

    def values(u: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):
            return np.asarray(evaluated(guard.factor, of.at(u))) + np.zeros((len(u), provable.size))

    on_grid = values(grid)
    highest = np.max(np.abs(on_grid), axis=0)
    threshold = MIN_RELATIVE_DIVISOR**2 if guard.factor.positive else MIN_RELATIVE_DIVISOR
    least, sign = threshold * highest, np.where(on_grid[len(grid) // 2] < 0, -1.0, 1.0)
    known = np.isfinite(least) & (least > 0)

    def unit(k: int, span: Any) -> float:
        """Return the unit of the factor in floats, in the units of the exact formulas."""
        if in_si or guard.exponents is None:
            return 1.0
        m, s = map(float, guard.exponents[:2])
        return source.length[k] ** m * (source.duration[k] / unit_of_time(source, span, k)) ** s

    def in_floats() -> Any:
        formulas = of.bounded()
        constants = map(BoundedPolynomial.constant, (sign, least))
        return None if formulas is None else formulas.guard(guard, *constants)

    def in_integers(k: int) -> Any:
        formulas = of.exact(k)
        size = least[k] * unit(k, formulas.span)
        if guard.divisor and not size > 0:
            raise ValueError("the divisor is too small to compare")
        return formulas.guard(guard, ExactPolynomial.of(sign[k]), ExactPolynomial.of(size))

    found = decided(provable & (known | ~np.bool_(guard.divisor)), in_floats, in_integers)
    if guard.divisor and not guard.factor.positive:
        badness, worst = lambda u: -np.abs(values(u)), -np.abs(on_grid)
    else:
        badness, worst = lambda u: -values(u), -on_grid
    where, height = find_maxima(badness, grid, worst, found.at[None] if np.any(found.refuted) else None)
    if guard.divisor:
        changes = (on_grid > 0).any(axis=0) & (on_grid < 0).any(axis=0)
        zero = changes | ~(-height > threshold * highest)
    else:
        zero = height > ROUNDING * highest
    zero = found.refuted | zero & ~found.proved
    rest = np.where(provable, UNDECIDED, PROVED)
    return xp.where(found.proved, PROVED, xp.where(zero, UNDEFINED, rest)), where
