"""Compute the fastest timing of one part of a path, and prove its limits."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from qtraj.design.ellipse import OfSpeed
from qtraj.design.proof.certificate import PROVED, SAMPLED
from qtraj.design.timing.adaptive import on_chosen_cells
from qtraj.design.timing.constraints import POWERS, all_names, listed
from qtraj.design.timing.grid import Grid, ends as ends_of_cells, of_segments, uniform
from qtraj.design.timing.held import Solved, with_ends
from qtraj.design.timing.part_search import Posed, Searched, searched
from qtraj.design.timing.parts import Part, known_segments
from qtraj.design.timing.proof import prove
from qtraj.design.timing.road_proof import proved_on_road
from qtraj.design.timing.search import Found
from qtraj.design.timing.timing import Timing
from qtraj.design.varying import in_cells, varies
from qtraj.foundation.arrays import constants, is_traced
from qtraj.foundation.namespace import namespace
from qtraj.path.road_on_path import RoadOnPath
from qtraj.path.route import Route

KNOTS = 512
"""Number of cells of a part if they cannot be chosen, because the path or a limit is traced."""

SMALL_CELLS = (512, 1024, 2048)
"""Numbers of equal cells that are tried in turn where chosen cells do not satisfy limits that depend on the speed."""

SLOWER = (3e-5, 3e-4, 3e-3)
"""Fractions by which u̇² is reduced until all limits are proved: in sharp bends, rounding errors exceed the margin."""

LEAST_TOLERANCE = 0.1
"""Least tolerance, as a fraction of the given one, of a search that leaves room for the time lost by the proofs."""


class TimedPart(NamedTuple):
    """The timing of a part: coefficients of u̇², usage and status of limits in each cell, and knots.

    The usage of a limit is the ratio of the quantity to the limit. `found` is the result of the search, and None for a
    stop. `enough` is the largest optimality error of a search that converged, and `excess` the estimated difference to
    the minimum duration over all timings [s], or NaN.
    """

    powers: Float[Any, "cells 4"]
    usage: Float[Any, "limits cells"]
    codes: Int[Any, "limits cells"]
    knots: Float[Any, " cells+1"]
    found: Found | None = None
    enough: Any = np.zeros(())
    excess: Any = np.zeros(())


def timed(p: Posed, part: Part, at_ends: Any, rest: tuple[bool, bool]) -> tuple[TimedPart, Grid | None]:
    """Return the fastest timing of a part of the path with a proof of its limits, and its cells, or None for a stop.

    `at_ends` are the bounds on u̇² at both ends, and `rest` indicates where u̇² is zero.
    """
    if not part.moves:
        rows = len(listed(p.names, p.vehicle is not None))
        knots = np.stack([np.asarray(part.start), np.asarray(part.end)])
        stands = np.full((len(all_names(p.names)), 1), PROVED, np.int32)
        return TimedPart(np.array([[1.0, 0, 0, 0]]), np.zeros((rows, 1)), stands, knots), None
    # For traced arguments, other cells would be compiled anew.
    grid = fixed(p, part) if p.knots is not None or is_traced(p.path, p.bounds, p.vehicle, at_ends) else None
    return with_ends(p, part, (at_ends, rest), grid, lambda p: _solved(p, part, (at_ends, rest), grid))


def _solved(p: Posed, part: Part, ends: tuple[Any, tuple[bool, bool]], grid: Grid | None) -> Solved:
    """Return the timing and its cells."""
    if grid is not None:
        x, excess = searched(p, part, grid, *ends), np.nan
        proofs = _proved(p, x)
    else:
        x, excess, proofs = _proved_in_tolerance(p, part, ends)
        if any(isinstance(bound, OfSpeed) for bound in p.bounds.values()) and not _all_proved(p, proofs[2]):
            # Large cells cannot follow a limit that changes within a small range of speeds.
            for cells in SMALL_CELLS:
                again = searched(p, part, fixed(p._replace(knots=cells), part), *ends)
                if _all_proved(p, (others := _proved(p, again))[2]):
                    least = x.times().sum() - excess
                    x, excess, proofs = again, np.maximum(again.times().sum() - least, 0.0), others
                    break
    powers, usage, codes, slower = proofs
    excess = excess + _lost(x, slower)
    timed = TimedPart(powers, usage, codes, x.knots, x.found, np.asarray(x.enough), np.asarray(excess))
    return Solved((timed, x.grid), powers, x.found.error < x.enough)


def _proved_in_tolerance(
    p: Posed, part: Part, ends: tuple[Any, tuple[bool, bool]]
) -> tuple[Searched, float, tuple[Any, Any, Any, float]]:
    """Return a search on chosen cells, the estimated difference to the minimum duration [s], and the proofs.

    If only the time lost by the proofs exceeds the tolerance, another search leaves room for it.
    """
    x, excess = on_chosen_cells(p, part, *ends)
    proofs = _proved(p, x)
    time, lost = x.times().sum(), _lost(x, proofs[3])
    if not excess <= p.tolerance * time < excess + lost:
        return x, excess, proofs
    finer = p._replace(tolerance=max(p.tolerance - lost / time, LEAST_TOLERANCE * p.tolerance))
    again, nearer = on_chosen_cells(finer, part, *ends)
    others = _proved(p, again)
    better = again.found.error < x.enough and _all_proved(p, others[2])
    if better and nearer + _lost(again, others[3]) < excess + lost:
        return again, nearer, others
    return x, excess, proofs


def _lost(x: Searched, slower: float) -> float:
    """Return the time that is lost if u̇² is reduced by the fraction `slower` [s]."""
    return (1 - (1 - slower) ** 0.5) * x.times().sum() if slower else 0.0


def moving_time(parts: list[tuple[TimedPart, Grid | None]], rest: tuple[bool, bool]) -> float:
    """Return the total time on the parts that move [s]; `rest` indicates where u̇² is zero on the whole path."""
    total = 0.0
    for k, (part, grid) in enumerate(parts):
        own = rest[0] and k == 0, rest[1] and k == len(parts) - 1
        total += 0.0 if grid is None else float(Timing(part.powers, part.knots, own).duration)
    return total


def fixed(p: Posed, part: Part) -> Grid:
    """Return cells of almost equal length."""
    if not isinstance(p.path, Route):
        return uniform(p.knots or KNOTS)
    cells = max(p.knots or KNOTS, 1 << (2 * (part.last - part.first) - 1).bit_length())
    starts = known_segments(p.path).starts[part.first : part.last]
    return of_segments(np.append(starts, part.end), part.first, cells, part.stops)


def _proved(p: Posed, x: Searched) -> tuple[Any, Any, Any, float]:
    """Return the coefficients of u̇², the usage and the status of limits; slow down the timing if one is not proved.

    The last result is the fraction by which u̇² is reduced for the proofs.
    """
    exponents = np.array([POWERS.get(name, 0.0) for name in listed(p.names, p.vehicle is not None)])[:, None]
    powers, usage = x.found.powers, x.found.usage
    if p.slower:
        powers, usage = (1 - p.slower) * powers, usage * (1 - p.slower) ** exponents
    codes = codes_of(p, x.grid, powers, x.rest, x.found.unbounded)
    if p.polynomials is None or is_traced(constants(powers)):
        return powers, usage, codes, 0.0
    first, reduced = (powers, usage), 0.0
    for fraction in SLOWER:
        # A larger violation remains if the timing is slower by so little.
        if _all_proved(p, codes) or not usage.max() <= 1 + SLOWER[-1]:
            break
        slower = (1 - fraction) * first[0]
        found = codes_of(p, x.grid, slower, x.rest, x.found.unbounded)
        if (found == PROVED).sum() > (codes == PROVED).sum():
            powers, codes, usage, reduced = slower, found, first[1] * (1 - fraction) ** exponents, fraction
    return powers, usage, codes, reduced


def _all_proved(p: Posed, codes: Any) -> bool:
    return bool((codes[[all_names(p.names).index(name) for name in p.names]] == PROVED).all())


def codes_of(p: Posed, grid: Grid, powers: Any, rest: tuple[bool, bool], unbounded: Any = False) -> Any:
    """Return the status of all limits in all cells; SAMPLED if the path is not polynomial."""
    if p.polynomials is None:
        return np.full((len(all_names(p.names)), grid.cells), SAMPLED, np.int32)
    # Nothing is proved about a timing that no limit bounds, because the proofs could take long.
    xp = namespace(unbounded, powers)
    bounds = in_cells(p.bounds, *ends_of_cells(p.path, grid)) if varies(p.bounds) else p.bounds
    given = {name: _if_bounded(xp, unbounded, bounds[name]) for name in p.names}
    own, given, road = constants((powers, given, p.vehicle))
    timing = own, np.array(rest)
    if isinstance(road, RoadOnPath):
        return proved_on_road(p.polynomials, grid, timing, given, road, ends_of_cells(p.path, grid))
    return prove(p.polynomials, grid, timing, given, road).codes


def _if_bounded(xp: Any, unbounded: Any, bound: Any) -> Any:
    """Return a limit, or NaN if the timing is `unbounded`."""
    if isinstance(bound, OfSpeed):
        return jax.tree.map(lambda x: np.nan * x, bound) if np.any(unbounded) else bound
    return xp.where(unbounded, np.nan, bound)
