"""The spiral-helices near a path whose boundary states deviate within a box, for proofs about all of them.

Radius, azimuth and height of these paths are polynomials in the time whose coefficients are linear in the deviations: a
deviation of a velocity adds a cubic that is zero at both ends and has the slope 1 at one of them, and a deviation of an
axial position adds a cubic with slopes of zero. The coefficients of these cubics are floats, and so rational.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

from qtraj.algebra.bounded import BoundedPolynomial
from qtraj.algebra.degrees import Degrees
from qtraj.algebra.exact import ExactPolynomial
from qtraj.algebra.tensor_forms import nodes
from qtraj.design.proof.paths import polynomial_arrays, source_of
from qtraj.design.proof.sources import Derivatives, PolynomialSource, moving_derivatives, powers
from qtraj.design.robust.box import STATES, Box
from qtraj.path.spiral_helix import SpiralHelix

RADIUS, ANGLE, HEIGHT = range(3)


class Family:
    """The paths of a box. `names` are the parameters on which they depend, in the order of all arrays of deviations."""

    def __init__(self, path: SpiralHelix, box: Box):
        self.path, self.duration = path, float(np.asarray(path.duration))
        self.names = tuple(name for name in box.names if name in STATES)
        own = [np.asarray(c, float) for c in (path.radius, path.angle, path.height)]
        changes = [_changes(name, own, self.duration) for name in self.names]
        changed = [any(np.any(x[i]) for x in changes) for i in range(3)]
        sizes = [max(len(c), 4) if x else len(c) for c, x in zip(own, changed, strict=True)]
        self._own = [_padded(c, size) for c, size in zip(own, sizes, strict=True)]
        self._changes = [[_padded(c[:size], size) for c, size in zip(x, sizes, strict=True)] for x in changes]
        self._low = np.array([box.intervals[name][0] for name in self.names])
        self._high = np.array([box.intervals[name][1] for name in self.names])
        self.source: PolynomialSource = source_of([x[None] for x in _arrays(path)])

    def paths(self, deviations: Float[np.ndarray, "n p"]) -> SpiralHelix:
        """Return the paths with these deviations, as a batch."""
        parts = [
            np.broadcast_to(c, (len(deviations), len(c)))
            + sum((deviations[:, j, None] * each[i] for j, each in enumerate(self._changes)), np.zeros(len(c)))
            for i, c in enumerate(self._own)
        ]
        template = jax.tree.map(lambda x: np.broadcast_to(x, (len(deviations), *np.shape(x))), self.path)
        return eqx.tree_at(lambda p: (p.radius, p.angle, p.height), template, parts)

    def degrees(self, order: int, count: int) -> Derivatives:
        """Return the degrees of the derivatives; the first of `count` parameters are those of the paths."""
        each = [Degrees([int(np.any(c[i])) for c in self._changes] + [0] * (count - len(self.names))) for i in range(3)]
        rows = moving_derivatives(each[RADIUS], 0, each[HEIGHT], each[ANGLE], order)
        rows[0] = each[RADIUS], 0, each[HEIGHT]
        return Derivatives(rows)

    def bounded(self, order: int, degrees: Sequence[int]) -> Derivatives:
        """Return the derivatives at all nodes in floats, in the units of `source`."""
        columns = np.array(list(product(*(nodes(d) for d in degrees))), float).T
        deviations = self._low[:, None] + (self._high - self._low)[:, None] * columns[: len(self.names)]
        largest = np.maximum(np.abs(self._low), np.abs(self._high))
        length = self.source.length[0]

        def coefficients(i: int, relative: bool) -> BoundedPolynomial:
            own = self._own[i].copy()
            if relative:
                own[0] = 0.0
            c = np.repeat(own[:, None], columns.shape[1], axis=1)
            m = np.repeat(np.abs(own)[:, None], columns.shape[1], axis=1)
            for j, each in enumerate(self._changes):
                c = c + each[i][:, None] * deviations[j]
                m = m + np.abs(each[i])[:, None] * (3.0 * largest[j])  # also covers the rounding of the deviation
            unit = powers(np.full(columns.shape[1], self.duration), len(own)) / (1.0 if i == ANGLE else length)
            return BoundedPolynomial(c * unit, m * unit, k=2 * len(own) + 2 * len(self.names) + 8)

        x, angle, z = coefficients(RADIUS, False), coefficients(ANGLE, True), coefficients(HEIGHT, True)
        rows = self._signed(moving_derivatives(x, 0, z, angle, order))
        sign, origin = self._vertical()
        z = coefficients(HEIGHT, False)
        height = BoundedPolynomial.constant(np.full(columns.shape[1], origin / length), k=1) + (z if sign > 0 else -z)
        rows[0] = x, 0, height
        return Derivatives(rows)

    def exact(self, order: int, fractions: Sequence[Any]) -> Derivatives:
        """Return the derivatives of the path at one node as exact polynomials in the time, in metres."""
        deviations = [
            ExactPolynomial.of(low) + (ExactPolynomial.of(high) - ExactPolynomial.of(low)) * ExactPolynomial.of(s)
            for low, high, s in zip(self._low, self._high, fractions, strict=False)
        ]

        def coefficients(i: int) -> ExactPolynomial:
            own = ExactPolynomial.from_floats(self._own[i])
            for x, each in zip(deviations, self._changes, strict=True):
                if np.any(each[i]):
                    own = own + ExactPolynomial.from_floats(each[i]) * x
            return own

        x, angle, z = coefficients(RADIUS), coefficients(ANGLE), coefficients(HEIGHT)
        rows = self._signed(moving_derivatives(x, 0, z, angle, order))
        sign, origin = self._vertical()
        rows[0] = x, 0, (z if sign > 0 else -z) + origin
        return Derivatives(rows, span=self.duration)

    def _signed(self, rows: list[Any]) -> list[Any]:
        """Return the derivatives with the third axis upwards."""
        if self._vertical()[0] > 0:
            return rows
        return [None, *((r[0], -r[1], -r[2]) for r in rows[1:])]

    def _vertical(self) -> tuple[float, float]:
        """Return 1, or -1 if the axis points down, and the height of the origin [m]."""
        vertical, placement = self.source.vertical, self.path.placement
        origin = 0.0 if placement is None else float(np.asarray(placement.origin)[2])
        return (1.0 if vertical is None or vertical[0, 2] > 0 else -1.0), origin


def _arrays(path: SpiralHelix) -> Sequence[np.ndarray]:
    found = polynomial_arrays(path)
    if found is None:
        raise ValueError("the path is not polynomial: pass a SpiralHelix")
    return [np.asarray(x, float) for x in found]


def _padded(c: np.ndarray, size: int) -> np.ndarray:
    return np.concatenate([c, np.zeros(size - len(c))])


def _changes(name: str, own: list[np.ndarray], duration: float) -> list[np.ndarray]:
    """Return the changes of the coefficients of radius, azimuth and height per unit of a deviation."""
    end, kind = name.split("_", 1)
    at = 0.0 if end == "start" else duration
    T = duration
    slope = [0.0, 1.0, -2.0 / T, 1.0 / T**2] if end == "start" else [0.0, 0.0, -1.0 / T, 1.0 / T**2]
    value = [1.0, 0.0, -3.0 / T**2, 2.0 / T**3] if end == "start" else [0.0, 0.0, 3.0 / T**2, -2.0 / T**3]
    radius, *_ = each = [np.polynomial.Polynomial(c) for c in own]
    radial, rate, axial = (float(p.deriv()(at)) for p in each)
    speed = float(np.sqrt(radial**2 + (float(radius(at)) * rate) ** 2 + axial**2))
    if kind == "speed" and not speed > 0:
        raise ValueError(f"{name} needs a velocity that is not zero at the {end}: pass the radial or the axial speed")
    amounts = {
        "speed": (radial, rate, axial) if not speed else (radial / speed, rate / speed, axial / speed),
        "radial_speed": (1.0, 0.0, 0.0),
        "axial_speed": (0.0, 0.0, 1.0),
        "axial_position": (0.0, 0.0, 1.0),
    }[kind]
    shape = value if kind == "axial_position" else slope
    return [amount * np.array(shape) for amount in amounts]
