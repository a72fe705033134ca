"""The polynomials of a path and its timing in the cells of the timing: in exact integers, and in bounded floats.

The variable is the position x in a cell, 0 ≤ x ≤ 1. Let h be the duration of a segment, and let the cell be the part
from `first` to `first` + `half` of the segment, in units of h. Then the unit of time of the formulas is h·`half`, in
which the rate of x is √a.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from qtraj.algebra.bounded import BoundedPolynomial
from qtraj.algebra.exact import ExactPolynomial
from qtraj.design.proof.sources import moving_derivatives, powers
from qtraj.design.timing.directions import Direction

Columns = Float[Any, "terms n"]
PerCell = Float[Any, " n"]


class Motion(NamedTuple):
    """Polynomials in x: the derivatives r', … of the path, and those of a = u̇², as far as the formulas need them.

    r' = `factor`·q, and `ahead` contains q and its derivatives. Without a stop, q is r', and `factor` is the integer 1.
    `rest` is a, divided by its factor x or 1 − x at an end at rest.
    """

    path: list[Any]
    ahead: list[Any]
    factor: Any
    a: Any
    slope: Any
    bend: Any
    rest: Any


class CellMotions(NamedTuple):
    """Motions in n cells: the coefficients of the path's segments, and the timing in each cell.

    `position` contains the coefficients of x, y, z and of the angle of the moving basis (see `proof.sources`); y and
    the angle may be None. `segment` (n,) are the keys of `directions`, which contains the segments that start or end
    at a stop. `rest` (2, n) is whether a = u̇² is zero at the start and at the end of the cell. The motions may be those
    in parts of cells: then `place` (2, n) are the start and the end of each part as fractions of its cell, to which
    `timing` and `rest` belong, while `first` and `half` are those of the part.
    """

    position: tuple[Columns | None, ...]
    duration: PerCell
    first: PerCell
    half: PerCell
    timing: Float[Any, "4 n"]
    rest: Bool[Any, "2 n"]
    segment: Int[Any, " n"]
    directions: dict[int, Direction]
    place: Float[Any, "2 n"] | None = None

    def chosen(self, which: np.ndarray) -> CellMotions:
        """Return the motions in some cells."""
        position = tuple(None if c is None else c[:, which] for c in self.position)
        place = None if self.place is None else self.place[:, which]
        chosen: list[Any] = [position, *(x[..., which] for x in self[1:7]), self.directions, place]
        return CellMotions(*chosen)

    @property
    def standing(self) -> Bool[Any, " n"]:
        """Whether a cell is part of a segment that starts or ends at a stop."""
        return np.isin(self.segment, list(self.directions))

    def bounded(self, order: int) -> Motion:
        """Return the motions in all cells; either all cells or none of them must be `standing`."""
        place = BoundedPolynomial(np.stack([self.first, self.half]))
        half = BoundedPolynomial.constant(self.half)
        c1, c2, c3 = self.timing[1:]
        before_end = np.stack([-(c1 + c2 + c3), -(c2 + c3), -c3, 0 * c3])
        after_start = np.stack([c1, c2, c3, 0 * c3])
        rest = np.where(self.rest[0], after_start, np.where(self.rest[1], before_end, self.timing))
        timing = BoundedPolynomial(self.timing), BoundedPolynomial(rest, k=3)
        if self.place is not None:
            timing = timing[0].restricted(*self.place), timing[1].restricted(*self.place)
        if not self.directions or self.segment[0] not in self.directions:

            def of_cells(c: Columns) -> BoundedPolynomial:
                scaled = c * powers(self.duration, len(c))
                return BoundedPolynomial(scaled, k=2 * len(c) + 2).composed(place)

            return _motion(_derivatives(self.position, of_cells, order), None, timing)
        own = [self.directions[k] for k in self.segment.tolist()]
        columns = [_stacked([x.direction[axis] for x in own]) for axis in range(3)]
        q = tuple(BoundedPolynomial(c, k=1).composed(place) for c in columns)
        factor = BoundedPolynomial(_stacked([x.factor for x in own])).composed(place) * half
        return _motion(_slopes(tuple(factor * p for p in q), order), (_slopes(q, order), factor), timing)

    def exact(self, k: int, order: int) -> Motion:
        """Return the motion in cell k."""
        place = ExactPolynomial.from_floats([self.first[k], self.half[k]])
        c = [ExactPolynomial.of(x) for x in self.timing[:, k]]
        x, timing = ExactPolynomial([0, 1]), ExactPolynomial.from_floats(self.timing[:, k])
        before_end = -1 * (c[1] + c[2] + c[3]) - (c[2] + c[3]) * x - c[3] * x * x
        rest = timing.divided_by_power(1) if self.rest[0, k] else before_end if self.rest[1, k] else timing
        if self.place is not None:
            timing, rest = (p.restricted(*self.place[:, k]) for p in (timing, rest))
        own = self.directions.get(int(self.segment[k]))
        if own is None:

            def of_cell(c: Columns) -> ExactPolynomial:
                return ExactPolynomial.from_floats(c[:, k]).substituted(float(self.duration[k])).composed(place)

            return _motion(_derivatives(self.position, of_cell, order), None, (timing, rest))
        q = tuple(p.composed(place) for p in own.direction)
        factor = own.factor.composed(place) * ExactPolynomial.of(self.half[k])
        return _motion(_slopes(tuple(factor * p for p in q), order), (_slopes(q, order), factor), (timing, rest))


def _motion(path: list[Any], ahead: tuple[list[Any], Any] | None, timing: tuple[Any, Any]) -> Motion:
    a, rest = timing
    q, factor = (path, 1) if ahead is None else ahead
    return Motion(path, q, factor, a, a.derivative(), a.derivative().derivative(), rest)


def _derivatives(position: tuple[Any, ...], of_cell: Callable[[Columns], Any], order: int) -> list[Any]:
    """Return the derivatives of the path up to `order` with respect to x."""
    x, y, z, angle = (0 if c is None else of_cell(c) for c in position)
    return moving_derivatives(x, y, z, angle, order)[1:]


def _slopes(vector: tuple[Any, ...], order: int) -> list[Any]:
    """Return a vector and its derivatives; the vector is the derivative of order 1."""
    rows = [vector]
    for _ in range(order - 1):
        rows.append(tuple(p.derivative() for p in rows[-1]))
    return rows


def _stacked(polynomials: list[ExactPolynomial]) -> Columns:
    """Return the coefficients of polynomials in floats, as columns of equal length."""
    columns = {id(p): p.floats() for p in polynomials}
    result = np.zeros((max(map(len, columns.values())), len(polynomials)))
    for k, p in enumerate(polynomials):
        result[: len(columns[id(p)]), k] = columns[id(p)]
    return result
