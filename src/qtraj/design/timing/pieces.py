"""Prove limits that change along the way on a timing that was not made for them, in parts of its cells.

On a cell, the proof is about a constant or a polynomial that is nowhere less strict than the limit (see `varying` and
`limit_curves`). Where the limit bends or changes in steps within a cell, it is a constant, so that the proof may fail
although the limit is satisfied. Such cells are halved until the polynomials are close to the limit, or until a sample
violates the limit itself.
"""

from collections.abc import Collection
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from qtraj.design.limit_curves import curves
from qtraj.design.proof.certificate import BROKEN, PROVED, UNDECIDED
from qtraj.design.timing.constraints import all_names
from qtraj.design.timing.grid import Grid
from qtraj.design.timing.proof import prove
from qtraj.design.timing.retimed_cells import Cells
from qtraj.design.timing.retimed_maxima import PLACES, Limited
from qtraj.design.timing.road import ON_ROAD
from qtraj.design.timing.road_proof import part_of_grid, prove_on_road
from qtraj.design.timing.sources import Source
from qtraj.design.timing.timing import RetimedPath, Timing
from qtraj.design.varying import Varying
from qtraj.path.road_on_path import RoadOnPath

ACCURATE, HALVINGS, MOST = 1e-7, 16, 2**13
"""Cells are halved, at most `HALVINGS` times, until steps of the limits are below this relative accuracy, or
polynomials are accurate. From the number `MOST` of parts on, no cell is halved."""

AT_STEPS, SHORT = 24, 0.25
"""Then cells with a step or a bend of a limit are halved, at most `AT_STEPS` more times, until they are shorter than
the part `SHORT` of the uncertainty of distances, within which the stricter value holds."""

LEAST = 2.0**-40
"""Smallest half length of a piece that is halved, relative to its segment; so the ends of pieces are exact floats."""

Codes = Int[np.ndarray, "limits pieces"]


class Pieces(NamedTuple):
    """Parts of the moving cells of a timing: each is from `start` to `end` of its `cell`, as dyadic fractions."""

    cell: Int[np.ndarray, " pieces"]
    start: Float[np.ndarray, " pieces"]
    end: Float[np.ndarray, " pieces"]

    def halved(self, chosen: Bool[np.ndarray, " pieces"]) -> tuple["Pieces", Int[np.ndarray, " more"]]:
        """Return the pieces with the chosen ones halved, in the same order, and the index of each in these pieces."""
        index = np.repeat(np.arange(chosen.size), 1 + chosen)
        cell, start, end = (x[index] for x in self)
        second = np.flatnonzero(np.append(False, index[1:] == index[:-1]))
        start[second] = end[second - 1] = 0.5 * (start[second] + end[second])
        return Pieces(cell, start, end), index

    def of(self, grid: Grid) -> Grid:
        """Return the pieces of a grid."""
        return part_of_grid(grid, *self)

    def part(self, chosen: Any) -> "Pieces":
        """Return some of the pieces."""
        return Pieces(*(x[chosen] for x in self))


def proved_in_pieces(limited: Limited, polynomials: Source) -> tuple[Limited, Codes]:
    """Return the path with its cells divided where necessary, and the status of each limit on each piece.

    The statuses have the order of `all_names`. The path and the limits have concrete values. BROKEN refers to limits
    that are constant on the piece.
    """
    problem = _Problem(limited, polynomials)
    index_of = problem.index_of
    count = limited.cells.columns.size
    pieces = Pieces(np.arange(count), np.zeros(count), np.ones(count))
    codes, rough = problem.judged(pieces, tuple(limited.bounds))
    for k in range(HALVINGS + AT_STEPS):
        unproved = rough & (codes != PROVED) & (pieces.of(limited.cells.grid).half > LEAST)
        if k >= HALVINGS and unproved.any():
            unproved &= problem.at_steps(pieces)
        for name in problem.changing:
            row = unproved[index_of[name]]
            row &= not problem.violated(pieces.part(row), name)
        chosen = unproved.any(axis=0)
        if not chosen.any() or chosen.size > MOST:
            break
        pieces, index = pieces.halved(chosen)
        codes, rough = codes[:, index], rough[:, index]
        names = tuple(name for name in problem.changing if unproved[index_of[name]].any())
        new = chosen[index]
        found = problem.judged(pieces.part(new), names)
        for name in names:
            row, again = index_of[name], unproved[index_of[name], index]
            codes[row, again], rough[row, again] = (x[row, again[new]] for x in found)
    codes = np.where(rough & (codes == BROKEN), UNDECIDED, codes)
    return (limited if codes.shape[1] == count else _divided(limited, pieces)), codes


