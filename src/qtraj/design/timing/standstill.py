"""Replace slow motion next to a stop of a route by a stop.

Where the recorded vehicle was at rest, a fitted route moves slowly, and sometimes backwards by millimetres. Let T₀ and
T₂ be the start and the end of such an interval, at which the speed has a given value v. The replacement consists of a
short drive to the point halfway between r(T₀) and r(T₂), a stop, and a short drive from that point. Both drives are
quintics with the position, velocity and acceleration of the route at T₀ and T₂, and zero velocity and acceleration at
the stop. A drive of length d has the duration 3d/v, as in the motion x = d(1 − (1 − τ)³), where τ is the fraction of
the duration. So the vehicle does not reverse; in a short interval, both durations are reduced. During the remaining
time the vehicle is at rest. The route outside the interval does not change.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.timing.directions import STANDS
from qtraj.foundation.arrays import concrete
from qtraj.path import pieces
from qtraj.path.route import Route, from_segments
from qtraj.path.stops import Segments, stops

SAMPLES = 65


class _Stop(NamedTuple):
    """An interval [s] of slow motion, the point of its stop, and the states of the route before and after it.

    The axes of a state (3, 3) are the order of the derivative and the component. A state is None if the replacement
    has no drive on this side of the stop.
    """

    start: float
    end: float
    point: Float[Any, "3"]
    before: Float[Any, "3 3"] | None
    after: Float[Any, "3 3"] | None


def with_stops(route: Route, s: Segments, speed: float, distance: float) -> Route:
    """Return the route with stops instead of slow motion.

    An interval in which the speed is at most `speed` [m/s] is replaced, with three exceptions: the vehicle moves more
    than `distance` [m] in it; the interval is already a stop, in which the vehicle is at rest at some instant and never
    reverses; or the new stop would be behind the vehicle.
    """
    found = [x for x in (_stop(s, *interval, speed, distance) for interval in stops(s, speed)) if x is not None]
    if not found:
        return route
    parts, at = [], 0.0
    for x in found:
        if x.start > at:
            parts.append(route.window(at, x.start))
        parts += _replacement(x, np.asarray(route.origin, float), speed)
        at = x.end
    duration = float(np.asarray(concrete(route.duration)))
    if at < duration:
        parts.append(route.window(at, duration))
    joined = parts[0]
    for part in parts[1:]:
        joined = joined + part
    return joined


def _stop(s: Segments, start: float, end: float, speed: float, distance: float) -> _Stop | None:
    if end - start <= 0:
        return None
    near = (s.starts < end) & (s.starts + s.durations > start)
    t = (s.starts[near, None] + s.durations[near, None] * np.linspace(0.0, 1.0, SAMPLES)).ravel()
    t = np.unique(np.concatenate([t[(t > start) & (t < end)], np.linspace(start, end, SAMPLES)]))
    r, v = s.rows(t, 1)
    if np.linalg.norm(r - r[0], axis=1).max() > distance:
        return None
    v[np.linalg.norm(v, axis=1) <= STANDS * speed] = 0.0  # rounding
    if _is_stop(v):
        return None
    last = s.starts[-1] + s.durations[-1]
    moving = 0.5 * speed
    before = np.stack(s.rows(np.array([start]), 2, "left"))[:, 0] if start > 0 else None
    after = np.stack(s.rows(np.array([end]), 2))[:, 0] if end < last else None
    before, after = (x if x is not None and np.linalg.norm(x[1]) > moving else None for x in (before, after))
    if before is None and after is None:
        return None
    ends = [x[0] for x in (before, after) if x is not None]
    point = np.mean(ends, axis=0) if len(ends) == 2 else (r[-1] if after is None else r[0])
    backward = any(
        x is not None and sign * float((point - x[0]) @ x[1]) <= 0 for x, sign in ((before, 1.0), (after, -1.0))
    )
    return None if backward else _Stop(start, end, point, before, after)


def _is_stop(v: Float[Any, "n 3"]) -> bool:
    """Return whether the vehicle is at rest at some instant and never reverses."""
    return not v.any(axis=1).all() and not (np.sum(v[1:] * v[:-1], axis=1) < 0).any()


def _replacement(x: _Stop, origin: np.ndarray, speed: float) -> list[Route]:
    """Return the replacement: the drive to the stop, the stop, and the drive away from it."""
    drives = []
    for state, sign in ((x.before, 1.0), (x.after, -1.0)):
        drives.append(0.0 if state is None else 3 * sign * float((x.point - state[0]) @ state[1]) / speed**2)
    scale = min(1.0, 0.9 * (x.end - x.start) / max(sum(drives), 1e-300))
    first, last = (scale * d for d in drives)
    rest = np.stack([x.point, np.zeros(3), np.zeros(3)])
    states, times = [], []
    for state, t in (
        (x.before, x.start),
        (rest, x.start + first),
        (rest, x.end - last),
        (x.after, x.end),
    ):
        if state is not None:
            times.append(t)
            states.append(state)
    h = np.diff(times)
    c = pieces.hermite(h, np.stack(states))
    c[int(x.before is not None), 1:] = 0.0  # exactly at rest
    return [from_segments(np.array(times[:-1]) - times[0], c, np.asarray(times[-1] - times[0]), origin)]
