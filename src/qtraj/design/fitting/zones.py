"""Find the zones of a drive: the last metres before each slow point, and the first metres after it.

Slow points are the stops, and the points at which the vehicle creeps or halts for a moment. A fit in time cannot
determine the shape of a path there: its noise below walking pace is not a curve that was driven. In a zone, the route
is therefore a curve with a progress (see `qtraj.path.progress`).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.fitting.route_jumps import lengths
from qtraj.design.fitting.route_system import design, predict

LENGTH = 0.35
"""Length of a zone, in units of length of the recording."""

MOST = 1.25
"""A drive between two slow points that is shorter than this number of lengths of its zones consists of these zones."""

SLOW, APART = 0.08, 0.5
"""Maximum speed at a slow point in units of the recording, and minimum distance of slow points in lengths of a zone."""

LEAST_SPEED = 0.15
"""Minimum speed along the curve, in units of the recording; slower vehicles have a slower progress."""

SAMPLES = 32
"""Number of samples between two knots, for lengths along the path."""


class Motion(NamedTuple):
    """A fit in time: the states (m, 3, 3) at its knots (m,), and its slow points as intervals (start, end).

    The interval of a stop has a duration; that of another slow point has none.
    """

    knots: Float[np.ndarray, " m"]
    states: Float[np.ndarray, "m 3 3"]
    stops: list[tuple[float, float]]

    def at(self, t: np.ndarray, order: int = 0) -> Float[np.ndarray, "n 3"]:
        """Return the positions (order 0) or the velocities (order 1) at increasing times."""
        return predict(design(self.knots, t, order), self.states)


class Zone(NamedTuple):
    """A zone: the times of its slow point and of its other end, and the rate of the progress at this end."""

    stop: float
    end: float
    rate: float

    @property
    def interval(self) -> tuple[float, float]:
        """The start and the end of the zone."""
        return min(self.stop, self.end), max(self.stop, self.end)


def with_slow_points(motion: Motion) -> Motion:
    """Add the slow points that are not stops, the slowest first, if they are far enough from all others."""
    t = _instants(motion.knots)
    speed, way = _travelled(motion, t)
    kept = np.interp([x for stop in motion.stops for x in stop], t, way).tolist()
    found = []
    slow = np.flatnonzero(speed < SLOW)
    for k in slow[np.argsort(speed[slow], kind="stable")]:
        if all(abs(way[k] - x) >= APART * LENGTH for x in [*kept, way[0], way[-1]]):
            kept.append(float(way[k]))
            found.append((float(t[k]), float(t[k])))
    return motion._replace(stops=sorted([*motion.stops, *found]))


def _instants(joints: np.ndarray) -> np.ndarray:
    """Return instants that divide the intervals between joints equally."""
    return np.interp(np.arange(SAMPLES * (len(joints) - 1) + 1) / SAMPLES, np.arange(len(joints)), joints)


def _travelled(motion: Motion, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the speeds at the instants `t`, and the distances travelled since the first one."""
    speed = lengths(motion.at(t, 1))
    return speed, np.append(0.0, np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t)))


def find_zones(motion: Motion) -> list[Zone]:
    """Return the zones in order; a stop at which the vehicle reverses has none."""
    found = [zone for leg in _legs(motion) for zone in _zones_of(motion, *leg)]
    reverse = [stop for stop in motion.stops if _reverses(motion, stop, found)]
    return [zone for zone in found if not any(zone.stop in stop for stop in reverse)]


def _legs(motion: Motion) -> list[tuple[float, float, bool, bool]]:
    """Return the drives between the slow points: start, end, and whether each of them is a slow point."""
    edges = [float(motion.knots[0]), *(t for stop in motion.stops for t in stop), float(motion.knots[-1])]
    legs = zip(edges[::2], edges[1::2], strict=True)
    last = len(motion.stops)
    return [(a, b, k > 0, k < last) for k, (a, b) in enumerate(legs) if b > a]


def _zones_of(motion: Motion, a: float, b: float, from_stop: bool, to_stop: bool) -> list[Zone]:
    inner = motion.knots[(motion.knots > a) & (motion.knots < b)]
    t = _instants(np.concatenate([[a], inner, [b]]))
    speed, way = _travelled(motion, t)
    count = int(from_stop) + int(to_stop)
    if not count or way[-1] == 0:
        return []
    short = way[-1] < MOST * count * LENGTH
    length = way[-1] / count if short else LENGTH
    found = []
    for chosen, stop, at in ((from_stop, a, length), (to_stop, b, way[-1] - length)):
        if chosen:
            end = float(np.interp(at, way, t))
            own = float(np.interp(end, t, speed))
            found.append(Zone(stop, end, min(1.0, own / LEAST_SPEED) if short and count == 2 else 1.0))
    return found


def _reverses(motion: Motion, stop: tuple[float, float], zones: list[Zone]) -> bool:
    """Return whether the vehicle leaves a stop in the direction from which it came."""
    chords = [np.diff(motion.at(np.array(zone.interval)), axis=0)[0] for zone in zones if zone.stop in stop]
    return len(chords) == 2 and float(chords[0] @ chords[1]) < 0
