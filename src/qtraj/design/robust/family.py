"""Paths near one path whose boundary states deviate within a box, for proofs about all of them.

Their coordinates are polynomials in the time whose coefficients are linear in the deviations: each deviation adds a
polynomial that changes one component of a state at one end. The coefficients of these polynomials are floats, and so
rational. `family_of_path` contains the families of spiral-helices, `family_of_segment` those of segments of routes.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any, NamedTuple, Protocol

import numpy as np
from jaxtyping import Float

from qtraj.algebra.bounded import BoundedPolynomial
from qtraj.algebra.degrees import Degrees
from qtraj.algebra.exact import ExactPolynomial
from qtraj.algebra.tensor_forms import nodes
from qtraj.design.limits import Limits
from qtraj.design.proof.sources import Derivatives, PolynomialSource, moving_derivatives, powers
from qtraj.design.robust.box import Box

X, Y, Z, ANGLE = range(4)
"""The coordinates: the path is R_z(angle)·(x, y, z)."""

Coefficients = list[np.ndarray | None]
"""The coefficients of the coordinates, which are None for a coordinate that is always zero."""


class Certified(Protocol):
    """A function that returns the times and the worst values (n, k) of limited quantities along n paths."""

    def __call__(
        self, deviations: Float[np.ndarray, "n p"], limits: Limits, vehicles: Float[np.ndarray, "n 2"] | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return times [s] and values for deviations of the states and, unless None, of the vehicle."""
        ...


class Coordinates(NamedTuple):
    """The coordinates of a path, and their changes for each deviation.

    `sign`: −1 if the third axis points down. `origin`: the height [m] of the origin.
    """

    own: Coefficients
    changes: list[Coefficients]
    sign: float = 1.0
    origin: float = 0.0


class Family:
    """The paths of a box. `names` are the parameters on which they depend, in the order of all arrays of deviations.

    `source` and `duration` are those of the path without deviations; `certified` computes values along the paths.
    """

    def __init__(
        self,
        names: Sequence[str],
        coordinates: Coordinates,
        source: PolynomialSource,
        box: Box,
        certified: Certified,
    ):
        self.names, self.source, self.certified = tuple(names), source, certified
        self.duration = float(np.asarray(source.duration[0]))
        own, changes = coordinates.own, coordinates.changes
        self._sign, self._origin = coordinates.sign, coordinates.origin
        sizes = [max(1, *(_terms(c) for c in column)) for column in zip(own, *changes, strict=True)]
        self._own = [None if c is None else _padded(c, size) for c, size in zip(own, sizes, strict=True)]
        self._changes = [[_padded(c, size) for c, size in zip(x, sizes, strict=True)] for x in changes]
        self._low = np.array([box.intervals[name][0] for name in self.names])
        self._high = np.array([box.intervals[name][1] for name in self.names])

    def coefficients(self, deviations: Float[np.ndarray, "n p"]) -> Coefficients:
        """Return the coefficients (n, terms) of the coordinates with these deviations."""
        return [
            None
            if c is None
            else np.broadcast_to(c, (len(deviations), len(c)))
            + sum((deviations[:, j, None] * each[i] for j, each in enumerate(self._changes)), np.zeros(len(c)))
            for i, c in enumerate(self._own)
        ]

    def degrees(self, order: int, count: int) -> Derivatives:
        """Return the degrees of the derivatives; the first of `count` parameters are those of the paths."""
        return self._derivatives(
            order,
            lambda i, relative: Degrees([int(np.any(c[i])) for c in self._changes] + [0] * (count - len(self.names))),
            lambda x: 0,
        )

    def bounded(self, order: int, degrees: Sequence[int]) -> Derivatives:
        """Return the derivatives at all nodes in floats, in the units of `source`."""
        columns = np.array(list(product(*(nodes(d) for d in degrees))), float).T
        count, length = columns.shape[1], self.source.length[0]
        deviations = self._low[:, None] + (self._high - self._low)[:, None] * columns[: len(self.names)]
        largest = np.maximum(np.abs(self._low), np.abs(self._high))

        def coordinate(i: int, relative: bool) -> BoundedPolynomial:
            own: Any = np.array(self._own[i])
            if relative:
                own[0] = 0.0
            c = np.repeat(own[:, None], count, axis=1)
            m = np.repeat(np.abs(own)[:, None], count, axis=1)
            for j, each in enumerate(self._changes):
                c = c + each[i][:, None] * deviations[j]
                m = m + np.abs(each[i])[:, None] * (3.0 * largest[j])  # also covers the rounding of the deviation
            unit = powers(np.full(count, self.duration), len(own)) / (1.0 if i == ANGLE else length)
            return BoundedPolynomial(c * unit, m * unit, k=2 * len(own) + 2 * len(self.names) + 8)

        return self._derivatives(
            order, coordinate, lambda x: BoundedPolynomial.constant(np.full(count, x / length), k=1)
        )

    def exact(self, order: int, fractions: Sequence[Any]) -> Derivatives:
        """Return the derivatives of the path at one node as exact polynomials in the time, in metres."""
        deviations = [
            ExactPolynomial.of(low) + (ExactPolynomial.of(high) - ExactPolynomial.of(low)) * ExactPolynomial.of(s)
            for low, high, s in zip(self._low, self._high, fractions, strict=False)
        ]

        def coordinate(i: int, relative: bool) -> ExactPolynomial:
            own = ExactPolynomial.from_floats(np.asarray(self._own[i]))
            for x, each in zip(deviations, self._changes, strict=True):
                if np.any(each[i]):
                    own = own + ExactPolynomial.from_floats(each[i]) * x
            return own

        return self._derivatives(order, coordinate, ExactPolynomial.of)._replace(span=self.duration)

    def _derivatives(self, order: int, coordinate: Any, constant: Any) -> Derivatives:
        """Return the derivatives with the third axis upwards, and the position, of which only the height is right.

        `coordinate` returns the coordinate i as a polynomial, without its constant term if that is not needed, and
        `constant` converts a length [m].
        """

        def of(i: int, relative: bool) -> Any:
            return 0 if self._own[i] is None else coordinate(i, relative)

        turns = self._own[ANGLE] is not None
        x, y = of(X, not turns), of(Y, not turns)
        rows = moving_derivatives(x, y, of(Z, True), of(ANGLE, True), order)
        height = of(Z, False)
        if self._sign < 0:
            rows = [None, *((r[0], -r[1], -r[2]) for r in rows[1:])]
            height = -height
        rows[0] = x, y, height + constant(self._origin)
        return Derivatives(rows)


def _terms(c: np.ndarray | None) -> int:
    """Return the number of coefficients without trailing zeros."""
    return 0 if c is None or not c.any() else int(np.flatnonzero(c)[-1]) + 1


def _padded(c: np.ndarray | None, size: int) -> np.ndarray:
    found = np.zeros(size)
    if c is not None:
        found[: _terms(c)] = c[: _terms(c)]
    return found
