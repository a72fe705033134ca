"""Starts of searches on both sides of obstacles.

The initial path is shifted outwards and inwards, and up and down, by changes of V_ρ and V_h at both ends. For each
obstacle that a shift would reach, the starts are the smallest shifts on both sides of it with which the body is clear.
"""

from __future__ import annotations

import itertools

import numpy as np
from jaxtyping import Float

from qtraj.design.tuning.maxima import GRID
from qtraj.design.tuning.motions.motion import COMPONENTS, ENDS
from qtraj.design.tuning.searches import Curves, Searches

OBSTACLES = 3
"""The number of obstacles with starts on all sides, beginning with those that are nearest to the initial path."""

PAIRS = 2
"""The number of these obstacles for which all combinations of sides are starts, too."""

SHIFTS = np.linspace(-0.6, 0.6, 49)
"""Trial shifts, as fractions of the product of the reference speed and the duration."""

NEAR = -3.0
"""An obstacle whose constraint value stays below this number for all shifts in one direction is not passed by them."""

BEYOND = 1.1
"""Factor on the shift to the nearest clear position of an obstacle."""

DIRECTIONS = (COMPONENTS[0], COMPONENTS[2])
"""The components of the velocities whose changes shift a path: V_ρ and V_h."""


def starts_around(searches: Searches) -> Float[np.ndarray, "n starts batch"]:
    """Return starts on the sides of the obstacles of each problem; none without obstacles."""
    clearances = searches.formulas.clearances
    n = len(searches.problem.names)
    if clearances is None:
        return np.zeros((n, 0, searches.count))
    with np.errstate(all="ignore"):
        depths = _depths(searches, np.zeros((n, searches.count)), list(clearances.obstacles.values()))
        nearest = np.argsort(-depths.max(axis=1), axis=0, kind="stable")[:OBSTACLES]
        passed = [_passed(searches, which, depths) for which in nearest]
    found = [side for sides in passed for side in sides]
    for one, other in itertools.combinations(passed[:PAIRS], 2):
        found += [a + b for a, b in itertools.product(one[:2], other[:2])]
        found += [a + b for a, b in itertools.product(one[2:], other[2:])]
    return np.clip(np.stack(found, axis=1), searches.low[:, None], searches.high[:, None])


def _passed(searches: Searches, which: np.ndarray, depths: np.ndarray) -> list[np.ndarray]:
    """Return the variables of paths on four sides of one obstacle of each problem: out, in, up and down."""
    batch = np.arange(searches.count)
    at = np.clip(GRID[depths.argmax(axis=1)[which, batch]], 0.1, 0.9)
    rows = list(searches.formulas.clearances.obstacles.values())  # type: ignore[union-attr]
    found = []
    for component in DIRECTIONS:
        unit = _shift(searches, component, at)
        depth = np.stack([_depths(searches, x * unit, rows).max(axis=1)[which, batch] for x in SHIFTS])
        most = depth.max(axis=0)
        hit = (depth > 0) | (depth == np.minimum(most, 0.0))  # a small obstacle may be between two shifts
        middle = np.argmin(np.where(hit, np.abs(SHIFTS)[:, None], np.inf), axis=0)
        reached = most > NEAR
        order = np.arange(SHIFTS.size)[:, None]
        for side in (1, -1):
            beyond = (depth <= 0) & (side * (order - middle) > 0)
            k = np.argmin(np.where(beyond, side * (order - middle), SHIFTS.size), axis=0)
            shift = BEYOND * SHIFTS[k] * (reached & beyond.any(axis=0))
            found.append(unit * shift)
    return found


def _shift(searches: Searches, component: str, at: np.ndarray) -> np.ndarray:
    """Return the smallest change (n, batch) that shifts the path at the fraction `at` by the speed times the duration.

    A change of the velocity at the start adds u(1 − u)², one at the end −u²(1 − u).
    """
    names = searches.problem.names
    weights = {ENDS[0]: at * (1 - at) ** 2, ENDS[1]: -(at**2) * (1 - at)}
    square = sum(w * w for w in weights.values())
    unit = np.zeros((len(names), searches.count))
    for end, w in weights.items():
        unit[names.index(f"{end}.{component}")] = w / square
    return unit


def _depths(searches: Searches, z: np.ndarray, rows: list[list[str]]) -> Float[np.ndarray, "obstacles nodes batch"]:
    """Return the largest constraint values of the balls of each obstacle at the nodes."""
    curves = Curves(searches, z)
    shape = GRID.size, searches.count
    return np.stack(
        [np.max([np.broadcast_to(g, shape) for g in curves.values(names, GRID[:, None], 1)], axis=0) for names in rows]
    )
