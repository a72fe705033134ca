"""Shapes: splines through points against SciPy and closed forms, closing, cusps, widths, documents and limits."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.special import ellipe

import qtraj as qt

UTM = np.array([623425.5, 4848821.0, 153.8])


def ellipse(a=80.0, b=50.0, count=200, origin=(0.0, 0.0, 0.0)):
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return np.stack([a * np.cos(angle), b * np.sin(angle), 0 * angle], axis=1) + np.asarray(origin)


def winding(count=30, seed=1):
    """Points at uneven distances along a smooth curve in space."""
    x = np.cumsum(np.random.default_rng(seed).uniform(2.0, 6.0, count))
    return np.stack([x, 20 * np.sin(x / 25), 0.05 * x], axis=1) + UTM


@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), tuple(UTM)], ids=["local", "UTM"])
def test_closed_shape_is_the_ellipse(origin):
    """Length and curvature of an ellipse are known; the error of a quintic spline is O(h^6) and O(h^4)."""
    a, b = 80.0, 50.0
    shape = qt.Shape.through(ellipse(a, b, origin=origin))
    assert shape.closed
    assert float(shape.length) == pytest.approx(4 * a * ellipe(1 - b * b / a / a), rel=1e-8)
    largest = a / b**2
    assert qt.certify(shape, qt.Limits(curvature=largest * (1 + 1e-5))).status == {"curvature": "proved"}
    assert qt.certify(shape, qt.Limits(curvature=largest * (1 - 1e-5))).status == {"curvature": "broken"}
    assert qt.certify(shape, qt.Limits(slope=1e-6)).holds


def test_order_of_convergence_of_the_length():
    errors = []
    for count in (24, 48):
        length = float(qt.Shape.through(ellipse(count=count)).length)
        errors.append(abs(length - 320.0 * ellipe(1 - 25 / 64)))
    assert errors[0] / errors[1] > 2.0**5


def test_seam_of_a_closed_shape_is_as_smooth_as_its_joints():
    shape = qt.Shape.through(ellipse())
    states = np.asarray(shape.route.joints(4))
    scale = np.abs(states).max(axis=(0, 2))
    np.testing.assert_allclose(states[-1] / scale[:, None], states[0] / scale[:, None], rtol=0, atol=1e-9)
    np.testing.assert_allclose(shape.route.jumps(4) / scale[:, None], 0.0, atol=1e-9)


def test_open_shape_is_the_natural_quintic_of_scipy():
    points = winding()
    shape = qt.Shape.through(points)
    assert not shape.closed
    chord = np.append(0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    ends = [(3, np.zeros(3)), (4, np.zeros(3))]
    known = make_interp_spline(chord, points - points[0], k=5, bc_type=(ends, ends))
    u = np.linspace(0, chord[-1], 500)
    found = shape.route.sampled(u, 3)
    np.testing.assert_allclose(found[0], known(u) + points[0], atol=1e-8)
    for k in range(1, 4):
        np.testing.assert_allclose(found[k], known(u, nu=k), atol=1e-10)
    np.testing.assert_allclose(shape.points, points, atol=1e-8)
    assert np.linalg.norm(found[1], axis=1) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("count", [2, 3, 4, 5])
def test_few_points(count):
    points = winding()[:count]
    shape = qt.Shape.through(points)
    np.testing.assert_allclose(shape.points[[0, -1]], points[[0, -1]], atol=1e-8)
    if count == 2:
        assert float(shape.length) == pytest.approx(np.linalg.norm(points[1] - points[0]))
        assert qt.certify(shape, qt.Limits(curvature=1e-12)).holds


def test_tolerance_is_the_rms_distance_of_noisy_points():
    rng, clean = np.random.default_rng(3), ellipse(count=400)
    noisy = clean + rng.normal(0, 0.1, clean.shape) * [1, 1, 0]
    shape = qt.Shape.through(noisy, tolerance=0.15)
    assert shape.closed
    assert shape.route.segments < 100
    chord = np.append(0, np.cumsum(np.linalg.norm(np.diff(np.vstack([noisy, noisy[:1]]), axis=0), axis=1)))
    away = np.linalg.norm(shape.route.sampled(chord[:-1], 0)[0] - noisy, axis=1)
    assert np.sqrt(np.mean(away**2)) == pytest.approx(0.15, rel=0.01)
    states = np.asarray(shape.route.joints(4))
    np.testing.assert_allclose(states[-1], states[0], atol=1e-6)


@pytest.mark.parametrize(
    ("points", "closed"),
    [
        (ellipse(count=12), True),
        (np.vstack([ellipse(count=40), ellipse(count=40)[:1]]), True),
        (ellipse(count=40)[:-3], False),
        ([[0, 0], [100, 0], [100, 5], [0, 5]], False),  # there and back
        ([[0, 0], [1, 0], [0.5, 1]], False),
        ([[0, 0], [1, 0], [1, 1], [0, 1]], False),  # a square turns by 90°
        ([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]], True),
    ],
)
def test_closed_curves_are_recognised(points, closed):
    assert qt.Shape.through(points).closed is closed
    assert qt.Shape.through(points, closed=False).closed is False
    assert qt.Shape.through(points, closed=True).closed is True


def test_repeated_points_are_merged_with_a_warning():
    points = ellipse(count=50)
    twice = np.repeat(points, 2, axis=0)
    with pytest.warns(UserWarning, match="50 of 100 points"):
        shape = qt.Shape.through(twice, widths=np.full((100, 2), 4.0))
    assert shape.closed
    assert shape.route.segments == 50
    assert shape.widths.shape == (51, 2)


def test_widths_belong_to_the_joints():
    points = winding()
    widths = np.stack([np.linspace(3, 5, 30), np.linspace(6, 4, 30)], axis=1)
    np.testing.assert_allclose(qt.Shape.through(points, widths=widths).widths, widths, rtol=1e-12)
    closed = qt.Shape.through(ellipse(count=30), widths=widths)
    np.testing.assert_array_equal(closed.widths[-1], closed.widths[0])
    np.testing.assert_allclose(closed.widths[:-1], widths, rtol=1e-12)


@pytest.mark.parametrize("suffix", ["json", "toml"])
@pytest.mark.parametrize("widths", [None, np.full((20, 2), [3.0, 4.5])])
def test_saved_shape_is_the_same(tmp_path, suffix, widths):
    shape = qt.Shape.through(ellipse(count=20, origin=UTM), widths=widths)
    shape.save(tmp_path / f"shape.{suffix}")
    again = qt.load(tmp_path / f"shape.{suffix}")
    assert again.closed
    np.testing.assert_array_equal(again.route.joints(5), shape.route.joints(5))
    assert (again.widths is None) if widths is None else (np.asarray(again.widths) == np.asarray(shape.widths)).all()
    assert "closed" in repr(again)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([[0, 0], [1, 0], [0.5, 0]],), "cusp.*at \\(1, 0, 0\\) m|cusp, or almost one, at"),
        (([[0, 0], [0, 0]],), "two different points"),
        (([[0, 0], [1, 0]], True), "three different points"),
        (([0, 1, 2],), "shape \\(n, 3\\)"),
        (([[0, 0], [np.nan, 1]],), "point 1"),
        (([[0, 0], [1e300, 0]],), "point 1 .*other units"),
        (("road",), "array of numbers"),
        ((winding(), None, -1.0), "tolerance"),
        ((winding()[:4], None, 0.1), "at least 6 points"),
        ((winding(), None, None, np.ones((3, 2))), "shape \\(30, 2\\)"),
        ((winding(), None, None, -np.ones((30, 2))), "at least 0"),
    ],
)
def test_bad_points_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        qt.Shape.through(*arguments)


def test_route_with_a_stop_or_different_ends_is_no_shape():
    times, zero = [0.0, 1.0], np.zeros((2, 3))
    stop = qt.Route(times, [[0.0, 0, 0], [1.0, 0, 0]], zero, zero)
    with pytest.raises(ValueError, match="cusp"):
        qt.Shape(stop)
    with pytest.raises(ValueError, match="position at its ends"):
        qt.Shape(qt.Shape.through(winding()).route, closed=True)
    half = qt.Route(times, zero, [[1.0, 0, 0], [-1.0, 0, 0]], [[0.0, 4, 0], [0.0, -4, 0]])
    with pytest.raises(ValueError, match="direction at its ends"):
        qt.Shape(half, closed=True)


def test_limits_that_need_times_are_refused():
    with pytest.raises(ValueError, match=r"no times, so limits on speed.*qtraj\.retime"):
        qt.certify(qt.Shape.through(ellipse()), qt.Limits(speed=10.0, curvature=0.1))


def test_dataset_of_a_shape():
    widths = np.full((20, 2), [3.0, 4.5])
    found = qt.Shape.through(ellipse(count=20), widths=widths).to_xarray()
    np.testing.assert_allclose(found.position.values[:-1], ellipse(count=20), atol=1e-9)
    np.testing.assert_array_equal(found.widths.sel(side="left"), 4.5)
    assert found.parameter.attrs["units"] == "m"
    assert "side" not in qt.Shape.through(ellipse()).to_xarray().coords
