"""Routes that are tuned to be near another path."""

import jax
import numpy as np
import pytest
from tests.design.test_tune_route import drive

import qtraj as qt

WIDE = qt.Limits(speed=40.0)


def beside(route, most=0.3, timing=1.0):
    """A path that is up to `most` to the left of a route, driven in another time."""
    t = np.linspace(0.0, float(route.duration), 600)
    table = qt.evaluate(route, t, ("position", "velocity"))
    left = np.asarray(table.velocity) @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 0]])
    left /= np.linalg.norm(left, axis=1)[:, None]
    points = np.asarray(table.position) + most * np.sin(np.pi * t / t[-1])[:, None] ** 2 * left
    times = t[-1] * (t / t[-1]) ** 1.5 * timing
    return qt.Curve(_spline(times, points), timing * t[-1]), points


def _spline(times, points):
    x = jax.numpy.asarray(times)
    columns = [jax.numpy.asarray(c) for c in points.T]
    return lambda t: jax.numpy.stack([jax.numpy.interp(t, x, c) for c in columns])


def distances(path, points):
    t = np.linspace(0.0, float(path.duration), 200)
    at = np.asarray(qt.evaluate(path, t, ("position",)).position)
    return np.min(np.linalg.norm(at[:, None] - points, axis=2), axis=1)


def test_without_active_limits_the_route_follows_the_other_path():
    route = drive()
    path, points = beside(route)
    found = qt.tune_route(route, WIDE, nearest_to=path)
    assert found.converged, found.result
    assert distances(route, points).max() > 0.29
    assert distances(found.path, points).max() < 0.12  # a point of the chords, and quintics of 1 s


def test_the_timing_of_the_other_path_does_not_matter():
    route, limits = drive(), qt.Limits(lateral_acceleration=1.5)
    one, other = (qt.tune_route(route, limits, nearest_to=beside(route, timing=x)[0]) for x in (1.0, 30.0))
    assert one.certificate.holds
    assert float(one.objective) == pytest.approx(float(other.objective), rel=1e-6)
    np.testing.assert_allclose(one.path.joints(), other.path.joints(), rtol=0, atol=1e-5)


def test_a_route_is_nearest_to_itself():
    route = drive()
    found = qt.tune_route(route, WIDE, nearest_to=route)
    assert found.converged
    assert np.abs(np.asarray(found.displacement)).max() < 1e-3
    assert float(found.objective) < 1e-4


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"objective": "fastest"}, "belongs to objective='nearest'"),
        ({"nearest_to": 3.0}, "path must be a path"),
    ],
)
def test_wrong_arguments_are_refused(options, match):
    route = drive(4)
    with pytest.raises(ValueError, match=match):
        qt.tune_route(route, WIDE, **({"nearest_to": route} | options))


def test_there_are_no_derivatives():
    route = drive(4)
    with pytest.raises(ValueError, match="does not support nearest_to inside jit, vmap, grad or jvp"):
        jax.grad(lambda x: qt.tune_route(route, qt.Limits(speed=x), nearest_to=route).objective)(9.0)
