"""Limits that change linearly along the way: bounds on the pace, lines on the strict side, and proofs with them."""

import itertools

import mpmath as mp
import numpy as np
import pytest
from tests.design.test_along import HELIX, random_route, sampled

import qtraj as qt
from qtraj.design.limit_curves import curves
from qtraj.design.varying import Varying
from qtraj.path.angle import gap_of_curve, strict_curve, tangent
from qtraj.path.distances import distances, paces
from qtraj.path.pace_bounds import pace_bounds

CIRCLE = qt.SpiralHelix([20.0], [0.0, 0.3], [0.0, 0.5], 10.0)
STOPPING = qt.Route(
    [0.0, 2.0, 5.0], [[0, 0, 0], [3, 1, 0], [9, 0, 1]], [[0, 0, 0], [2, 0, 0], [0, 0, 0]], np.zeros((3, 3))
)


def paths():
    rng = np.random.default_rng(4)
    return {"helix": HELIX, "circle": CIRCLE, "route": random_route(rng), "stops": STOPPING}


def cells(path, parts):
    """Return intervals, each of them between two joints."""
    ends = path.times if isinstance(path, qt.Route) else np.array([0.0, float(path.duration)])
    ends = np.unique(np.concatenate([np.linspace(a, b, parts + 1) for a, b in itertools.pairwise(ends)]))
    return ends[:-1], ends[1:]


@pytest.mark.parametrize("name", paths())
@pytest.mark.parametrize("parts", [1, 7, 60])
def test_the_pace_and_its_change_are_bounded(name, parts):
    path = paths()[name]
    low, high = cells(path, parts)
    found = pace_bounds(path, low, high)
    u = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, 101)
    pace = paces(path, u)
    change = np.abs(np.diff(pace, axis=1) / np.diff(u, axis=1)).max(axis=1)
    assert (found.pace >= pace.max(axis=1)).all()
    assert (found.change >= change - 1e-9).all()
    if parts == 60:
        assert (found.pace <= 1.1 * pace.max(axis=1) + 0.1).all()
        assert np.median(found.change / (change + 0.01)) < 1.3


def test_intervals_over_a_joint_have_no_bound():
    found = pace_bounds(STOPPING, np.array([1.0, 1.0]), np.array([2.0, 2.1]))
    assert np.isfinite(found.change).tolist() == [True, False]


@pytest.mark.parametrize("name", paths())
@pytest.mark.parametrize("side", [1, -1])
def test_lines_are_on_the_strict_side_and_close(name, side):
    path = paths()[name]
    on = distances(path)
    along = qt.Along(np.array([0.0, 0.4, 0.7]) * on.length, [9.0, 5.0, 12.0], "linear")
    low, high = cells(path, 40)
    line, rest = Varying(along, on, side).approximated(low, high)
    z = np.linspace(0.0, 1.0, 201)
    exact = np.asarray(along.at(on.at((low[:, None] + (high - low)[:, None] * z).ravel()))).reshape(-1, z.size)
    room = side * (exact - (line[:, :1] + (line[:, 1:] - line[:, :1]) * z))
    assert (room >= -1e-12).all()
    assert (room.max(axis=1) <= rest + 1e-12).all()
    assert np.median(rest) < 1e-2


def exact_value(coefficients, z):
    """Return the value of a polynomial with Bernstein coefficients, in the precision of mpmath."""
    rows = [mp.mpf(float(x)) for x in coefficients]
    while len(rows) > 1:
        rows = [a + (b - a) * mp.mpf(float(z)) for a, b in itertools.pairwise(rows)]
    return rows[0]


