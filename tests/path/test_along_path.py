"""Distances along paths of every kind, the instants at distances, and nearest points."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize_scalar

import qtraj as qt

SPIRAL = qt.SpiralHelix([10.0, 1.0, -0.01], [0, 0.7, 0.01], [0, 0.5], 20.0)
CIRCLE = qt.SpiralHelix([10.0], [0.0, 1.0], [0.0], 2.0)


class Own(qt.AbstractHodograph):
    """A path of the user with a corner at half its duration, which its nodes tell."""

    duration: float = 6.0

    def derivatives(self, t, order):
        zero = jnp.zeros(3)
        slow = jnp.array([1.0, 0, 0])
        quick = jnp.array([0.0, 2, 0])
        position = jnp.where(t < 3, slow * t, 3 * slow + quick * (t - 3))
        return jnp.stack([position, jnp.where(t < 3, slow, quick), *[zero] * (order - 1)][: order + 1])

    def nodes(self):
        return jnp.array([0.0, 3.0, 6.0])


def cycloid(t):
    """The path of a point on a wheel, which stops at multiples of 2π; its length to t ≤ 2π is 4(1 − cos t/2)."""
    return jnp.stack([t - jnp.sin(t), 0.0 * t, 1 - jnp.cos(t)])


CYCLOID = qt.Curve(cycloid, 4 * np.pi)
PATHS = {
    "spiral-helix": SPIRAL,
    "curve": qt.Curve(lambda t: jnp.stack([3 * jnp.cos(t), jnp.sin(2 * t), t]), 5.0),
    "own class": Own(),
    "retimed": qt.retime(
        qt.Route([0, 4, 9], [[0, 0, 0], [8, 3, 1], [20, 0, 0]], [[2, 0, 0]] * 3, np.zeros((3, 3))),
        qt.Limits(speed=4.0, acceleration=1.5),
        knots=16,
    ).path,
}


@pytest.fixture(scope="module", params=PATHS)
def path(request):
    return PATHS[request.param]


def length_until(path, t):
    """The integral of the speed by Gauss's rule of 20 points on 20 equal parts between nodes."""
    nodes = path.nodes()
    inner = [] if nodes is None else [x for x in np.unique(nodes) if 0 < x < t]
    ends = np.interp(np.arange(20 * (len(inner) + 1) + 1) / 20, np.arange(len(inner) + 2), [0.0, *inner, t])
    x, weights = np.polynomial.legendre.leggauss(20)
    half = np.diff(ends)[:, None] / 2
    times = ends[:-1, None] + half * (1 + x)
    speeds = np.asarray(qt.evaluate(path, times.ravel(), ("speed",)).values["speed"]).reshape(times.shape)
    return float(np.sum(half * weights * speeds))


def speed(path, t):
    return float(np.linalg.norm(np.asarray(path.velocity(t))))


def test_distances_and_their_instants_agree_with_a_quadrature(path):
    duration = float(path.duration)
    for t in (0.13 * duration, 0.71 * duration):
        right = length_until(path, t)
        distance = path.arc_length(t)
        assert float(distance) == pytest.approx(right, rel=1e-6)  # the accuracy of `length` at corners
        assert float(path.time_at(distance)) == pytest.approx(t, abs=1e-7 * duration)
        slope = jax.grad(lambda s: path.time_at(s))(jnp.asarray(right))
        assert float(slope) == pytest.approx(1 / speed(path, t), rel=1e-5)
    assert float(path.arc_length(duration)) == float(path.length())


def test_instants_of_distances_outside_a_path_are_its_ends(path):
    assert float(path.time_at(0.0)) == float(path.time_at(-3.0)) == float(path.arc_length(0.0)) == 0.0
    assert float(path.time_at(1.0 + float(path.length()))) == pytest.approx(float(path.duration), rel=1e-12)


def test_closed_forms_of_a_helix_and_of_a_path_that_stops():
    helix = qt.SpiralHelix([3.0], [0, 2.0], [0, 8.0], 7.0)
    assert float(helix.arc_length(2.5)) == pytest.approx(25.0, rel=1e-13)
    assert float(helix.time_at(25.0)) == pytest.approx(2.5, rel=1e-13)
    for t in (0.3, 3.0, 6.0):
        length = 4 * (1 - np.cos(t / 2))
        assert float(CYCLOID.arc_length(t)) == pytest.approx(length, rel=1e-9)
        assert float(CYCLOID.time_at(length)) == pytest.approx(t, abs=1e-8)
    assert float(CYCLOID.time_at(8.0)) == pytest.approx(2 * np.pi, abs=1e-3)
    assert np.isfinite(float(jax.grad(CYCLOID.time_at)(8.0)))


