"""The frame of a vehicle on a route: upright, constant at a stop, and opposite to the velocity in reverse.

A path has no tangent where its speed is zero, and the tangent changes its sign where a vehicle starts to reverse. So
below a speed threshold, heading and pitch are polynomials: from their values and rates before the stop to constants,
and from these constants to their values and rates after the stop. If the direction of the path changes by more than 90°
over the stop, the vehicle drives in reverse, and its forward axis is opposite to the tangent.
"""

import dataclasses
from itertools import pairwise
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from qtraj.algebra.polynomial import evaluate
from qtraj.foundation.arrays import as_float, real_scalar, real_vector
from qtraj.foundation.document import storable
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Scalar, Vec3
from qtraj.path import pieces
from qtraj.path.frame_axes import UPRIGHT
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.route import Route
from qtraj.path.stops import Segments, fastest, stops
from qtraj.path.trihedral import AbstractFrame, Natural, Trihedral, Upright

STOP_SPEED = 0.01
"""Default threshold of a stop, relative to the largest speed."""

ZERO_SPEED = 1e-9
"""Relative to the largest speed: below it, rounding errors determine the direction of the velocity."""

SETTLING = 1.0
"""[s] At a long stop, heading and pitch come to rest within this time, and move again this long before its end."""


@storable
class Driving(AbstractFrame):
    """The upright frame of a vehicle on a route with stops and reversals; made by `Driving.along(route)`.

    It equals `Upright` while the vehicle moves forwards; in reverse, x is opposite to the velocity. At a stop, heading
    and pitch continue from the last direction to the next one, with continuous first and second derivatives, and
    `defined` is true, although the path has no tangent.

    Each row is an interval of time: `starts` (rows,) [s] are the start times; `signs` (rows,) are 1 forwards, −1 in
    reverse and 0 at a stop; `angles` (rows, 2, 6) are, at a stop, the ascending coefficients of heading and pitch [rad]
    in the time since the start of the row. Rows are padded with infinite start times.
    """

    starts: Float[Array, " rows"]
    signs: Float[Array, " rows"]
    angles: Float[Array, "rows 2 6"]
    up: Vec3

    def __repr__(self) -> str:
        return shown(self, starts="s", angles="rad")

    def __init__(self, starts: ArrayInput, signs: ArrayInput, angles: ArrayInput, up: ArrayInput = (0.0, 0.0, 1.0)):
        self.starts, self.signs, self.angles = as_float(starts), as_float(signs), as_float(angles)
        self.up = real_vector(up, "the up direction of a driving frame", 3)
        rows = self.starts.shape[-1:]
        if self.signs.shape[-1:] != rows or self.angles.shape[-3:] != (*rows, 2, 6):
            raise ValueError(
                f"a driving frame with starts of shape {rows} needs signs of shape {rows} and angles of shape "
                f"{(*rows, 2, 6)}, but {self.signs.shape} and {self.angles.shape} were given. Use Driving.along(route)."
            )

    @property
    def name(self) -> str:
        """'upright', since the axes are those of the upright frame."""
        return UPRIGHT

    @classmethod
    def along(cls, route: Route, up: ArrayInput = (0.0, 0.0, 1.0), hold_below: ArrayInput | None = None) -> "Driving":
        """The frame of a vehicle that drives along `route`, initially forwards.

        `hold_below` [m/s]: the speed below which the heading is held; by default 1 % of the largest speed.

        **Raises:** ValueError unless `route` is one concrete `Route`, `up` is not zero, and `hold_below` is positive.
        """
        segments = segments_of(route)
        threshold = STOP_SPEED * fastest(segments)
        if hold_below is not None:
            threshold = float(np.asarray(real_scalar(hold_below, "hold_below")))
            if not 0 < threshold < np.inf:
                raise ValueError(f"hold_below must be positive [m/s], but {threshold} was given")
        upright = Upright(up)
        basis = _basis(np.asarray(upright.unit_up(route.duration.dtype), float))
        end = float(segments.starts[-1] + segments.durations[-1])
        rows = _rows(segments, stops(segments, threshold), end, basis)
        n_padding = pieces.padded_size(len(rows)) - len(rows)
        starts = [row.start for row in rows] + [np.inf] * n_padding
        signs = [row.sign for row in rows] + [0.0] * n_padding
        return cls(starts, signs, np.stack([row.angles for row in rows] + [np.zeros((2, 6))] * n_padding), upright.up)

    def trihedral(self, r: Float[Array, "5 3"], duration: Scalar) -> Trihedral:
        """The upright trihedral from position and four derivatives."""
        return Upright(self.up).trihedral(r, duration)

    def at(self, t: Scalar, r: Float[Array, "5 3"], duration: Scalar) -> Trihedral:
        """The trihedral at one instant `t` [s]: upright, opposite to the tangent in reverse, held at a stop."""
        i = jnp.maximum(jnp.searchsorted(self.starts, t.astype(self.starts.dtype), side="right") - 1, 0)
        sign = self.signs[i].astype(r.dtype)
        held = self._held(t.astype(r.dtype), self.starts[i].astype(r.dtype), self.angles[i].astype(r.dtype))
        derivatives = jnp.where(sign == 0, held, sign * r.at[0].set(0.0))
        frame, path = self.trihedral(derivatives, duration), self.trihedral(r, duration)
        return dataclasses.replace(frame, speed=path.speed, curvature=path.curvature, torsion=path.torsion)

    def _held(self, t: Scalar, start: Scalar, angles: Float[Array, "2 6"]) -> Float[Array, "5 3"]:
        """Derivatives of a path that moves at unit speed in the held direction."""
        up = Upright(self.up).unit_up(t.dtype)
        level = _level(up)
        elapsed = jnp.where(jnp.isfinite(start), t - start, 0.0)

        def forward(s: Scalar) -> Vec3:
            heading, pitch = evaluate(angles[0], s), evaluate(angles[1], s)
            horizontal = jnp.cos(heading) * level + jnp.sin(heading) * jnp.cross(up, level)
            return jnp.cos(pitch) * horizontal + jnp.sin(pitch) * up

        with_rate = lambda s: jax.jvp(forward, (s,), (jnp.ones_like(s),))  # noqa: E731
        (d, d1), (_, d2) = jax.jvp(with_rate, (elapsed,), (jnp.ones_like(elapsed),))
        zero = jnp.zeros_like(d)
        return jnp.stack([zero, d, d1, d2, zero])