@pytest.mark.parametrize("name", ["helix", "route", "stops"])
@pytest.mark.parametrize(("side", "parts"), [(1, 1), (1, 10), (-1, 10)])
def test_curves_are_on_the_strict_side_and_close(name, side, parts):
    """The distance is integrated with 20 digits, from a distance at the start that differs by the uncertainty."""
    path = paths()[name]
    on = distances(path)
    along = qt.Along(np.array([0.0, 0.4, 0.7]) * on.length, [9.0, 5.0, 12.0], "linear")
    ends = np.unique(
        np.concatenate([*(np.append(*x) for x in [cells(path, parts)]), on.parameters(along.distance[1:])])
    )
    low, high = ends[:-1], ends[1:]
    found = curves(Varying(along, on, side), low, high)
    times = np.asarray(path.times if isinstance(path, qt.Route) else [0.0, path.duration], float)
    d, v = ([mp.mpf(float(x)) for x in y] for y in (along.distance, along.values))
    with mp.workdps(20):
        for k in np.linspace(0, low.size - 1, 3).astype(int):
            row = min(int(np.searchsorted(times, 0.5 * (low[k] + high[k]), side="right")) - 1, times.size - 2)
            pace = exact_pace(path, row, times[row])
            start = mp.mpf(float(on.at(low[[k]])[0]))
            for z in (0.13, 0.6, 1.0):
                u = float(low[k] + (high[k] - low[k]) * z)
                travelled = start + mp.quad(pace, [mp.mpf(float(low[k])), mp.mpf(u)], maxdegree=4)
                for error in (-1, 1):
                    s = travelled + error * mp.mpf(0.999 * on.uncertainty)
                    i = max(sum(s >= x for x in d) - 1, 0)
                    exact = v[i] + ((v[i + 1] - v[i]) * (s - d[i]) / (d[i + 1] - d[i]) if i < 2 else 0)
                    room = side * (exact - exact_value(found.coefficients[k], z))
                    assert 0 <= room <= found.rest[k] * (1 + 1e-6)
    if parts == 10 and name != "stops":
        slope = np.max(np.abs(np.diff(along.values) / np.diff(along.distance)))
        assert np.median(found.rest) < 3 * slope * on.uncertainty  # the error of a line here is about 1e-2
        assert (~found.rough).mean() > 0.5


def exact_pace(path, row, start):
    """Return |r'| as a function of the parameter, for the polynomials of mpmath."""
    if not isinstance(path, qt.Route):
        return speeds(path)
    c = np.asarray(path.in_time(), float)[row]
    rates = [[k * mp.mpf(float(x)) for k, x in enumerate(c[:, axis])][1:] for axis in range(3)]
    value = lambda own, t: sum((x * (t - mp.mpf(float(start))) ** k for k, x in enumerate(own)), mp.mpf(0))  # noqa: E731
    return lambda t: mp.sqrt(sum(value(own, t) ** 2 for own in rates))


@pytest.mark.parametrize("part", [1, 2])
@pytest.mark.parametrize("side", [1, -1])
def test_curves_of_angles_are_on_the_strict_side_of_tangents(part, side):
    rng = np.random.default_rng(part)
    curve = rng.uniform(0.2, 1.3, (40, 1)) + np.linspace(-0.1, 0.1, 6) + rng.uniform(-0.01, 0.01, (40, 6))
    curve = part * curve * rng.choice([-1, 1], (40, 1))
    strict, gap = strict_curve(curve, part, side), gap_of_curve(curve, part, side)
    for row, own, width in zip(curve, strict, gap, strict=True):
        for z in np.linspace(0.0, 1.0, 11):
            room = side * (mp.tan(exact_value(row, z) / part) - exact_value(own, z))
            assert 0 <= room <= 2 * width + 1e-12
    small = strict_curve(0.3 + np.linspace(0.0, 0.01, 6)[None], part, side)
    assert np.ptp(small) > 0
    assert strict_curve(np.full((1, 6), 0.3), part, 1) == pytest.approx(np.full((1, 6), tangent(0.3, part)))


STEEP = (
    ("helix", "curvature", [0.0, 0.4, 0.41], [0.39, 0.19, 0.45]),
    ("route", "lateral_acceleration", [0.0, 0.3, 0.302], [4.0, 2.0, 6.0]),
    ("timing", "speed", [0.0, 0.5, 0.505], [9.0, 6.5, 12.0]),
)


@pytest.mark.parametrize(("kind", "name", "at", "values"), STEEP)
def test_steep_limits_are_decided_within_the_uncertainty_of_the_distance(kind, name, at, values):
    """The largest ratio is found from samples of the path, refined around the largest one."""
    path = {"helix": HELIX, "route": random_route(np.random.default_rng(3))}.get(kind)
    if path is None:
        path = qt.retime(HELIX, qt.Limits(speed=7.0, longitudinal_acceleration=(-3, 2)), knots=32).path
    on = distances(path)
    along = qt.Along(np.array(at) * on.length, values, "linear")
    slope = np.max(np.abs(np.diff(values)) / np.diff(along.distance) / np.minimum(values[1:], values[:-1]))

    def ratios(t):
        return np.abs(qt.evaluate(path, t, (name,))[name]) / np.asarray(along.at(on.at(t)))

    low, high = 0.0, float(path.duration)
    for _ in range(6):
        t = np.linspace(low, high, 801)
        k = int(np.argmax(ratios(t)))
        low, high = t[max(k - 1, 0)], t[min(k + 1, 800)]
    worst, close = float(np.max(ratios(t))), 2e-9 + 3e-9 * slope * on.length
    for factor, status in ((1 + close, "proved"), (1 - close, "broken")):
        assert qt.certify(path, qt.Limits(**{name: along.scaled(worst * factor)})).status[name] == status


