"""The frame of a vehicle on a route: upright, constant at a stop, and opposite to the velocity in reverse.

Where the speed is zero a path has no tangent, and where the vehicle reverses the tangent changes its sign. So below a
threshold of speed heading and pitch are polynomials from their values and rates before the stop, through a constant
part, to those after it. If the path then continues in the opposite direction, by more than 90°, the vehicle reverses,
and its forward axis is opposite to the tangent.
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

SLOW = 0.01
"""A vehicle stands, unless told otherwise, below this part of its largest speed."""

STILL = 1e-9
"""Below this part of its largest speed a route has no tangent to rounding."""

SETTLING = 1.0
"""[s] Of a stop that lasts, heading and pitch come to rest within this time, and start as long before its end."""


@storable
class Driving(AbstractFrame):
    """The upright frame of a vehicle on a route with stops and reversals; made by `Driving.along(route)`.

    It equals `Upright` while the vehicle moves forwards; in reverse, x is opposite to the velocity. At a stop, heading
    and pitch continue from the last direction to the next one, with continuous first and second derivatives, and
    `defined` is true, though the path has no tangent.

    `starts` (rows,) [s] are the start times of the rows; `signs` 1 forwards, −1 in reverse, 0 at a stop; `angles`
    (rows, 2, 6) the ascending coefficients of heading and pitch [rad] in the time since then at a stop. Rows are padded
    with infinite starts.
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
                f"a driving frame has signs {rows} and angles {(*rows, 2, 6)} for starts {rows}, but "
                f"{self.signs.shape} and {self.angles.shape} were given: make it by Driving.along(route)"
            )

    @property
    def name(self) -> str:
        """That of the upright frame, whose axes it has."""
        return UPRIGHT

    @classmethod
    def along(cls, route: Route, up: ArrayInput = (0.0, 0.0, 1.0), hold_below: ArrayInput | None = None) -> "Driving":
        """The frame of a vehicle that drives `route`, forwards at first.

        `hold_below` [m/s] is the speed below which the heading is held: by default a hundredth of the largest speed.

        **Raises:** ValueError for something else than one known route, an `up` that is zero, or a threshold that is not
        positive.
        """
        segments = known_segments(route)
        most = fastest(segments)
        threshold = SLOW * most if hold_below is None else float(np.asarray(real_scalar(hold_below, "hold_below")))
        if hold_below is not None and not 0 < threshold < np.inf:
            raise ValueError(f"hold_below must be positive [m/s], but {threshold} was given")
        upright = Upright(up)
        basis = _basis(np.asarray(upright.unit_up(route.duration.dtype), float))
        end = float(segments.starts[-1] + segments.durations[-1])
        rows = _rows(segments, stops(segments, threshold), end, basis)
        more = pieces.padded_size(len(rows)) - len(rows)
        starts = [row.start for row in rows] + [np.inf] * more
        signs = [row.sign for row in rows] + [0.0] * more
        return cls(starts, signs, np.stack([row.angles for row in rows] + [np.zeros((2, 6))] * more), upright.up)

    def trihedral(self, r: Float[Array, "5 3"], duration: Scalar) -> Trihedral:
        """The upright trihedral from position and four derivatives."""
        return Upright(self.up).trihedral(r, duration)

    def at(self, t: Scalar, r: Float[Array, "5 3"], duration: Scalar) -> Trihedral:
        """The trihedral at one instant `t` [s]: upright, against the path in reverse, held at a stop."""
        i = jnp.maximum(jnp.searchsorted(self.starts, t.astype(self.starts.dtype), side="right") - 1, 0)
        sign = self.signs[i].astype(r.dtype)
        held = self._held(t.astype(r.dtype), self.starts[i].astype(r.dtype), self.angles[i].astype(r.dtype))
        rows = jnp.where(sign == 0, held, sign * r.at[0].set(0.0))
        frame, path = self.trihedral(rows, duration), self.trihedral(r, duration)
        return dataclasses.replace(frame, speed=path.speed, curvature=path.curvature, torsion=path.torsion)

    def _held(self, t: Scalar, start: Scalar, angles: Float[Array, "2 6"]) -> Float[Array, "5 3"]:
        """Rows whose first derivative is the held direction, as if the path went on at unit speed."""
        up = Upright(self.up).unit_up(t.dtype)
        level = _level(up)
        since = jnp.where(jnp.isfinite(start), t - start, 0.0)

        def forward(s: Scalar) -> Vec3:
            heading, pitch = evaluate(angles[0], s), evaluate(angles[1], s)
            flat = jnp.cos(heading) * level + jnp.sin(heading) * jnp.cross(up, level)
            return jnp.cos(pitch) * flat + jnp.sin(pitch) * up

        once = lambda s: jax.jvp(forward, (s,), (jnp.ones_like(s),))  # noqa: E731
        (d, d1), (_, d2) = jax.jvp(once, (since,), (jnp.ones_like(since),))
        zero = jnp.zeros_like(d)
        return jnp.stack([zero, d, d1, d2, zero])


def usual_frame(path: AbstractHodograph) -> AbstractFrame:
    """The default frame of a path: natural, for a route upright, and `Driving` for a route that stops.

    For traced routes, and for a batch of routes, it is always upright.
    """
    if not isinstance(path, Route):
        return Natural()
    if not _known(path):
        return Upright()
    frame = Driving.along(path)
    return frame if np.any(np.asarray(frame.signs)[np.isfinite(np.asarray(frame.starts))] <= 0) else Upright()


def _known(route: Route) -> bool:
    """Whether this is one route whose numbers are known."""
    return route.duration.ndim == 0 and not any(isinstance(x, Tracer) for x in jax.tree.leaves(route))


