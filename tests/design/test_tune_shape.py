"""The fastest lap within the widths of a track, against closed forms and distances from the centre line by SciPy."""

import time

import jax
import numpy as np
import pytest
from scipy.spatial import cKDTree
from tests.race_track import race_track

import qtraj as qt

RACE = qt.Limits(speed=60.0, lateral_acceleration=15.0, longitudinal_acceleration=8.0)
MAX_CPU = 10.0
"""Seconds of CPU for the lap of 2.3 km: spline, timing, tuning and proofs.

They are those of the thread that computes. Idle threads of BLAS spin, so their time depends on what else runs.
"""

CURVED = 2e-3
"""[m] The widths are those along normals at the joints; between the joints, the edges of the tube differ a little."""


def circle(radius=60.0, right=6.0, left=4.0, count=72):
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    points = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return qt.Shape.through(points, widths=np.full((count, 2), [right, left]))


def offsets(path, shape):
    """Distances (n,) of a path to the left of a shape, and its widths (n, 2) there, from dense samples."""
    u = np.linspace(0, float(shape.route.duration), 40_001)
    points, tangents = shape.route.sampled(u, 1)
    places = path.sampled(np.linspace(0, float(path.duration), 3001), 0)[0]
    _, k = cKDTree(points).query(places)
    d = tangents[k]
    left = np.stack([-d[:, 1], d[:, 0]], axis=1) / np.hypot(d[:, 0], d[:, 1])[:, None]
    times = np.asarray(shape.route.times)
    widths = [np.interp(u[k], times, column) for column in np.asarray(shape.widths).T]
    return np.sum((places - points[k])[:, :2] * left, axis=1), np.stack(widths, axis=1)


@pytest.fixture(scope="module")
def race():
    start = time.thread_time()
    points, widths = race_track()
    shape = qt.Shape.through(points, widths=widths)
    timed = qt.retime(shape, RACE)
    best = qt.tune_route(shape, RACE)
    return shape, timed, best, time.thread_time() - start


def test_race_track_is_driven_faster_within_its_widths(race):
    shape, timed, best, seconds = race
    assert seconds < MAX_CPU
    assert best.converged, best.result
    assert best.certificate.status == dict.fromkeys(RACE.given(), "proved")
    assert np.asarray(best.within).all()
    assert float(best.path.duration) < 0.95 * float(timed.duration)
    away, widths = offsets(best.path, shape)
    assert (away <= widths[:, 1] - 1.0 + CURVED).all()
    assert (-away <= widths[:, 0] - 1.0 + CURVED).all()
    assert np.ptp(away) > 5.0  # both edges are used


def test_race_track_is_closed_at_the_seam(race):
    states = np.asarray(race[2].path.joints(2))
    np.testing.assert_allclose(states[-1], states[0], atol=1e-9 * np.abs(states).max())
    lap = race[2].path
    assert qt.certify(lap + lap, RACE).holds


@pytest.mark.parametrize(("right", "left"), [(6.0, 4.0), (1.0, 5.0)])
def test_circle_is_driven_along_its_inner_edge(right, left):
    """At almost constant speed √(a·r), the lap takes 2π√(r/a), so the inner edge, to the left, is the fastest."""
    radius, lateral, margin = 60.0, 9.0, 0.5
    shape = circle(radius, right, left, 40)
    limits = qt.Limits(lateral_acceleration=lateral, longitudinal_acceleration=0.02)
    best = qt.tune_route(shape, limits, tube=shape.widths - margin)
    assert best.converged, best.result
    inner = radius - left + margin
    assert float(best.path.duration) == pytest.approx(2 * np.pi * np.sqrt(inner / lateral), rel=2e-3)
    distance = np.linalg.norm(np.asarray(best.path.joints(0))[:, 0], axis=1)
    assert distance.min() > inner - 1e-3


def test_tubes_of_equal_width_are_the_same():
    shape, limits = circle(count=40), qt.Limits(lateral_acceleration=9.0, longitudinal_acceleration=2.0)
    known = qt.tune_route(shape, limits, tube=(2.0, 0.05))
    for tube in (2.0, (2.0, 0.1), np.full(41, 2.0), np.full((41, 2), 2.0)):
        found = qt.tune_route(shape, limits, tube=tube)
        assert found.converged
        assert float(found.path.duration) == pytest.approx(float(known.path.duration), rel=1e-4)