@pytest.mark.parametrize("argument", ["radius", "distance"])
def test_derivatives_of_an_instant_against_closed_forms(argument):
    def instant(radius, distance):
        return qt.SpiralHelix([radius], [0, 2.0], [0, 8.0], 7.0).time_at(distance)

    slopes = jax.jacobian(instant, argnums=(0, 1))(3.0, 20.0)
    right = {"radius": -20.0 * 4 * 3.0 / 1000.0, "distance": 0.1}  # t = s/√(4R² + 64)
    assert float(slopes[argument == "distance"]) == pytest.approx(right[argument], rel=1e-9)


def test_distances_under_jit_and_vmap_equal_those_in_numpy():
    @jax.jit
    @jax.vmap
    def in_jax(radius):
        path = qt.SpiralHelix([radius], [0, 0.7, 0.01], [0, 0.5], 20.0)
        return path.arc_length(11.0), path.time_at(60.0), path.nearest([3.0, 4.0, 5.0])

    radii = np.array([8.0, 10.0, 15.0])
    found = in_jax(radii)
    for k, radius in enumerate(radii):
        path = qt.SpiralHelix([radius], [0, 0.7, 0.01], [0, 0.5], 20.0)
        right = path.arc_length(11.0), path.time_at(60.0), path.nearest([3.0, 4.0, 5.0])
        assert isinstance(right[0], np.floating | np.ndarray)
        for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(right), strict=True):
            np.testing.assert_allclose(a[k], b, rtol=1e-10, atol=1e-10)


def test_the_nearest_point_against_a_dense_search(path):
    rng = np.random.default_rng(3)
    times = np.linspace(0, float(path.duration), 4001)
    dense = np.asarray(qt.evaluate(path, times, ("position",)).position)
    for _ in range(4):
        point = dense[rng.integers(len(dense))] + rng.normal(0, 1.0, 3)
        squares = np.sum((dense - point) ** 2, axis=1)
        k = int(squares.argmin())
        refined = minimize_scalar(
            lambda t: float(np.sum((np.asarray(path.position(t)) - point) ** 2)),  # noqa: B023
            bounds=(times[max(k - 1, 0)], times[min(k + 1, 4000)]),
            method="bounded",
            options={"xatol": 1e-10},
        )
        found = path.nearest(point)
        right = np.sqrt(min(refined.fun, squares[k]))
        assert float(found.distance) <= right + 1e-6
        assert float(found.distance) == pytest.approx(right, abs=1e-6)
        np.testing.assert_allclose(found.position, path.position(found.time), atol=1e-6)
        away = (point - np.asarray(found.position)) / float(found.distance)
        np.testing.assert_allclose(jax.grad(lambda x: path.nearest(x).distance)(jnp.asarray(point)), away, atol=1e-5)


def test_the_nearest_point_of_a_path_of_many_turns():
    """Six thousand turns: samples at the usual 1025 instants would miss most of them."""
    path = qt.SpiralHelix([10.0], [0, 1.0], [0, 0.01], 12_000 * np.pi)
    point = np.asarray(path.position(12345.6)) * [1.2, 1.2, 1.0]
    found = path.nearest(point)
    assert float(found.time) == pytest.approx(12345.6, abs=1e-6)
    assert float(found.distance) == pytest.approx(2.0, abs=1e-9)


def test_the_nearest_point_at_a_corner_and_at_an_end():
    assert float(Own().nearest([4.0, -1.0, 0.0]).time) == pytest.approx(3.0, abs=1e-6)
    assert float(Own().nearest([-1.0, -1.0, 0.0]).time) == 0.0
    with pytest.raises(ValueError, match="the point"):
        SPIRAL.nearest([1.0, 2.0])
    with pytest.raises(ValueError, match="one instant"):
        SPIRAL.arc_length([1.0, 2.0])


@pytest.mark.parametrize("path", [CIRCLE, qt.Route.from_path(CIRCLE, 1e-9)], ids=["spiral-helix", "route"])
def test_derivatives_of_the_nearest_point(path):
    """On a circle, the time is the azimuth of the point and the position is its direction; at an end they are fixed."""

    def found(p):
        return (*path.nearest(p)[:2],)

    p = np.array([6.0, 2.0, 1.0])
    time, position = jax.jit(jax.jacrev(found))(p)
    across = np.array([-p[1], p[0], 0.0]) / np.hypot(*p[:2])
    np.testing.assert_allclose(time, across / np.hypot(*p[:2]), atol=1e-7)
    np.testing.assert_allclose(position, 10.0 / np.hypot(*p[:2]) * np.outer(across, across), atol=1e-6)
    time, position = jax.jit(jax.jacrev(found))(np.array([9.0, -5.0, 0.0]))
    assert not np.any(time)
    assert not np.any(position)