def require_moving(path: AbstractHodograph) -> None:
    """Raise a ValueError for a concrete route that stops, where it has no tangent."""
    if not isinstance(path, Route) or not _known(path):
        return
    segments = known_segments(path)
    found = stops(segments, STILL * fastest(segments))
    if found:
        raise ValueError(
            f"the route stops at t = {found[0][0]:.4g} s, where it has no tangent, so no rotation-minimizing frame "
            "leads through. Take route.window(t0, t1) between stops, or the frame Driving.along(route)."
        )


def known_segments(route: Route) -> Segments:
    """The segments of one route in float64, without the padding.

    **Raises:** ValueError for another path, many routes, or inside a trace.
    """
    if not isinstance(route, Route) or route.duration.ndim:
        raise ValueError(f"one Route was expected, but {type(route).__name__} was given")
    count = route.segments
    starts, c = (np.asarray(x, float)[:count] for x in (route.starts, route.coefficients))
    return Segments(starts, c, np.diff(np.asarray(route.times, float)))


class _Row(NamedTuple):
    start: float
    sign: float
    angles: np.ndarray


def _rows(segments: Segments, found: list[tuple[float, float]], end: float, basis: np.ndarray) -> list[_Row]:
    """Stretches of driving, forwards or in reverse, and the held stretches between them."""
    still, sign = np.zeros((2, 6)), 1.0
    rows = [] if found and found[0][0] <= 0 else [_Row(0.0, sign, still)]
    for a, b in found:
        before = None if a <= 0 else _angles(segments, a, "left", sign, basis)
        after = None if b >= end else _angles(segments, b, "right", sign, basis)
        if before is not None and after is not None:
            change = (after[0, 0] - before[0, 0] + np.pi) % (2 * np.pi) - np.pi
            if abs(change) > np.pi / 2:
                sign = -sign
                after = _angles(segments, b, "right", sign, basis)
                change = (after[0, 0] - before[0, 0] + np.pi) % (2 * np.pi) - np.pi
            after[0, 0] = before[0, 0] + change
        rows += _held_rows(a, b, before, after)
        if after is not None:
            rows.append(_Row(b, sign, still))
    return rows


def _held_rows(a: float, b: float, before: np.ndarray | None, after: np.ndarray | None) -> list[_Row]:
    """Quintics in heading and pitch over a stop: to rest, at rest, and away from it."""
    if before is None and after is None:
        return [_Row(a, 0.0, np.zeros((2, 6)))]
    settling = min((b - a) / 3, SETTLING)
    first = None if before is None else _rest(before, 0.5 * settling)
    last = first if after is None else _rest(after, -0.5 * settling)
    first = last if first is None else first
    states = [(a, first), (b, first)] if after is None else [(a, first), (b - settling, last), (b, after)]
    if before is not None:
        states = [(a, before), (a + settling, first), *states[1:]]
    return [
        _Row(t0, 0.0, _quintic(t1 - t0, p, q))
        for (t0, p), (t1, q) in pairwise(states)
        if p is not None and q is not None
    ]


def _rest(angles: np.ndarray, time: float) -> np.ndarray:
    """Where the angles come to rest whose rates fade out evenly over twice a time, or build up if it is negative."""
    return np.stack([angles[:, 0] + time * angles[:, 1], 0 * angles[:, 0], 0 * angles[:, 0]], axis=1)


def _quintic(h: float, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Coefficients (2, 6) of angles between values and two derivatives, (2, 3) each."""
    states = np.stack([before.T, after.T])
    return pieces.hermite(np.array([h]), states)[0].T


def _angles(segments: Segments, t: float, side: str, sign: float, basis: np.ndarray) -> np.ndarray:
    """Heading and pitch with two derivatives (2, 3) of ±velocity at a time."""
    _, v, a, j = (sign * basis @ row[0] for row in segments.rows(np.array([t]), 3, side))
    H, S = v[0] ** 2 + v[1] ** 2, v @ v
    if H == 0:
        pitch = np.pi / 2 * np.sign(v[2])
        return np.array([[0.0, 0.0, 0.0], [pitch, 0.0, 0.0]])
    rate = (v[0] * a[1] - v[1] * a[0]) / H
    turn = (v[0] * j[1] - v[1] * j[0]) / H - 2 * rate * (v[0] * a[0] + v[1] * a[1]) / H
    w = np.sqrt(H)
    w1 = (v[0] * a[0] + v[1] * a[1]) / w
    w2 = (a[0] ** 2 + a[1] ** 2 + v[0] * j[0] + v[1] * j[1] - w1**2) / w
    climb = (w * a[2] - v[2] * w1) / S
    lift = (w * j[2] - v[2] * w2) / S - 2 * climb * (v @ a) / S
    return np.array([[np.arctan2(v[1], v[0]), rate, turn], [np.arctan2(v[2], w), climb, lift]])


def _basis(up: np.ndarray) -> np.ndarray:
    """Rows: the level direction that headings count from, the one to its left, and up."""
    level = np.asarray(_level(jnp.asarray(up)))
    return np.stack([level, np.cross(up, level), up])


def _level(up: Vec3) -> Vec3:
    """A level direction that headings count from: that of the x axis where it can be."""
    reference = jnp.where(
        jnp.abs(up[0]) > 0.9, jnp.asarray([0.0, 1.0, 0.0], up.dtype), jnp.asarray([1.0, 0, 0], up.dtype)
    )
    flat = reference - up * (up @ reference)
    return flat / jnp.sqrt(flat @ flat)
