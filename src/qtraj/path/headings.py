"""Compute heading and pitch of a vehicle on a route, at many instants, with NumPy.

At a stop and in reverse the direction of the velocity is not the direction of the vehicle. A row is a time interval in
which the forward axis of the vehicle is along the velocity, opposite to the velocity, or held (see
`qtraj.path.driving`).
"""

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.foundation.namespace import xp
from qtraj.path import pieces
from qtraj.path.stops import Segments, stops

STOP_SPEED = 0.01
"""Default speed threshold of a stop, divided by the largest speed."""

SETTLING = 1.0
"""Duration [s] of the change of heading and pitch at the start of a long stop, and of the change at its end."""


class Rows(NamedTuple):
    """The time intervals of a frame, with the same fields as `Driving`.

    `starts` [s] are the start times. `signs` are 1 (forwards), −1 (reverse) or 0 (stop). `angles` contain the ascending
    coefficients of heading and pitch at stops; the axes are row, angle, power.
    """

    starts: Float[np.ndarray, " rows"]
    signs: Float[np.ndarray, " rows"]
    angles: Float[np.ndarray, "rows 2 6"]


class _Row(NamedTuple):
    """One interval of the frame, from `start` [s]; `sign` is 1 (forwards), −1 (reverse) or 0 (stop).

    For a stop, `states` contains its duration [s] and the two end states (2, 3), which quintics join. The rows of a
    state are heading and pitch [rad], and the columns are the value and the first two derivatives.
    """

    start: float
    sign: float
    states: tuple[float, np.ndarray, np.ndarray] | None = None


def along(segments: Segments, up: Float[np.ndarray, "3"], threshold: float | None = None) -> Rows:
    """Return the rows (time intervals) of the frame of a vehicle that initially moves forwards; `up` is the vertical.

    A stop is an interval in which the speed is at most `threshold` [m/s], by default 1 % of the largest speed.
    """
    end = segments.end
    intervals = stops(segments, STOP_SPEED, relative=True) if threshold is None else stops(segments, threshold)
    rows = _rows(segments, intervals, end, basis(up))
    coefficients = np.zeros((len(rows), 2, 6))
    connected = {i: row.states for i, row in enumerate(rows) if row.states is not None}
    if connected:
        coefficients[list(connected)] = _quintics([*connected.values()])
    return Rows(np.array([row.start for row in rows]), np.array([row.sign for row in rows]), coefficients)


def body_rates(
    rows: Rows,
    up: Float[np.ndarray, "3"],
    t: Float[np.ndarray, " m"],
    velocity: Float[np.ndarray, "m 3"],
    acceleration: Float[np.ndarray, "m 3"],
) -> Float[np.ndarray, "m 3"]:
    """Return the angular rates [rad/s] of the frame with these rows at the times `t` [s], in the axes of the frame.

    `velocity` [m/s] and `acceleration` [m/s²] are in world axes. The rate of an upright frame consists of the rate of
    the heading, about `up`, and the rate of the pitch, about −y.
    """
    i = np.maximum(np.searchsorted(rows.starts, t, side="right") - 1, 0)
    signs = rows.signs[i]
    held = np.flatnonzero(signs == 0)
    v, a = (signs * (basis(up) @ x.T) for x in (velocity, acceleration))
    level = _Level.of(v, a)
    yaw_rate, pitch_rate, inv_speed = level.yaw_rate, level.pitch_rate(v, a), np.sqrt(level.inv_speed_sq)
    sine, cosine = v[2] * inv_speed, level.speed * inv_speed
    value, rate = pieces.values(np.swapaxes(rows.angles, 1, 2)[i[held]], t[held] - rows.starts[i[held]], 1)
    yaw_rate[held], pitch_rate[held], sine[held], cosine[held] = *rate.T, np.sin(value[:, 1]), np.cos(value[:, 1])
    return np.stack([yaw_rate * sine, -pitch_rate, yaw_rate * cosine], axis=1)


