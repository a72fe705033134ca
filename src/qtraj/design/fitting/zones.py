"""Find the zones of a drive: the last metres before each slow point, and the first metres after it.

Slow points are the stops, the points at which the vehicle creeps or halts for a moment, and the ends of the recording
near which it is slow. A fit in time cannot determine the shape of a path there: its noise below walking pace is not a
curve that was driven. In a zone, the route is therefore a curve with a progress (see `qtraj.path.progress`).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.fitting.motion import Motion, straight_motion
from qtraj.design.fitting.route_jumps import lengths

LENGTH, AT_END = 0.39, 2.0
"""Length of a zone, relative to the distance that the vehicle drives almost straight, and the factor for a zone at an
end of the recording, which has samples on one side of its slow point only."""

MOST = 1.25
"""A drive between two slow points that is shorter than this number of lengths of its zones consists of these zones."""

SLOW, APART = 0.08, 0.5
"""Maximum speed at a slow point in units of the recording, and minimum distance of slow points in lengths of a zone."""

QUIET, NOISIEST = 0.0027, 5.0
"""Noise of the acceleration of a fit, in units of almost straight motion, above which zones are longer, and the largest
ratio to it that makes them longer. A fit in time has this noise, divided by the squared speed, as noise of its
curvature."""

LENGTH_POWER, SLOW_POWER = 1.5, 0.5
"""Powers of this ratio: of the length of a zone, from fits to random drives, and of the maximum speed at a slow point,
at which the noise of the curvature is always the same."""

FAST = 1.0
"""Speed at which a zone ends that is longer because of noise, in units of the recording."""

LEAST_SPEED = 0.15
"""Minimum speed along the curve, in units of the recording; slower vehicles have a slower progress."""

BACK, AWAY = 0.003, 2.0
"""Minimum distance by which a vehicle comes back in a zone where it reverses, relative to the zone and to the noise."""

STRAIGHT_BACK, PARTS, VISIBLE = 0.7, np.array([1.0, 0.5, 0.25]), 10.0
"""Minimum cosine of the angle between the chords from a point of reversal to both sides, for parts of the zones, and
minimum length of a chord relative to the noise. In a hairpin, which is no reversal, short chords are opposite."""

SAMPLES = 32
"""Number of samples between two knots, for lengths along the path."""


class Scale(NamedTuple):
    """The lengths of a zone, the largest speed at a `slow` point, and the `time` of almost straight motion.

    A zone is between `shortest` and `length` long.
    """

    shortest: float
    length: float
    slow: float
    time: float


def scale_of(motion: Motion) -> Scale:
    """Return the scale of the zones, which depends on the noise of the motion."""
    time, length = straight_motion(motion)
    noise = motion.noise.acceleration * time**2 / length if length else 0.0
    ratio = float(np.clip(noise / QUIET, 1.0, NOISIEST))
    shortest = LENGTH * length
    return Scale(shortest, shortest * ratio**LENGTH_POWER, SLOW * ratio**SLOW_POWER, time)


class Zone(NamedTuple):
    """A zone: the times of its slow point and of its other end, and the rate of the progress at this end.

    `turns` indicates that the vehicle reverses at the slow point: it leaves it in the direction from which it came.
    """

    stop: float
    end: float
    rate: float
    turns: bool = False

    @property
    def interval(self) -> tuple[float, float]:
        """The start and the end of the zone."""
        return min(self.stop, self.end), max(self.stop, self.end)


def with_slow_points(motion: Motion, scale: Scale) -> Motion:
    """Add the slow points that are not stops, if they are far enough from all others: the ends, and then the slowest.

    An end is a slow point if the vehicle is slow near it. No other slow point is near an end, where a drive between
    them would be too short for a zone.
    """
    t = _instants(motion.knots)
    speed, way = _travelled(motion, t)
    apart = APART * scale.length
    kept = np.interp([x for stop in motion.stops for x in stop], t, way).tolist()
    slow = np.flatnonzero(speed < scale.slow)
    ends = [k for k in (0, len(t) - 1) if (np.abs(way[slow] - way[k]) < apart).any()]
    found = []
    for k in [*ends, *slow[np.argsort(speed[slow], kind="stable")]]:
        others = kept if k in ends else [*kept, way[0], way[-1]]
        if all(abs(way[k] - x) > apart for x in others):
            kept.append(float(way[k]))
            found.append((float(t[k]), float(t[k])))
    return motion._replace(stops=_until_ends(motion, sorted([*motion.stops, *found])))


def _until_ends(motion: Motion, slow: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Extend a stop to an end of the recording if the vehicle does not leave it, apart from noise, until there."""
    start, end = motion.ends

    def stays(a: float, b: float) -> bool:
        at = motion.at(np.linspace(a, b, SAMPLES + 1))
        return float(lengths(at - at[:1]).max()) <= AWAY * motion.noise.position

    if slow and slow[0][0] < slow[0][1] and stays(start, slow[0][0]):
        slow = [(start, slow[0][1]), *slow[1:]]
    if slow and slow[-1][0] < slow[-1][1] and stays(slow[-1][1], end):
        slow = [*slow[:-1], (slow[-1][0], end)]
    return slow


