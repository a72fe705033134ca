"""Limits that change along the way, as functions of the parameter of one path.

In each cell of a timing, such a limit is replaced by a line that is nowhere less strict: a constant for steps, and for
linear values nearly the values themselves. The distance along a polynomial path differs from its chord by less than a
bound. Searches impose these lines, and so do proofs with steps; those with linear values use polynomials, which are
closer to the limit (`limit_curves`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from qtraj.design.along import Along, Variable
from qtraj.design.ellipse import OfSpeed
from qtraj.design.margins import at_speed
from qtraj.path.chords import chord_gaps
from qtraj.path.distances import Distances, distances
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.quantity import quantity

ROUNDING = 2.0**-50
"""Fraction of linear values that exceeds the rounding errors of their interpolation."""

AT_ENDS = 4
"""A linear limit that bends closer to an end of a cell than this multiple of the uncertainty bends at the end."""

Parameters = Float[np.ndarray, "*n"]


class Varying:
    """A limit that changes along one path; `side` is −1 for a lower bound, and otherwise 1."""

    def __init__(self, along: Along, on: Distances, side: int):
        self.along, self.on, self.side = along, on, side

    @property
    def values(self) -> Float[np.ndarray, " steps"]:
        """All values on the path; infinite where there is no limit."""
        return np.asarray(self.along.values, float)[: self.starts.size]

    @property
    def starts(self) -> Float[np.ndarray, " steps"]:
        """The distances at which the values on the path start [m]; a value that starts at its end is not among them."""
        d = np.asarray(self.along.distance, float)
        return d[: max(1, np.searchsorted(d, self.on.length - self.on.uncertainty))]

    @property
    def strictest(self) -> Any:
        """The strictest value on the whole path."""
        return self.side * np.min(self.side * self.values)

    def scaled(self, factor: float) -> Varying:
        """Return the limit multiplied by `factor`."""
        return Varying(self.along.scaled(factor), self.on, self.side)

    def lines(self, low: Parameters, high: Parameters) -> Float[np.ndarray, "n 2"]:
        """Return the values at both ends of lines between parameters of the path that are nowhere less strict."""
        return self.approximated(low, high)[0]

    def approximated(
        self, low: Parameters, high: Parameters
    ) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, " n"]]:
        """Return the `lines`, and by how much each of them is stricter than the limit, at most."""
        first, last, error = self.on.at(low), self.on.at(high), self.on.uncertainty
        strictest = np.asarray(self.along.strictest(first - error, last + error, self.side))
        constant = np.stack([strictest, strictest], axis=1)
        loosest = np.asarray(self.along.strictest(first - error, last + error, -self.side))
        differs = loosest != strictest  # both may be infinite
        span = np.where(differs, self.side * (loosest - np.where(differs, strictest, 0.0)), 0.0)
        if self.along.kind == "step":
            return constant, span
        d = np.asarray(self.along.distance)
        inside = AT_ENDS * error
        ends = self.side * np.stack([self.along.at(first), self.along.at(last)], axis=1)
        slope = self.steepest(first, last)
        gap = np.where(slope > 0, chord_gaps(self.on, low, high), 0.0) * slope
        above = gap + 2 * inside * slope + np.where(slope > 0, ROUNDING * np.abs(ends).max(axis=1), 0.0)
        shifted = ends - above[:, None]
        bends = np.searchsorted(d, first + inside) < np.searchsorted(d, last - inside)
        # The sign of a line is constant, because claims may contain its square.
        worse = ~(shifted.sum(axis=1) > 2 * self.side * strictest) | (shifted[:, 0] * shifted[:, 1] <= 0)
        chosen = bends | worse
        found = np.where(chosen[:, None], self.side * constant, shifted)
        rest = np.where(chosen, span, above + gap)
        return self.side * found, rest

    def steepest(self, first: np.ndarray, last: np.ndarray) -> Float[np.ndarray, " n"]:
        """Return the largest slope of the linear pieces in intervals of the distance and close to their ends."""
        inside = AT_ENDS * self.on.uncertainty
        d, values = np.asarray(self.along.distance, float), np.asarray(self.along.values, float)
        slopes = np.append(np.abs(np.diff(values) / np.diff(d)), [0.0, 0.0])
        ends = np.stack([first - inside, last + inside], axis=1)
        pieces = np.maximum(np.searchsorted(d, ends, side="right") + np.array([-1, 0]), [0, 1])
        return np.maximum.reduceat(slopes, pieces.ravel())[::2]

    def at(self, u: Parameters) -> Parameters:
        """Return the values at parameters of the path; where the value changes, the later one."""
        return np.asarray(self.along.at(self.on.at(np.ravel(u)))).reshape(np.shape(u))

    def changes(self) -> Float[np.ndarray, " m"]:
        """Return the distances [m] at which a step or a linear piece ends, on the path."""
        return self.starts[1:]


Bounds = Mapping[str, Any]
"""Limits by name: numbers, or `Varying`."""


def on_path(bounds: Bounds, path: AbstractHodograph) -> dict[str, Any]:
    """Return the limits on a path with concrete values; each `Along` becomes a `Varying`."""
    changing = [name for name, x in bounds.items() if isinstance(x, Along)]
    if not changing:
        return dict(bounds)
    on = distances(path)
    return {name: Varying(x, on, quantity(name).side) if name in changing else x for name, x in bounds.items()}


def varies(bounds: Bounds) -> bool:
    """Return whether a limit changes along the way."""
    return any(isinstance(x, Varying) for x in bounds.values())


def in_cells(bounds: Bounds, low: Any, high: Any) -> dict[str, Any]:
    """Return the limits with the lines (cells, 2) between parameters of the path in the place of each `Varying`."""
    return {
        name: x.lines(np.asarray(low), np.asarray(high)) if isinstance(x, Varying) else x for name, x in bounds.items()
    }


def at_places(bounds: Bounds, cell: Any, place: Any) -> dict[str, Any]:
    """Return limits `in_cells` at the fraction `place` of each `cell`."""
    lines = {name: x[cell] if np.ndim(x) else None for name, x in bounds.items()}
    return {
        name: x if (line := lines[name]) is None else line[..., 0] + place * _rise(line) for name, x in bounds.items()
    }


def _rise(line: Any) -> Any:
    """Return the difference of the ends; a line may be infinite."""
    return np.where(
        line[..., 0] == line[..., 1], 0.0, line[..., 1] - np.where(np.isinf(line[..., 0]), 0.0, line[..., 0])
    )


def table(
    bounds: Bounds, names: tuple[str, ...], knots: Any, speeds: Callable[[], Float[np.ndarray, "cells 2"]]
) -> Float[np.ndarray, "limits cells"] | None:
    """Return the strictest limits at the ends of the cells between the `knots`, or None if all limits are constant.

    `speeds` returns the speeds at the ends of the cells, for limits that depend on the speed.
    """
    by_speed = any(isinstance(x, OfSpeed) for x in bounds.values())
    if not varies(bounds) and not by_speed:
        return None
    ends, at = np.asarray(knots), speeds() if by_speed else None
    found = in_cells(bounds, ends[:-1], ends[1:])
    rows = [np.asarray(at_speed(found[name], at)) if by_speed else found[name] for name in names]
    sides = [quantity(name).side for name in names]
    rows = [side * np.min(side * x, axis=1) if np.ndim(x) else x for x, side in zip(rows, sides, strict=True)]
    return np.stack([np.broadcast_to(x, ends.size - 1) for x in rows])


def strictest(bounds: Bounds) -> dict[str, Any]:
    """Return the limits with the strictest values on the whole path and at all speeds."""
    return {name: _strictest(x, quantity(name).side) for name, x in bounds.items()}


def _strictest(bound: Any, side: int) -> Any:
    if isinstance(bound, OfSpeed):
        return np.asarray(side * np.min(side * np.asarray(bound.values)))
    return bound.strictest if isinstance(bound, Varying) else bound


def all_values(bound: Any) -> Any:
    """Return the value, or all finite values, of a limit."""
    if not isinstance(bound, Varying | Variable):
        return bound
    values: Any = bound.values  # pyright: ignore[reportAttributeAccessIssue]
    return np.asarray(values)[np.isfinite(values)]