class _Level(NamedTuple):
    """The horizontal motion at m instants: speed [m/s], its derivative [m/s²] and the yaw rate [rad/s].

    `inv_level_sq` and `inv_speed_sq` are the inverse squares of the horizontal and of the total speed. Where the
    horizontal speed is zero, the yaw rate, the derivative and the inverses are 0.
    """

    speed: np.ndarray
    speed1: np.ndarray
    yaw_rate: np.ndarray
    inv_level_sq: np.ndarray
    inv_speed_sq: np.ndarray

    @classmethod
    def of(cls, v: np.ndarray, a: np.ndarray) -> "_Level":
        """Compute the horizontal motion from velocities and accelerations (3, m), with components along `basis`.

        The rows of `v` and `a` are the components, and the columns are the instants.
        """
        level_sq = v[0] * v[0] + v[1] * v[1]
        vertical = level_sq == 0
        safe_sq = np.where(vertical, 1.0, level_sq)
        inv_level_sq = np.where(vertical, 0.0, 1 / safe_sq)
        inv_speed_sq = np.where(vertical, 0.0, 1 / (safe_sq + v[2] * v[2]))
        yaw_rate = (v[0] * a[1] - v[1] * a[0]) * inv_level_sq
        speed1 = (v[0] * a[0] + v[1] * a[1]) * np.sqrt(inv_level_sq)
        return cls(np.sqrt(level_sq), speed1, yaw_rate, inv_level_sq, inv_speed_sq)

    def pitch_rate(self, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return the derivative of the pitch [rad/s]; `v` and `a` are the same as for `of`."""
        return (self.speed * a[2] - v[2] * self.speed1) * self.inv_speed_sq


def _angles(v: np.ndarray, a: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Return heading and pitch [rad] of the velocities `v` (3, m), with their first two derivatives, as (m, 2, 3).

    The axes of the result are the instant, the angle (heading, pitch), and the order of the derivative. `a` and `j` are
    accelerations and jerks (3, m). All components are along the rows of `basis`. Where the velocity is vertical, the
    heading and all derivatives are zero.
    """
    level = _Level.of(v, a)
    speed, speed1, yaw_rate, inv_level_sq, inv_speed_sq = level
    pitch_rate, inv_speed = level.pitch_rate(v, a), np.sqrt(inv_level_sq)
    speed2 = (a[0] ** 2 + a[1] ** 2 + v[0] * j[0] + v[1] * j[1] - speed1**2) * inv_speed
    yaw_acceleration = (v[0] * j[1] - v[1] * j[0] - 2 * yaw_rate * speed * speed1) * inv_level_sq
    product = 2 * pitch_rate * (speed * speed1 + v[2] * a[2])
    pitch_acceleration = (speed * j[2] - v[2] * speed2 - product) * inv_speed_sq
    heading = np.where(speed == 0, 0.0, np.arctan2(v[1], v[0]))
    rows = [heading, yaw_rate, yaw_acceleration, np.arctan2(v[2], speed), pitch_rate, pitch_acceleration]
    return np.stack(rows, axis=1).reshape(-1, 2, 3)


def basis(up: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Return a matrix whose rows are the horizontal direction of zero heading, the direction to its left, and up."""
    up = up / np.linalg.norm(up)
    horizontal = level(up)
    return np.stack([horizontal, np.cross(up, horizontal), up])


def level(up: Any) -> Any:
    """Return the direction of zero heading: the horizontal projection of world x, or of y if x is nearly vertical."""
    x, y, _ = np.eye(3, dtype=up.dtype)
    reference = xp.where(abs(up[0]) > 0.9, y, x)
    horizontal = reference - up * (up @ reference)
    return horizontal / xp.sqrt(horizontal @ horizontal)


def _rows(segments: Segments, intervals: list[tuple[float, float]], end: float, axes: np.ndarray) -> list[_Row]:
    """Return the rows of a frame with stops in these `intervals` (start, end) [s], for a route that ends at `end` [s].

    The rows of `axes` are the axes of `basis`.
    """
    ends = np.reshape(np.asarray(intervals, float), (-1, 2)).T
    sides = [segments.rows(t, 3, side)[1:] for t, side in zip(ends, ("left", "right"), strict=True)]
    at_ends = {sign: [_angles(*(sign * (axes @ row.T) for row in side)) for side in sides] for sign in (1.0, -1.0)}
    sign = 1.0
    rows = [] if intervals and intervals[0][0] <= 0 else [_Row(0.0, sign)]
    for k, (a, b) in enumerate(intervals):
        before = None if a <= 0 else at_ends[sign][0][k]
        after = None if b >= end else at_ends[sign][1][k]
        if before is not None and after is not None:
            change = _wrapped(after[0, 0] - before[0, 0])
            if abs(change) > np.pi / 2:
                sign = -sign
                after = at_ends[sign][1][k]
                change = _wrapped(after[0, 0] - before[0, 0])
            after = after.copy()
            after[0, 0] = before[0, 0] + change
        rows += _held_rows(a, b, before, after)
        if after is not None:
            rows.append(_Row(b, sign))
    return rows


def _wrapped(angle: float) -> float:
    """Reduce an angle to [−π, π)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def _held_rows(a: float, b: float, before: np.ndarray | None, after: np.ndarray | None) -> list[_Row]:
    """Return the rows of a stop from `a` to `b` [s]: heading and pitch are quintics, then constant, then quintics.

    `before` and `after` are the states (2, 3) at both ends of the stop, with the rows heading and pitch and the columns
    value and first two derivatives. If `before` or `after` is None, the route starts or ends with the stop, and there
    are no quintics on this side.
    """
    if before is None and after is None:
        return [_Row(a, 0.0)]
    settling = min((b - a) / 3, SETTLING)
    first = None if before is None else _at_rest(before, 0.5 * settling)
    last = first if after is None else _at_rest(after, -0.5 * settling)
    first = last if first is None else first
    states = [(a, first), (b, first)] if after is None else [(a, first), (b - settling, last), (b, after)]
    if before is not None:
        states = [(a, before), (a + settling, first), *states[1:]]
    return [_Row(t0, 0.0, (t1 - t0, p, q)) for (t0, p), (t1, q) in pairwise(states) if p is not None and q is not None]


def _at_rest(state: np.ndarray, time: float) -> np.ndarray:
    """Return the state (2, 3) at rest after a linear decrease of the rates in `state` to zero over 2·`time` [s].

    The rows of a state are heading and pitch, and the columns are the value and the first two derivatives. If `time` is
    negative, return the state at rest before a linear increase of the rates from zero over −2·`time`.
    """
    zero = np.zeros_like(state[:, 0])
    return np.stack([state[:, 0] + time * state[:, 1], zero, zero], axis=1)


def _quintics(ends: list[tuple[float, np.ndarray, np.ndarray]]) -> Float[np.ndarray, "m 2 6"]:
    """Return the ascending quintic coefficients of heading and pitch for m rows; the axes are row, angle, power.

    For each row, `ends` contains the duration [s] and the states (2, 3) at its start and end. The rows of a state are
    heading and pitch [rad], and the columns are the value and the first two derivatives.
    """
    # Every second segment of this chain connects the two ends of a row. The other segments are not used.
    states = np.array([state.T for _, *pair in ends for state in pair])
    h = np.ones(len(states) - 1)
    h[::2] = [duration for duration, *_ in ends]
    return np.swapaxes(pieces.hermite(h, states)[::2], 1, 2)