def _instants(joints: np.ndarray) -> np.ndarray:
    """Return instants that divide the intervals between joints equally."""
    return np.interp(np.arange(SAMPLES * (len(joints) - 1) + 1) / SAMPLES, np.arange(len(joints)), joints)


def _travelled(motion: Motion, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the speeds at the instants `t`, and the distances travelled since the first one."""
    speed = lengths(motion.at(t, 1))
    return speed, np.append(0.0, np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t)))


def find_zones(motion: Motion, scale: Scale) -> list[Zone]:
    """Return the zones in order; a slow point at which the direction of the vehicle is not clear has none.

    A slow point whose zone ends where such a zone would end has none, either: their rates agree only with each other.
    """
    found = [zone for leg in _legs(motion) for zone in _zones_of(motion, scale, *leg)]
    zones_at = {stop: [zone for zone in found if zone.stop in stop] for stop in motion.stops}
    cosines = {stop: _cosines(motion, own) for stop, own in zones_at.items()}
    turns = {stop: bool((own > STRAIGHT_BACK).all()) for stop, own in cosines.items()}
    zones_at = {stop: [zone._replace(turns=turns[stop]) for zone in own] for stop, own in zones_at.items()}
    unclear = [stop for stop, own in cosines.items() if own[0] > 0 and not turns[stop]]
    fresh = [
        stop for stop, own in zones_at.items() if stop in unclear or any(_turns_back(motion, zone) for zone in own)
    ]
    while fresh:
        ends = {zone.end for stop in fresh for zone in zones_at.pop(stop)}
        fresh = [stop for stop, own in zones_at.items() if any(zone.end in ends for zone in own)]
    return [zone for own in zones_at.values() for zone in own]


def _legs(motion: Motion) -> list[tuple[float, float, bool, bool]]:
    """Return the drives between the slow points: start, end, and whether each of them is a slow point."""
    start, end = motion.ends
    edges = [start, *(t for stop in motion.stops for t in stop), end]
    legs = zip(edges[::2], edges[1::2], strict=True)
    last = len(motion.stops)
    return [(a, b, k > 0, k < last) for k, (a, b) in enumerate(legs) if b > a]


def _zones_of(motion: Motion, scale: Scale, a: float, b: float, from_stop: bool, to_stop: bool) -> list[Zone]:
    inner = motion.knots[(motion.knots > a) & (motion.knots < b)]
    t = _instants(np.concatenate([[a], inner, [b]]))
    speed, way = _travelled(motion, t)
    first = _length(speed, way, scale, a in motion.ends) if from_stop else 0.0
    last = _length(speed[::-1], way[-1] - way[::-1], scale, b in motion.ends) if to_stop else 0.0
    if first + last == 0 or way[-1] == 0:
        return []
    short = way[-1] < MOST * (first + last)
    until = way[-1] * first / (first + last) if short else first
    found = []
    for chosen, stop, at in ((from_stop, a, until), (to_stop, b, until if short else way[-1] - last)):
        if chosen:
            end = float(np.interp(at, way, t))
            own = float(np.interp(end, t, speed))
            # Of a short drive, the other end is in another zone or at an end of the recording.
            found.append(Zone(stop, end, min(1.0, own / LEAST_SPEED) if short else 1.0))
    return found


def _length(speed: np.ndarray, way: np.ndarray, scale: Scale, at_end: bool) -> float:
    """Return the length of a zone, for speeds at distances from its slow point: up to where the vehicle is fast."""
    fast, factor = np.flatnonzero(speed > FAST), AT_END if at_end else 1.0
    return float(np.clip(way[fast[0]] if len(fast) else np.inf, factor * scale.shortest, factor * scale.length))


def _turns_back(motion: Motion, zone: Zone) -> bool:
    """Return whether the slow point of a zone is not the farthest from its other end, apart from noise."""
    at = motion.at(np.linspace(*zone.interval, SAMPLES + 1))
    distances = lengths(at - motion.at(np.array([zone.end])))
    at_slow_point = float(max(distances[0], distances[-1]))
    return float(distances.max()) > at_slow_point + max(BACK * at_slow_point, AWAY * motion.noise.position)


def _cosines(motion: Motion, zones: list[Zone]) -> Float[np.ndarray, " parts"]:
    """Return the cosines of the angles between the chords from a slow point to both sides, the longest ones first.

    They are −1 if the vehicle goes straight on, and if there is one zone only.
    """
    if len(zones) < 2:
        return np.array([-1.0])
    before, after = (_chords(motion, zone) for zone in zones)
    sizes = lengths(before), lengths(after)
    visible = np.minimum(*sizes) > VISIBLE * motion.noise.position
    visible[0] = True
    return (np.sum(before * after, axis=1) / np.maximum(sizes[0] * sizes[1], np.finfo(float).tiny))[visible]


def _chords(motion: Motion, zone: Zone) -> Float[np.ndarray, "parts 3"]:
    """Return the chords from the slow point of a zone to the points after `PARTS` of its length."""
    t = np.linspace(*zone.interval, SAMPLES + 1)
    way, at = _travelled(motion, t)[1], motion.at(t)
    if zone.stop > zone.end:
        way, at = way[-1] - way[::-1], at[::-1]
    inside = np.stack([np.interp(PARTS * way[-1], way, x) for x in at.T], axis=1)
    return inside - at[0]
