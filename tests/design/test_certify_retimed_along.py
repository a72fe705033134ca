"""Limits that change along the way, on a timing that was made for other limits: cells are divided for the proof."""

from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import qtraj as qt
from qtraj.design.proof.certificate import PROVED
from qtraj.design.timing import pieces
from qtraj.design.timing.constraints import NAMES
from qtraj.design.timing.pieces import proved_in_pieces
from qtraj.design.timing.retimed_cells import cells_of
from qtraj.design.timing.retimed_maxima import Limited
from qtraj.design.timing.sources import source
from qtraj.design.timing.timing import RetimedPath, Timing
from qtraj.design.varying import on_path

LIMITS = qt.Limits(speed=12.0, lateral_acceleration=3.0, longitudinal_acceleration=2.0)
SAMPLES = 20001


def retimed(index):
    """Return a random retimed helix or route, from rest to rest."""
    rng = np.random.default_rng(index)
    if index % 2:
        points = np.cumsum(rng.normal(0, 1, (5, 3)) * [4, 4, 0.4] + [15, 0, 0], axis=0)
        path = qt.Route.from_piecewise(CubicSpline(np.cumsum(rng.uniform(2, 8, 5)), points))
    else:
        start = qt.BoundaryState([20.0, 0.0, 0.0], [rng.normal(), rng.uniform(5.0, 9.0), 0.3])
        path = qt.SpiralHelix.hermite(start, qt.BoundaryState([0.0, 26.0, 1.5], [-7.0, rng.normal(), 0.1]), 5.0)
    return qt.retime(path, LIMITS, 0.0, 0.0).path


def sampled(path, name):
    """Return dense distances [m] and the values of a quantity."""
    t = np.linspace(0.0, float(path.duration), SAMPLES)
    table = qt.evaluate(path, t, ["velocity", "acceleration"])
    v, a = np.asarray(table.velocity), np.asarray(table.acceleration)
    speed = np.linalg.norm(v, axis=1)
    s = np.append(0.0, np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t)))
    across = np.linalg.norm(np.cross(v, a), axis=1) / np.maximum(speed, 1e-9)
    values = {"speed": speed, "acceleration": np.linalg.norm(a, axis=1), "lateral_acceleration": across}[name]
    return s[3:-3], values[3:-3]


def random_limit(path, name, kind, rng):
    """Return a random limit that is just satisfied at the samples."""
    s, values = sampled(path, name)
    count = int(rng.integers(2, 6))
    at = np.sort(np.append(0.0, rng.uniform(0.02, 0.98, count - 1))) * s[-1]
    along = qt.Along(at, np.quantile(values, 0.8) * rng.uniform(0.5, 1.6, count), kind)
    return along.scaled(np.max(values / np.asarray(along.at(s))))


@pytest.mark.parametrize("kind", ["step", "linear"])
@pytest.mark.parametrize("index", range(4))
def test_limits_that_the_timing_was_not_made_for(index, kind):
    path, rng = retimed(index), np.random.default_rng(index)
    for name in ("speed", "acceleration", "lateral_acceleration"):
        along = random_limit(path, name, kind, rng)
        for factor, status in ((1.001, "proved"), (0.999, "broken")):
            limits: Any = {name: along.scaled(factor)}
            found = qt.certify(path, qt.Limits(**limits))
            assert found.status[name] == status
            assert found.margin(name) < 0.02 * found.worst[name][2]


def test_a_linear_limit_that_bends_within_cells_is_compared_itself():
    """On the whole cell, the line would be a constant: the limit would seem to be violated by 2 %."""
    path = retimed(0)
    s, values = sampled(path, "speed")
    along = qt.Along(np.array([0.0, 0.3, 0.65]) * s[-1], [0.5, 1.0, 0.8], "linear")
    ratio = values / np.asarray(along.at(s))
    found = qt.certify(path, qt.Limits(speed=along.scaled(1.001 * ratio.max())))
    assert found.status == {"speed": "proved"}
    _, value, limit = found.worst["speed"]
    assert (value, limit) == pytest.approx((values[ratio.argmax()], 1.001 * values[ratio.argmax()]), rel=1e-4)