class _Problem:
    """The limits on a timing, and the polynomials of its path."""

    def __init__(self, limited: Limited, polynomials: Source):
        self._limited, self._polynomials = limited, polynomials
        self._on_road = isinstance(limited.vehicle, RoadOnPath)
        self.changing = tuple(
            name for name, x in limited.bounds.items() if isinstance(x, Varying) or (self._on_road and name in ON_ROAD)
        )
        self.index_of = {name: k for k, name in enumerate(all_names(limited.bounds))}
        timing, columns = limited.path.timing, limited.cells.columns
        self._powers = np.asarray(timing.coefficients)[columns]
        self._rest = np.zeros((2, columns.size), bool)
        self._rest[0, 0], self._rest[1, -1] = timing.rest

    def judged(self, pieces: Pieces, names: tuple[str, ...]) -> tuple[Codes, Bool[np.ndarray, "limits pieces"]]:
        """Return the status of the limits `names` on pieces, and where a limit that changes is not close."""
        low, high = (_parameters(self._limited, pieces.cell, x) for x in pieces[1:])
        grid, place = pieces.of(self._limited.cells.grid), np.stack([pieces.start, pieces.end])
        bounds, rough = {}, np.zeros((len(self.index_of), pieces.cell.size), bool)
        stricter = rough.copy()  # the polynomial may be violated although the limit is satisfied
        for name in names:
            bounds[name] = bound = self._limited.bounds[name]
            if isinstance(bound, Varying):
                if bound.along.kind == "linear":
                    bounds[name], rest, rough[self.index_of[name]] = curves(bound, low, high)
                else:
                    bounds[name], rest = bound.approximated(low, high)
                    rough[self.index_of[name]] = rest > ACCURATE * np.abs(bounds[name]).max(axis=1)
                stricter[self.index_of[name]] = rest > 0
        timing = self._powers[pieces.cell], self._rest[:, pieces.cell]
        vehicle: Any = self._limited.vehicle
        if not self._on_road:
            codes = self._rows(prove(self._polynomials, grid, timing, bounds, vehicle, place).codes, bounds)
            return np.where(stricter & (codes == BROKEN), UNDECIDED, codes), rough
        found, changes = prove_on_road(self._polynomials, grid, timing, bounds, vehicle, (low, high), place)
        codes = self._rows(found, bounds)
        rough[[self.index_of[name] for name in ON_ROAD if name in bounds]] |= changes
        return np.where(stricter & (codes == BROKEN), UNDECIDED, codes), rough

    def _rows(self, codes: Codes, names: Collection[str]) -> Codes:
        """Return the statuses of some limits, in the order of `all_names` of these, in the rows of all limits."""
        codes = np.asarray(codes)
        found = np.full((len(self.index_of), codes.shape[1]), UNDECIDED, codes.dtype)
        found[[self.index_of[name] for name in all_names(names)]] = codes
        return found

    def at_steps(self, pieces: Pieces) -> Bool[np.ndarray, "limits pieces"]:
        """Return the pieces with a step or a bend of a limit that are longer than the distance is uncertain."""
        found = np.zeros((len(self.index_of), pieces.cell.size), bool)
        for name in self.changing:
            bound = self._limited.bounds[name]
            if isinstance(bound, Varying):
                on, steps = bound.on, np.sort(bound.changes())
                low, high = (on.at(_parameters(self._limited, pieces.cell, x)) for x in pieces[1:])
                near = [np.searchsorted(steps, x) for x in (low - on.uncertainty, high + on.uncertainty)]
                found[self.index_of[name]] = (near[1] > near[0]) & (high - low > SHORT * on.uncertainty)
        return found

    def violated(self, pieces: Pieces, name: str) -> bool:
        """Return whether a sample on one of the pieces violates a limit."""
        if not pieces.cell.size:
            return False
        place = pieces.start[:, None] + (pieces.end - pieces.start)[:, None] * np.linspace(0.0, 1.0, PLACES)
        usage = self._limited.usage(np.repeat(pieces.cell, PLACES), place.ravel(), (name,))
        return bool((usage > 1).any())


def _parameters(limited: Limited, cell: Int[np.ndarray, " m"], place: Float[np.ndarray, " m"]) -> np.ndarray:
    """Return the parameters of the path at fractions of moving cells."""
    knots, at = np.asarray(limited.path.timing.knots), limited.cells.columns[cell]
    return knots[at] + place * (knots[at + 1] - knots[at])


def _divided(limited: Limited, pieces: Pieces) -> Limited:
    """Return the path with the pieces as the cells of its timing, which is the same to within rounding errors."""
    path, cells = limited.path, limited.cells
    timing, count = path.timing, path.timing.coefficients.shape[0]
    parts = np.ones(count, int)
    parts[cells.columns] = np.bincount(pieces.cell, minlength=cells.columns.size)
    owner, own = np.repeat(np.arange(count), parts), np.zeros(parts.sum(), bool)
    own[np.isin(owner, cells.columns)] = True
    start, width = np.zeros(owner.size), np.ones(owner.size)
    start[own], width[own] = pieces.start, pieces.end - pieces.start
    c0, c1, c2, c3 = np.asarray(timing.coefficients)[owner].T
    shifted = [
        c0 + start * (c1 + start * (c2 + start * c3)),
        width * (c1 + start * (2 * c2 + 3 * start * c3)),
        width**2 * (c2 + 3 * start * c3),
        width**3 * c3,
    ]
    at = np.asarray(timing.knots)
    knots = np.append(at[owner] + start * np.diff(at)[owner], at[-1])
    stops = np.stack(
        [cells.stops[0][pieces.cell] & (pieces.start == 0), cells.stops[1][pieces.cell] & (pieces.end == 1)]
    )
    divided = RetimedPath(path.path, Timing(np.stack(shifted, axis=1), knots, timing.rest))
    return limited._replace(path=divided, cells=Cells(pieces.of(cells.grid), np.flatnonzero(own), stops))
