"""Parts of a path that are polynomials in world axes, or nearly so, with the directions of the body's frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from qtraj.algebra.exact import ExactPolynomial
from qtraj.design.obstacles.place import Place, Vector, placed


class Piece(NamedTuple):
    """A part of a path: its position [m] and a vector in the direction of travel, as exact polynomials on [0, 1].

    The direction is None if the part is a standstill of unknown direction. The `time` [s] is a polynomial, too.
    The position is exact up to `error` [m], and the unit vectors forwards, to the left and upwards up to `tilt`, each;
    None means that no bound is known. `sign` is −1 in reverse. `report` converts fractions (k,) to times [s].
    """

    position: Vector
    direction: Vector | None
    time: ExactPolynomial
    report: Callable[[np.ndarray], np.ndarray]
    error: Fraction = Fraction(0)
    tilt: Fraction | None = Fraction(0)
    sign: int = 1

    def knows(self, offset: Sequence[float]) -> bool:
        """Return whether the axes of an offset are known; they are not at a standstill or on a vertical path."""
        if self.direction is None:
            return False
        x, y, z = (not p.is_zero for p in self.direction)
        return x or y or (z and not (offset[1] or offset[2]))

    def place(self, offset: Sequence[float], near: Any, near_times: Any) -> Place:
        """Return the centre of a ball; `near` (k, 3) are centres in floats at the times `near_times` (k,)."""
        own = placed(
            self.position,
            self.time,
            self.direction if self.knows(offset) else None,
            [self.sign * offset[0], self.sign * offset[1], offset[2]],
        )
        return own._replace(near=near, near_times=near_times)

    def uncertainty(self, offset: Sequence[float]) -> Fraction | None:
        """Return a bound on the error of the centre [m]; None if it is not known."""
        if not any(offset):
            return self.error
        if not self.knows(offset):  # but the distance from the position is known
            return self.error + sum((abs(Fraction(x)) for x in offset), Fraction(0))
        if self.tilt is None:
            return None
        return self.error + self.tilt * sum((abs(Fraction(x)) for x in offset), Fraction(0))

    def between(self, start: float, end: float) -> Piece:
        """Return the part between two dyadic fractions."""
        cut = lambda v: [p.restricted(start, end) for p in v]  # noqa: E731
        report = lambda u, own=self.report: own(start + (end - start) * u)  # noqa: E731
        return self._replace(
            position=cut(self.position),
            direction=None if self.direction is None else cut(self.direction),
            time=self.time.restricted(start, end),
            report=report,
        )


def floats(pieces: Sequence[Vector]) -> np.ndarray:
    """Return the coefficients (terms, n, 3) of n vectors of polynomials in floats."""
    columns = [[p.floats() for p in v] for v in pieces]
    found = np.zeros((max(len(c) for v in columns for c in v), len(pieces), 3))
    for k, v in enumerate(columns):
        for axis, c in enumerate(v):
            found[: len(c), k, axis] = c
    return found