@pytest.mark.parametrize("factor", [1.0005, 0.9995])
@pytest.mark.parametrize("kind", ["step", "linear"])
def test_what_is_proved_in_pieces_is_not_contradicted_by_samples(monkeypatch, kind, factor):
    """Cells are divided here although the samples violate the limit; then only the pieces without violation pass."""
    monkeypatch.setattr(pieces._Problem, "violated", lambda *_: False)
    path = retimed(1)
    cells: Any = cells_of(path)
    polynomials: Any = source(path.path)
    along = random_limit(path, "speed", kind, np.random.default_rng(7)).scaled(factor)
    bounds = on_path({"speed": along}, path.path)
    limited, codes = proved_in_pieces(Limited(path, cells, bounds, None), polynomials)
    code, count = codes[NAMES.index("speed")], codes.shape[1]
    assert count > cells.columns.size
    place = np.tile(np.linspace(0.0, 1.0, 21), count)
    usage = limited.usage(np.repeat(np.arange(count), 21), place, ("speed",)).reshape(count, 21).max(axis=1)
    assert (usage[code == PROVED] <= 1 + 1e-12).all()
    knots, violated = np.asarray(limited.path.timing.knots), usage > 1 + 1e-6
    assert violated.any() == (factor < 1)
    on: Any = bounds["speed"].on
    lengths = np.diff(on.at(knots))
    rest = lengths[(code != PROVED) & ~violated]
    assert not rest.size or (kind == "step" and rest.max() < 1e-6 * on.length)  # beside a step
    assert np.allclose(limited.path.timing.times, path.timing.times_of(knots), rtol=0, atol=1e-9)


def test_several_limits_may_change_and_others_remain():
    path, rng = retimed(2), np.random.default_rng(0)
    along = {name: random_limit(path, name, "linear", rng) for name in ("speed", "acceleration")}
    both: Any = {"speed": along["speed"].scaled(1.002), "acceleration": along["acceleration"].scaled(0.99)}
    found = qt.certify(path, qt.Limits(**both, lateral_acceleration=3.0, longitudinal_acceleration=1.5, curvature=9.0))
    assert found.status == {
        "speed": "proved",
        "acceleration": "broken",
        "lateral_acceleration": "proved",
        "longitudinal_acceleration": "broken",
        "curvature": "proved",
    }


OWN = {
    "speed": qt.Quantity("own_speed", "m/s", lambda p: p.speed),
    "longitudinal_acceleration": qt.Quantity("pull", "m/s^2", lambda p: p.velocity.dot(p.acceleration) / p.speed),
}


@pytest.mark.parametrize("kind", ["step", "linear"])
@pytest.mark.parametrize("index", [0, 1])
def test_limits_on_own_quantities_are_proved_like_the_equal_built_in_ones(index, kind):
    path, rng = retimed(index), np.random.default_rng(index)
    length = float(path.length())
    fast = random_limit(path, "speed", kind, rng)
    pull = qt.Along([0.0, 0.4 * length], [2.3, 2.1], kind)
    for factor, status in ((1.001, "proved"), (0.7, "broken")):
        bounds = {
            "speed": fast.scaled(factor),
            "longitudinal_acceleration": (pull.scaled(-factor), pull.scaled(factor)),
        }
        given: Any = bounds
        found = qt.certify(path, qt.Limits(own={OWN[name]: bound for name, bound in bounds.items()}))
        same = qt.certify(path, qt.Limits(**given))
        assert list(found.status.values()) == list(same.status.values())
        assert set(found.status) == {"own_speed", "pull_min", "pull_max"}
        assert status in found.status.values()
        assert found.holds == (status == "proved")
        np.testing.assert_allclose(found.values, same.values, rtol=1e-6)


def test_an_own_quantity_may_change_beside_a_constant_one_and_built_in_ones():
    """Statuses keep their rows when only some of the limits are judged again in halved cells."""
    path, rng = retimed(1), np.random.default_rng(1)
    fast = random_limit(path, "speed", "step", rng)
    own: Any = {OWN["longitudinal_acceleration"]: 1.0, OWN["speed"]: fast.scaled(1.001)}
    found = qt.certify(path, qt.Limits(speed=fast.scaled(0.99), acceleration=9.0, own=own))
    assert found.status == {"speed": "broken", "acceleration": "proved", "pull": "broken", "own_speed": "proved"}