def test_open_shape_keeps_its_ends():
    x = np.linspace(0, 300, 61)
    points = np.stack([x, 15 * np.sin(x / 30), 0.02 * x], axis=1)
    shape = qt.Shape.through(points, widths=np.full((61, 2), [4.0, 4.0]))
    timed, best = qt.retime(shape, RACE), qt.tune_route(shape, RACE)
    assert best.converged, best.result
    assert float(best.path.duration) < float(timed.duration) * (1 - 1e-3)
    np.testing.assert_allclose(best.path.joints(0)[[0, -1], 0], points[[0, -1]], atol=1e-6)
    assert np.linalg.norm(best.path.velocity(0.0)) == pytest.approx(float(timed.speeds[0]), rel=1e-6)
    assert np.asarray(best.distance)[:, 1].max() <= 0.05


def test_nearest_route_satisfies_a_limit_on_the_shape():
    shape = circle(20.0, 4.0, 4.0, 40)
    limits = qt.Limits(curvature=0.049, speed=10.0, longitudinal_acceleration=2.0)
    best = qt.tune_route(shape, limits, objective="nearest")
    assert best.converged, best.result
    assert qt.certify(best.path, limits).holds


def test_derivative_of_the_lap_time():
    shape, step = circle(count=36), 0.05

    def lap(lateral):
        return qt.tune_route(shape, qt.Limits(lateral_acceleration=lateral, longitudinal_acceleration=2.0)).objective

    known = (float(lap(9.0 + step)) - float(lap(9.0 - step))) / (2 * step)
    assert float(jax.grad(lap)(9.0)) == pytest.approx(known, rel=0.02)
    with pytest.raises(ValueError, match=r"needs concrete values.*once for each shape"):
        jax.jit(lap)(9.0)


@pytest.mark.parametrize(
    ("options", "limits", "message"),
    [
        ({"tube": np.ones((3, 2))}, RACE, r"shape \(73, 2\)"),
        ({"tube": np.full((73, 2), -1.0)}, RACE, "too narrow"),
        ({"tube": -1.0}, RACE, "positive and finite"),
        ({"objective": "widest"}, RACE, "the objective must be"),
        ({}, qt.Limits(curvature=1.0), "bounds the speed"),
        ({}, qt.Limits(torsion=1.0, speed=3.0), "natural trihedral"),
    ],
)
def test_wrong_arguments_are_refused(options, limits, message):
    with pytest.raises(ValueError, match=message):
        qt.tune_route(circle(), limits, **options)


def test_tracks_without_widths_or_with_narrow_ones_are_refused():
    bare = qt.Shape(circle().route, closed=True)
    with pytest.raises(ValueError, match="needs the widths"):
        qt.tune_route(bare, RACE)
    with pytest.raises(ValueError, match=r"too narrow.*tube=shape\.widths - 0\.5"):
        qt.tune_route(circle(right=0.9, left=0.9), RACE)


def square(x, y, half):
    return [(x - half, y - half), (x + half, y - half), (x + half, y + half), (x - half, y + half)]


@pytest.mark.parametrize(
    ("joints", "half"),
    [
        (6, 7.0),
        pytest.param(8, 7.0, marks=pytest.mark.slow),
        pytest.param(8, 12.0, marks=pytest.mark.slow),
    ],
)
def test_a_region_that_begins_inside_a_segment(joints, half):
    """The stricter value on the whole segments would contradict the speed at the start, which is fixed."""
    x = np.linspace(0.0, 120.0, joints)
    shape = qt.Shape.through(np.stack([x, 10 * np.sin(x / 25), 0 * x], axis=1))
    region = qt.Regions([(square(50.0, 8.0, half), 5.0)], outside=15.0)
    limits = qt.Limits(speed=region, longitudinal_acceleration=(-4.0, 2.0), lateral_acceleration=3.0)
    best = qt.tune_route(shape, limits, 1.0)
    assert best.certificate.holds
    t = np.linspace(0.0, float(best.path.duration), 4001)
    table = qt.evaluate(best.path, t, ["position", "speed"])
    inside = (np.abs(table.position[:, :2] - np.array([50.0, 8.0])) < half).all(axis=1)
    speed = np.asarray(table.speed)
    assert inside.any()
    assert speed[inside].max() <= 5.0
    assert speed[~inside].max() > 10.0  # only near the region is the route slow
