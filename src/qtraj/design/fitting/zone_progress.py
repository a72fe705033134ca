"""Determine the progress in a zone: a cubic spline that never decreases, and is at rest at a stop.

The progress has the rate ds/dt / V(s), where s is the distance along the fit in time. V is the speed along the curve:
it agrees with the speed of the vehicle at the end of the zone, and has the same value on both sides of the stop.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.fitting.motion import Motion
from qtraj.design.fitting.route_jumps import lengths
from qtraj.design.fitting.zones import Zone

SAMPLES = 400
"""Number of parts of a zone in which its motion is sampled."""

SPACING, MIN_PARTS, MAX_PARTS = 0.39, 6, 40
"""Usual duration of a cubic, relative to that of almost straight motion, and bounds on their number."""

BRAKING, STEEP = 0.7, 1.5
"""Bounds on the changes of V² and of its slope in a zone, relative to V² at its end; V remains positive."""

LEAST_SPEED, LEAST_RATE = 0.002, 1e-3
"""Minimum speed at a slow point that is not a stop, in units of the recording, and minimum coefficient of the rate in
a zone, relative to the mean rate."""

ROUGH = 0.3
"""Weight of the jerk of the progress, relative to that of the fit in time, which has smoothed the motion already."""

EQUATION = 1e3
"""Weight of the equation for the length of the curve."""


class ZoneProgress(NamedTuple):
    """The progress in a zone: `rows` (k, 4) are coefficients of cubics that start at the `times` (k,).

    The progress is 0 at the start of the zone and `advance` at its `end`.
    """

    times: Float[np.ndarray, " k"]
    rows: Float[np.ndarray, "k 4"]
    end: float
    advance: float

    def at(self, t: Float[np.ndarray, " n"]) -> tuple[np.ndarray, np.ndarray]:
        """Return the progress and its rate at times within the zone."""
        i = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 1)
        s, c = t - self.times[i], self.rows[i].T
        return c[0] + s * (c[1] + s * (c[2] + s * c[3])), c[1] + s * (2 * c[2] + s * 3 * c[3])


class _Samples(NamedTuple):
    """The motion in a zone at the times `t` since its end, towards the stop: distance and speed along the curve.

    `speed` is the speed of the vehicle divided by the rate of the progress at the end of the zone.
    """

    t: np.ndarray
    way: np.ndarray
    speed: np.ndarray
    rate: float

    @property
    def slope(self) -> float:
        """The derivative of the squared speed with respect to the distance, at the end of the zone, bounded."""
        square, length = self.speed[0] ** 2, self.way[-1]
        slope = (self.speed[1] ** 2 - square) / (self.way[1] - self.way[0])
        return float(np.clip(slope, -STEEP * square / length, STEEP * square / length))


class Criterion(NamedTuple):
    """The weight of ∫|r'''|²dt relative to the sum of squared distances of samples with this time `step`.

    `spacing` is the usual duration of a cubic.
    """

    smoothing: float
    step: float
    spacing: float


def progress_in(motion: Motion, zones: list[Zone], criterion: Criterion) -> list[ZoneProgress]:
    """Return the progress in each zone."""
    samples = [_sampled(motion, zone) for zone in zones]
    stops = [next(stop for stop in motion.stops if zone.stop in stop) for zone in zones]
    speeds: dict[tuple[float, float], list[float]] = {}
    for stop, own in zip(stops, samples, strict=True):
        least = (1 - BRAKING) * own.speed[0] ** 2
        speeds.setdefault(stop, []).append(max(least, own.speed[0] ** 2 + 0.5 * min(own.slope, 0.0) * own.way[-1]))
    at_stop = {stop: float(np.exp(0.5 * np.mean(np.log(squares)))) for stop, squares in speeds.items()}
    return [
        _progress(zone, x, at_stop[stop], _slowest(motion, zone, stop, x, at_stop[stop]), criterion)
        for zone, x, stop in zip(zones, samples, stops, strict=True)
    ]


class _Slowest(NamedTuple):
    """The `rate` of the progress at a slow point, and the `slope` of the rate, away from it; both zones share them."""

    rate: float
    slope: float = 0.0


def _slowest(motion: Motion, zone: Zone, stop: tuple[float, float], x: _Samples, at_stop: float) -> _Slowest | None:
    """Return the rate at a slow point, or None at an end of the recording.

    A vehicle that reverses without standing has the rate zero there, and the acceleration of the fit in time.
    """
    if stop[1] > stop[0]:
        return _Slowest(0.0)
    if zone.turns:
        (acceleration,) = lengths(motion.at(np.array([stop[0]]), 2))
        return _Slowest(0.0, float(acceleration) / at_stop)
    return None if stop[0] in motion.ends else _Slowest(x.rate * max(float(x.speed[-1]), LEAST_SPEED) / at_stop)


def _sampled(motion: Motion, zone: Zone) -> _Samples:
    start, end = zone.interval
    t = np.linspace(start, end, SAMPLES + 1)
    speed = lengths(motion.at(t, 1))
    if zone.stop < zone.end:
        speed = speed[::-1]
    t = t - start
    way = np.append(0.0, np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t)))
    return _Samples(t, way, speed / zone.rate, zone.rate)


def _progress(zone: Zone, x: _Samples, at_stop: float, slowest: _Slowest | None, criterion: Criterion) -> ZoneProgress:
    """Return the progress; at the slow point, V is `at_stop`, and the progress has the `slowest` rate."""
    goal = _goal(x, at_stop)
    parts = int(np.clip(round(x.t[-1] / criterion.spacing), MIN_PARTS, MAX_PARTS))
    rates = _rates(x, goal, slowest, parts, criterion)
    return _in_time(zone, rates if zone.stop > zone.end else rates[::-1])


def _goal(x: _Samples, at_stop: float) -> np.ndarray:
    """Return the progress at the samples; V² is a cubic of the distance."""
    u, first, last = x.way / x.way[-1], x.speed[0] ** 2, at_stop**2
    squares = first + (last - first) * u * u * (3 - 2 * u) + x.slope * x.way[-1] * u * (1 - u) ** 2
    rate = x.rate * x.speed / np.sqrt(squares)
    return np.append(0.0, np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(x.t)))


def _knots(parts: int, duration: float) -> np.ndarray:
    return duration * np.clip(np.arange(-2, parts + 3) / parts, 0.0, 1.0)


def _rates(
    x: _Samples, goal: np.ndarray, slowest: _Slowest | None, parts: int, criterion: Criterion
) -> Float[np.ndarray, " n"]:
    """Return the coefficients of the quadratic B-spline of the rate, from the end of the zone to the slow point.

    They are not negative, so the rate is not. The first two are the rate at the end of the zone, so the second
    derivative is zero there, and the last two result in the `slowest` rate and its slope, or are free without them.
    """
    from scipy.interpolate import BSpline
    from scipy.optimize import nnls

    knots, count = _knots(parts, x.t[-1]), parts + 2
    table = BSpline(knots, np.eye(count), 2).antiderivative()(x.t)
    shares = (knots[3:] - knots[:-3]) / 3
    given, free = np.zeros(count), np.arange(2, count if slowest is None else count - 2)
    given[:2] = x.rate
    if slowest is not None:
        given[-1], given[-2] = slowest.rate, slowest.rate + 0.5 * slowest.slope * x.t[-1] / parts
    given[free] = LEAST_RATE * goal[-1] / x.t[-1]  # no other stop
    # The third derivative of the progress is constant in each part.
    third = (parts / x.t[-1]) ** 2 * np.diff(_ends_of_slopes(parts), axis=0)
    density = x.t[-1] / criterion.step / len(x.t)
    rough = np.sqrt(ROUGH * criterion.smoothing * x.t[-1] / parts / density) * third
    weight = EQUATION * len(x.t) ** 0.5
    rows = np.vstack([table, rough, weight * shares[None]])
    right = np.concatenate([goal, np.zeros(parts), [weight * goal[-1]]]) - rows @ given
    given[free] += nnls(rows[:, free], right)[0]
    return given


def _ends_of_slopes(parts: int) -> Float[np.ndarray, "ends n"]:
    """Return the derivatives of the quadratic B-splines at the ends of the parts, in units of a part."""
    from scipy.interpolate import BSpline

    return BSpline(_knots(parts, float(parts)), np.eye(parts + 2), 2).derivative()(np.arange(parts + 1.0))


def _spline(rates: np.ndarray, duration: float):
    from scipy.interpolate import BSpline

    return BSpline(_knots(len(rates) - 2, duration), rates, 2).antiderivative()


def _in_time(zone: Zone, rates: Float[np.ndarray, " n"]) -> ZoneProgress:
    """Return the progress for the coefficients of its rate, in the order of time."""
    start, end = zone.interval
    parts = len(rates) - 2
    times = np.linspace(start, end, parts + 1)
    spline = _spline(rates, end - start)
    local, h = times[:-1] - start, (end - start) / parts
    low, high = spline(local, 1), spline(local + h, 1)
    low[0], high[-1] = rates[0], rates[-1]
    middle = spline(local + 0.5 * h, 1)
    # The rate is a quadratic in each part.
    bend = 2 * (low - 2 * middle + high) / h**2
    slope = (high - low) / h - bend * h
    steps = h * (low + 4 * middle + high) / 6
    at = np.append(0.0, np.cumsum(steps))
    rows = np.stack([at[:-1], low, slope / 2, bend / 3], axis=1)
    return ZoneProgress(times[:-1], rows, end, float(at[-1]))