def test_steps_without_a_limit():
    path = retimed(3)
    s, values = sampled(path, "speed")
    slow = s[values.argmax()] + 0.02 * s[-1]
    along = qt.Along([0.0, slow, 0.9 * s[-1]], [None, 1.001 * values[s >= slow].max(), None])
    assert qt.certify(path, qt.Limits(speed=along)).status == {"speed": "proved"}
    assert qt.certify(path, qt.Limits(speed=along.scaled(0.99))).status == {"speed": "broken"}


def test_halves_are_dyadic_and_in_order():
    found = pieces.Pieces(np.arange(3), np.zeros(3), np.ones(3))
    found, _ = found.halved(np.array([False, True, False]))
    found, index = found.halved(np.array([False, False, True, False]))
    assert index.tolist() == [0, 1, 2, 2, 3]
    assert found.cell.tolist() == [0, 1, 1, 1, 2]
    assert found.start.tolist() == [0.0, 0.0, 0.5, 0.75, 0.0]
    assert found.end.tolist() == [1.0, 0.5, 0.75, 1.0, 1.0]


def test_a_contact_beside_a_step_is_decided_exactly():
    """The largest speed is 3 exactly, or more by one rounding error."""
    rng = np.random.default_rng(1)
    for duration, place in zip(rng.uniform(1.0, 2.0, 12), rng.uniform(0.37, 0.45, 12), strict=True):
        path, along = qt.SpiralHelix([20.0, 3.0], [0.3], [0.0], duration), [0.0, 3 * duration * place]
        for first, status in ((0.9375, "proved"), (np.nextafter(0.9375, 1.0), "broken")):
            timing = Timing(np.array([[first, 0.5, -1.0, 0.0]]), np.array([0.0, duration]), np.zeros(2, bool))
            found = qt.certify(RetimedPath(path, timing), qt.Limits(speed=qt.Along(along, [3.0, 2.98])))
            assert found.status == {"speed": status}


@pytest.mark.parametrize("index", [0, 1])
def test_a_linear_limit_is_not_broken_where_only_its_lines_are(index):
    """The lines are stricter by up to 1e-7, so next to the largest value the status may be undecided."""
    path, rng = retimed(index), np.random.default_rng(index)
    along, seen = random_limit(path, "speed", "linear", rng), set()
    _, value, limit = qt.certify(path, qt.Limits(speed=along.scaled(1.001))).worst["speed"]
    for excess in (-1e-6, 0.0, 1e-10, 1e-9, 1e-8, 1e-5):
        found = qt.certify(path, qt.Limits(speed=along.scaled(1.001 * value / limit * (1 + excess))))
        _, own, bound = found.worst["speed"]
        assert found.status["speed"] != "broken" or own > bound
        seen.add(found.status["speed"])
    assert {"proved", "broken"} <= seen


@pytest.mark.parametrize("cell", [0.2, 0.3])
def test_a_linear_limit_that_is_violated_just_after_the_start_of_a_cell_is_decided(cell):
    """The line touches the speed, which is concave, so that the largest samples are at the end of the cell before."""
    line = qt.Route([0.0, 10.0], [[0.0, 0, 0], [100, 0, 0]], [[10.0, 0, 0], [10, 0, 0]], np.zeros((2, 3)))
    path = qt.retime(line, qt.Limits(speed=15.0, longitudinal_acceleration=2.0), 3.0, 3.0).path
    knots, powers = (np.asarray(x) for x in (path.timing.knots, path.timing.coefficients))
    k = int(cell * len(powers))
    width, z = knots[k + 1] - knots[k], 0.014
    square = 100.0 * powers[k] @ z ** np.arange(4)
    slope = 100.0 * powers[k, 1:] @ (np.arange(1, 4) * z ** np.arange(3)) / width / 10.0
    speed, s = np.sqrt(square), 10.0 * (knots[k] + z * width)
    touching = [speed + slope / (2 * speed) * (x - s) for x in (0.0, 100.0)]
    for factor, status in ((1 - 3e-9, "broken"), (1 + 3e-9, "proved")):
        limit = qt.Along([0.0, 100.0], factor * np.array(touching), "linear")
        assert qt.certify(path, qt.Limits(speed=limit)).status["speed"] == status
