"""Prescribe the speeds at the ends of a part of a path: exactly where they are within reach, otherwise as bounds.

A spline pays for each change of its slope, so a timing that may end more slowly than prescribed often does. Therefore
u̇² at an end, which is a coefficient of the spline, is fixed. Whether a speed is within reach is known only where the
relaxed timing does not reach it. Otherwise, a first search decides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from qtraj.design.timing.cells import Cells, Shape, chosen, relaxed_profile
from qtraj.design.timing.grid import Grid
from qtraj.design.timing.part_search import Held, Posed, first_search, shape_of, task_of
from qtraj.design.timing.parts import Part
from qtraj.design.timing.result_code import REACHED
from qtraj.design.timing.rounds import GAPS, LEAST_ERROR
from qtraj.foundation.arrays import is_traced

HIGHEST = (1 - 4e-5, 1 - 1e-3)
"""Fractions of the relaxed u̇² at an end that are tried at most: for the margin of the limits, and also for the errors
of the relaxed timing."""

ACCURACY = 1e-3
"""Accuracy of the cells on which a search decides whether the speeds are within reach."""

HALVED = 1
"""How often these cells are halved before the speeds count as out of reach."""

CORRECTIONS, EXACT = 2, 1e-10
"""How often the ends are corrected for a timing that had to be slowed down, and the relative error of u̇² without it."""

Ends = Float[np.ndarray, " 2"]


class Solved(NamedTuple):
    """The result for one problem, the coefficients of its timing, and whether the search converged."""

    result: Any
    powers: Any
    converged: Any


def with_ends(
    p: Posed,
    part: Part,
    ends: tuple[Any, tuple[bool, bool]],
    grid: Grid | None,
    solve: Callable[[Posed], Solved],
) -> Any:
    """Return the result for the prescribed values of u̇² at the ends, where they are within reach.

    `ends` contains these values, infinite if free, and where u̇² is zero instead. `grid` are given cells, or None.
    A traced problem has only bounds.
    """
    for posed in _candidates(p, part, *ends, grid):
        own, found = posed, solve(posed)
        for _ in range(CORRECTIONS):
            if not found.converged or (next_one := _corrected(own, posed.held, found.powers)) is None:
                break
            own, found = next_one, solve(next_one)
        if found.converged:
            return found.result
    return solve(p).result


def _candidates(p: Posed, part: Part, ends: Any, rest: tuple[bool, bool], grid: Grid | None) -> Iterator[Posed]:
    """Yield problems with prescribed ends in the order in which to solve them.

    A start speed above the relaxed timing remains a bound, because then the vehicle has to brake first (see `braking`).
    """
    if not is_traced(p.path, p.bounds, p.vehicle, p.others, ends):
        given = np.isfinite(ends) & ~np.array(rest) & ~np.array(part.stops)
        if given.any():
            shape = shape_of(p.path, part, [path for path, _ in p.others])
            cells = chosen(shape, task_of(p, ends, part, rest, shape), ACCURACY)[0]
            reached = np.array([_reached(p, part, ends, rest, (shape, cells, side)) for side in (0, -1)])
            for held in dict.fromkeys(_choices(np.asarray(ends), reached, given)):
                posed = p._replace(held=held)
                if _within_reach(posed, part, (ends, rest), (shape, cells, grid)):
                    yield posed


def _reached(p: Posed, part: Part, ends: Ends, rest: tuple[bool, bool], at: tuple[Shape, Cells, int]) -> float:
    """Return the u̇² of the relaxed timing at one end, if it is free there; infinite if it is no bound."""
    shape, cells, side = at
    free = np.array(ends)
    free[side] = np.inf
    relaxed = relaxed_profile(shape, task_of(p, free, part, rest, shape), cells)
    return float(relaxed.a[side, side]) if relaxed.bounds else np.inf


def _choices(ends: Ends, reached: Ends, given: Bool[np.ndarray, " 2"]) -> Iterator[Held]:
    """Yield values of u̇² at both ends; None for an end that is only bounded."""
    for which in ((True, True), (True, False), (False, True)):
        for fraction in HIGHEST:
            own = np.where(given & np.array(which), np.minimum(ends, fraction * reached), np.nan)
            if own[0] < (1 - 2 * REACHED) * ends[0]:
                own[0] = np.nan
            if np.isfinite(own).any():
                start, end = (None if np.isnan(x) else x for x in own.tolist())
                yield start, end


def _within_reach(
    p: Posed, part: Part, ends: tuple[Any, tuple[bool, bool]], at: tuple[Shape, Cells, Grid | None]
) -> bool:
    """Return whether a timing with the prescribed ends satisfies the limits at the nodes."""
    shape, cells, grid = at
    enough = max(GAPS[0], LEAST_ERROR * p.tolerance)
    for _ in range(HALVED + 1):
        own = cells.grid(shape.spans, part.first) if grid is None else grid
        found = first_search(p, part, own, *ends)
        if found.error < enough and np.isfinite(found.powers).all():
            return True
        if grid is not None:
            break
        cells = cells.halved(np.ones(cells.half.size, bool))
    return False


def _corrected(p: Posed, aims: Held, powers: Any) -> Posed | None:
    """Return the problem whose ends are as much higher as those of its timing are too low; None if they are exact."""
    reached = float(powers[0, 0]), float(np.sum(powers[-1]))
    missed = [0.0 if aim is None else aim / x - 1 for aim, x in zip(aims, reached, strict=True)]
    if max(abs(x) for x in missed) <= EXACT:
        return None
    start, end = (None if x is None else x * (1 + e) for x, e in zip(p.held, missed, strict=True))
    return p._replace(held=(start, end))