def default_frame(path: AbstractHodograph) -> AbstractFrame:
    """The default frame of a path: `Driving` for a route that stops, `Upright` for other routes, else `Natural`.

    For traced routes and batches of routes it is always `Upright`.
    """
    if not isinstance(path, Route):
        return Natural()
    if not _is_single_concrete(path):
        return Upright()
    frame = Driving.along(path)
    return frame if np.any(np.asarray(frame.signs)[np.isfinite(np.asarray(frame.starts))] <= 0) else Upright()


def _is_single_concrete(route: Route) -> bool:
    """Whether this is one route, not a batch, outside a trace."""
    return route.duration.ndim == 0 and not any(isinstance(x, Tracer) for x in jax.tree.leaves(route))


def require_moving(path: AbstractHodograph) -> None:
    """Raise a ValueError for a concrete route that stops, where it has no tangent."""
    if not isinstance(path, Route) or not _is_single_concrete(path):
        return
    segments = segments_of(path)
    stop_intervals = stops(segments, ZERO_SPEED * fastest(segments))
    if stop_intervals:
        raise ValueError(
            f"the route stops at t = {stop_intervals[0][0]:.4g} s, where it has no tangent, so a rotation-minimizing "
            "frame is not defined there. Use route.window(t0, t1) between stops, or the frame Driving.along(route)."
        )


def segments_of(route: Route) -> Segments:
    """The segments of one route in float64, without the padding.

    **Raises:** ValueError for another kind of path, a batch of routes, or inside a trace.
    """
    if not isinstance(route, Route) or route.duration.ndim:
        kind = "a batch of routes" if isinstance(route, Route) else type(route).__name__
        raise ValueError(f"one Route was expected, but {kind} was given")
    count = route.segments
    starts, c = (np.asarray(x, float)[:count] for x in (route.starts, route.coefficients))
    return Segments(starts, c, np.diff(np.asarray(route.times, float)))


class _Row(NamedTuple):
    """One interval of the frame, as in `Driving`."""

    start: float
    sign: float
    angles: np.ndarray


