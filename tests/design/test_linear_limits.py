"""Limits that change linearly along the way: bounds on the pace, lines on the strict side, and proofs with them."""

import itertools

import mpmath as mp
import numpy as np
import pytest
from tests.design.test_along import HELIX, random_route, sampled

import qtraj as qt
from qtraj.design.varying import Varying
from qtraj.path.angle import gap_of_line, strict_line, tangent
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


@pytest.mark.parametrize("part", [1, 2])
@pytest.mark.parametrize("side", [1, -1])
def test_lines_of_angles_are_on_the_strict_side_of_tangents(part, side):
    rng = np.random.default_rng(part)
    line = rng.uniform(-1.4, 1.4, (50, 2)) * part
    strict = strict_line(line, part, side)
    gap = gap_of_line(line, part)
    for row, ends, width in zip(line, strict, gap, strict=True):
        for z in np.linspace(0.0, 1.0, 21):
            exact = mp.tan((mp.mpf(row[0]) + (mp.mpf(row[1]) - mp.mpf(row[0])) * z) / part)
            room = side * (exact - (mp.mpf(ends[0]) + (mp.mpf(ends[1]) - mp.mpf(ends[0])) * z))
            assert 0 <= room <= 2 * width + 1e-12
    assert strict_line(np.array([[0.3, 0.3]]), part, 1) == pytest.approx(np.full((1, 2), tangent(0.3, part)))


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