@pytest.mark.parametrize("name", ["tilt", "bank_angle", "steering_angle"])
@pytest.mark.parametrize("index", range(3))
def test_angles_may_change_linearly(name, index):
    rng = np.random.default_rng(index)
    path = HELIX if index == 0 else random_route(rng)
    car = qt.Vehicle(1e3, wheelbase=2.7)
    t = np.linspace(0.0, float(path.duration), 8001)
    outputs = ("velocity", name)
    table = qt.evaluate(path, t, outputs, vehicle=car)
    speed = np.linalg.norm(np.asarray(table.velocity), axis=1)
    s = np.append(0.0, np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t)))
    values = np.abs(np.asarray(table.values[name]))
    along = qt.Along(np.array([0.0, 0.3, 0.64]) * s[-1], np.quantile(values, 0.9) * rng.uniform(0.7, 1.6, 3), "linear")
    ratio = np.max(values / np.asarray(along.at(s)))
    for factor, status in ((1.002, "proved"), (0.998, "broken")):
        limit = along.scaled(factor * ratio)
        if np.max(np.asarray(limit.values)) < 1.5:
            assert qt.certify(path, qt.Limits(**{name: limit}, vehicle=car)).status[name] == status


def speeds(path):
    """Return the speed of a spiral-helix as a function of the time, in 50 digits."""
    r, angle, h = ([mp.mpf(float(x)) for x in c] for c in (path.radius, path.angle, path.height))

    def rate(c, t):
        return sum((k * x * t ** (k - 1) for k, x in enumerate(c) if k), mp.mpf(0))

    def value(c, t):
        return sum((x * t**k for k, x in enumerate(c)), mp.mpf(0))

    return lambda t: mp.sqrt(rate(r, t) ** 2 + (value(r, t) * rate(angle, t)) ** 2 + rate(h, t) ** 2)


@pytest.mark.parametrize("kind", ["step", "linear"])
def test_no_proof_is_contradicted_in_50_digits(kind):
    rng = np.random.default_rng(11)
    proved = 0
    for _ in range(3):
        v = rng.uniform(5.0, 9.0, 2)
        start = qt.BoundaryState([20.0, 0.0, 0.0], [rng.normal(), v[0], 0.3])
        path = qt.SpiralHelix.hermite(start, qt.BoundaryState([0.0, 24.0, 1.5], [-v[1], rng.normal(), 0.1]), 5.0)
        t, s, values = sampled(path, "speed", 2001)
        along = qt.Along(np.array([0.0, 0.3, 0.64]) * s[-1], np.quantile(values, 0.9) * rng.uniform(0.8, 1.3, 3), kind)
        ratios = values / np.asarray(along.at(s))
        worst = int(ratios.argmax())
        low, high = t[max(worst - 1, 0)], t[min(worst + 1, t.size - 1)]
        for change in (1e-3, 1e-6, -1e-7):
            limit = along.scaled(ratios.max() * (1 + change))
            if qt.certify(path, qt.Limits(speed=limit)).status["speed"] != "proved":
                continue
            proved += 1
            with mp.workdps(50):
                speed = speeds(path)
                travelled = mp.quad(speed, np.linspace(0.0, low, 4).tolist()) if low else mp.mpf(0)
                d, x = ([mp.mpf(float(y)) for y in z] for z in (limit.distance, limit.values))
                for k in range(11):
                    u = mp.mpf(float(low)) + (mp.mpf(float(high)) - mp.mpf(float(low))) * k / 10
                    at = travelled + mp.quad(speed, [mp.mpf(float(low)), u])
                    i = max(sum(at >= y for y in d) - 1, 0)
                    bound = x[i]
                    if kind == "linear" and i < 2:
                        bound += (x[i + 1] - x[i]) * (at - d[i]) / (d[i + 1] - d[i])
                    assert speed(u) <= bound
    assert proved >= 3
