"""Find limits with which the fastest timing takes a prescribed duration.

The limits on accelerations are multiplied by a factor f ≤ 1, and the limit on the jerk by f^1.5; limits on the speed,
on rates of rotation, on friction and on power stay. So the timing accelerates as gently as the duration permits. The
fastest timing, slowed down by the factor 1/√f, satisfies the reduced limits. So an f for which this slower timing has
the duration is a bound, and a secant method improves it.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from qtraj.design.ellipse import OfSpeed
from qtraj.design.timing.part_search import Posed
from qtraj.design.timing.road import ON_ROAD
from qtraj.design.timing.sided import SIDED
from qtraj.design.varying import Varying, all_values
from qtraj.path.own_facts import time_degree
from qtraj.path.quantity import COMBINED, quantity

STEPS, LEAST = 16, 1e-12
"""Largest number of timings for the factor, and its smallest value: gentler timings have a constant speed."""


def scaled(bounds: dict[str, Any], factor: float) -> dict[str, Any]:
    """Return the limits with those on accelerations multiplied by `factor`, and that on the jerk by its power 1.5."""
    return {name: _product(bound, factor ** _exponent(name, bound)) for name, bound in bounds.items()}


def _product(bound: Any, factor: float) -> Any:
    return bound.scaled(factor) if isinstance(bound, Varying | OfSpeed) else bound * factor


def ratios(names: tuple[str, ...], bounds: dict[str, Any], factor: float) -> np.ndarray:
    """Return the ratios of the scaled limits to the given ones."""
    return np.array([factor ** _exponent(name, bounds[name]) for name in names])


def gentlest(p: Posed, wanted: float, keeps_ends: bool, duration: Callable[[Posed], float]) -> tuple[Posed, float]:
    """Return the problem whose solution takes the time `wanted` [s], and the factor on the limits on accelerations.

    If the fastest timing takes longer, the problem is `p` itself. `duration` returns the minimum duration of a problem.
    `keeps_ends` indicates that a speed at an end is given. Otherwise the small rest of the duration is added by slowing
    down the whole motion.
    """
    own = p._replace(polynomials=None)  # without proofs
    scalable = any(_exponent(name, x) > 0 for bounds in p.all_bounds for name, x in bounds.items())

    def limited(p: Posed, factor: float) -> Posed:
        others = tuple((path, scaled(bounds, factor)) for path, bounds in p.others)
        return p._replace(bounds=scaled(p.bounds, factor), others=others)

    def with_factor(factor: float) -> float:
        return duration(limited(own, factor))

    found = factor_for(with_factor, wanted, p.tolerance) if scalable else (1.0, with_factor(1.0))
    if found is None or found[1] > wanted:
        return p, 1.0
    factor, taken = found
    return limited(p, factor)._replace(slower=0.0 if keeps_ends else 1 - (taken / wanted) ** 2), factor


def factor_for(duration: Callable[[float], float], wanted: float, tolerance: float) -> tuple[float, float] | None:
    """Return a factor f with a duration slightly below `wanted` [s], and this duration; None if f > 1 is needed.

    `duration` returns the minimum duration for a factor.
    """
    fastest = duration(1.0)
    if not fastest <= wanted:
        return None
    best, slow = (1.0, fastest), None  # the last factors with durations below and above the wanted one
    guess = (fastest / wanted) ** 2
    for _ in range(STEPS):
        if best[1] >= (1 - tolerance) * wanted or guess < LEAST:
            break
        found = duration(guess)
        if found <= wanted:
            before, best = best, (guess, found)
        else:
            before, slow = slow or best, (guess, found)
        other = slow or before
        slope = np.log(other[1] / best[1]) / np.log(other[0] / best[0]) if other[0] != best[0] else -0.5
        goal = np.log((1 - 0.5 * tolerance) * wanted / best[1])
        guess = best[0] * np.exp(goal / min(slope, -1e-3))
        if slow is not None:
            guess = float(np.clip(guess, slow[0] + 0.05 * (best[0] - slow[0]), best[0]))
    return best


def _exponent(name: str, bound: Any) -> float:
    """Return the exponent of the factor; a limit that does not allow zero does not change."""
    entry = quantity(name)
    per_time = 2 if name == COMBINED else float(time_degree(entry) or 0) if entry.own else entry.per_time
    sided = name in SIDED or bool(entry.own and entry.base)
    excludes_zero = sided and (entry.side * all_values(bound) <= 0).any()
    return 0.0 if name in ON_ROAD or per_time < 2 or excludes_zero else 0.5 * per_time