def _rows(segments: Segments, intervals: list[tuple[float, float]], end: float, basis: np.ndarray) -> list[_Row]:
    """The rows of a frame with stops in these `intervals`."""
    zero, sign = np.zeros((2, 6)), 1.0
    rows = [] if intervals and intervals[0][0] <= 0 else [_Row(0.0, sign, zero)]
    for a, b in intervals:
        before = None if a <= 0 else _angles(segments, a, "left", sign, basis)
        after = None if b >= end else _angles(segments, b, "right", sign, basis)
        if before is not None and after is not None:
            change = _wrapped(after[0, 0] - before[0, 0])
            if abs(change) > np.pi / 2:
                sign = -sign
                after = _angles(segments, b, "right", sign, basis)
                change = _wrapped(after[0, 0] - before[0, 0])
            after[0, 0] = before[0, 0] + change
        rows += _held_rows(a, b, before, after)
        if after is not None:
            rows.append(_Row(b, sign, zero))
    return rows


def _wrapped(angle: float) -> float:
    """An angle in [−π, π)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def _held_rows(a: float, b: float, before: np.ndarray | None, after: np.ndarray | None) -> list[_Row]:
    """Rows of a stop from `a` to `b`: quintics in heading and pitch to rest, constants, and quintics from rest."""
    if before is None and after is None:
        return [_Row(a, 0.0, np.zeros((2, 6)))]
    settling = min((b - a) / 3, SETTLING)
    first = None if before is None else _at_rest(before, 0.5 * settling)
    last = first if after is None else _at_rest(after, -0.5 * settling)
    first = last if first is None else first
    states = [(a, first), (b, first)] if after is None else [(a, first), (b - settling, last), (b, after)]
    if before is not None:
        states = [(a, before), (a + settling, first), *states[1:]]
    return [
        _Row(t0, 0.0, _quintic(t1 - t0, p, q))
        for (t0, p), (t1, q) in pairwise(states)
        if p is not None and q is not None
    ]


def _at_rest(angles: np.ndarray, time: float) -> np.ndarray:
    """Angles at rest after their rates have decreased linearly to zero over 2·`time`, backwards if it is negative."""
    zero = np.zeros_like(angles[:, 0])
    return np.stack([angles[:, 0] + time * angles[:, 1], zero, zero], axis=1)


def _quintic(h: float, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Coefficients (2, 6) of angles over a time `h` [s], from values and two derivatives (2, 3) at both ends."""
    states = np.stack([before.T, after.T])
    return pieces.hermite(np.array([h]), states)[0].T


def _angles(segments: Segments, t: float, side: str, sign: float, basis: np.ndarray) -> np.ndarray:
    """Heading and pitch of sign·velocity at a time, with two derivatives, (2, 3)."""
    _, v, a, j = (sign * basis @ row[0] for row in segments.rows(np.array([t]), 3, side))
    level_sq, speed_sq = v[0] ** 2 + v[1] ** 2, v @ v
    if level_sq == 0:
        pitch = np.pi / 2 * np.sign(v[2])
        return np.array([[0.0, 0.0, 0.0], [pitch, 0.0, 0.0]])
    yaw_rate = (v[0] * a[1] - v[1] * a[0]) / level_sq
    yaw_acceleration = (v[0] * j[1] - v[1] * j[0] - 2 * yaw_rate * (v[0] * a[0] + v[1] * a[1])) / level_sq
    level = np.sqrt(level_sq)  # the horizontal speed and its two derivatives
    level1 = (v[0] * a[0] + v[1] * a[1]) / level
    level2 = (a[0] ** 2 + a[1] ** 2 + v[0] * j[0] + v[1] * j[1] - level1**2) / level
    pitch_rate = (level * a[2] - v[2] * level1) / speed_sq
    pitch_acceleration = (level * j[2] - v[2] * level2 - 2 * pitch_rate * (v @ a)) / speed_sq
    heading, pitch = np.arctan2(v[1], v[0]), np.arctan2(v[2], level)
    return np.array([[heading, yaw_rate, yaw_acceleration], [pitch, pitch_rate, pitch_acceleration]])


def _basis(up: np.ndarray) -> np.ndarray:
    """Rows: the horizontal direction of heading zero, the direction to its left, and up."""
    level = np.asarray(_level(jnp.asarray(up)))
    return np.stack([level, np.cross(up, level), up])


def _level(up: Vec3) -> Vec3:
    """The horizontal direction of heading zero: the x axis projected, or the y axis if x is nearly vertical."""
    reference = jnp.where(
        jnp.abs(up[0]) > 0.9, jnp.asarray([0.0, 1.0, 0.0], up.dtype), jnp.asarray([1.0, 0, 0], up.dtype)
    )
    level = reference - up * (up @ reference)
    return level / jnp.sqrt(level @ level)
