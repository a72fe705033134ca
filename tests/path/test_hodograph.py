"""Derivatives, length and states of hodographs."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import CubicSpline

import qtraj as qt

from .conftest import as_curve

RELATIVE = 1e-12
TOLERANCE = 1e-9
"""Relative, of a length, as documented."""


@pytest.mark.parametrize("name", ["helix", "tilted"])
@pytest.mark.parametrize("t", [0.0, 1.3, 5.0])  # the last time is beyond the duration
def test_the_rotating_basis_agrees_with_nested_differentiation(name, t, request):
    path = request.getfixturevalue(name)
    order = 6
    expected = jax.jit(lambda t: as_curve(path).derivatives(t, order))(t)
    actual = path.derivatives(t, order)
    for k in range(order + 1):
        scale = np.linalg.norm(expected[k])
        np.testing.assert_allclose(actual[k], expected[k], rtol=0, atol=(k + 1) * RELATIVE * scale)


def test_one_order_is_the_derivative_of_the_one_below(tilted):
    for k in range(4):
        _, slope = jax.jvp(lambda t: tilted.derivatives(t, k)[k], (1.1,), (1.0,))  # noqa: B023
        np.testing.assert_allclose(tilted.derivatives(1.1, k + 1)[k + 1], slope, rtol=1e-11)


def test_position_velocity_and_acceleration_are_the_rows(tilted):
    r = tilted.derivatives(0.7, 2)
    for k, method in enumerate((tilted.position, tilted.velocity, tilted.acceleration)):
        np.testing.assert_array_equal(method(0.7), r[k])


def test_a_path_is_a_function_of_time(tilted):
    np.testing.assert_array_equal(tilted(0.7), tilted.position(0.7))


@pytest.mark.parametrize("name", ["helix", "tilted"])
def test_length_agrees_with_adaptive_quadrature(name, request):
    path = request.getfixturevalue(name)
    speed = jax.jit(lambda t: jnp.linalg.norm(path.velocity(t)))
    expected, _ = quad(lambda t: float(speed(t)), 0.0, float(path.duration), epsabs=0, epsrel=1e-13, limit=200)
    np.testing.assert_allclose(path.length(), expected, rtol=RELATIVE)
    np.testing.assert_allclose(as_curve(path).length(), expected, rtol=RELATIVE)


def wave(count):
    """1 km eastwards in 100 s, with `count` lateral waves of 10 m."""

    def position(t):
        return jnp.stack([10.0 * t, 10.0 * jnp.sin(2 * jnp.pi * count * t / 100.0), 0.0 * t])

    return qt.Curve(position, 100.0)


@pytest.mark.parametrize("count", [1, 40, 1000, 3000])
def test_the_length_of_a_wave_is_that_of_its_quarters(count):
    """All quarters of a wave have equal length, which an independent adaptive quadrature computes."""
    rate = 2 * np.pi * count / 100.0
    quarter, _ = quad(lambda t: np.hypot(10.0, 10.0 * rate * np.cos(rate * t)), 0.0, 25.0 / count, epsrel=1e-13)
    np.testing.assert_allclose(wave(count).length(), 4 * count * quarter, rtol=TOLERANCE)


def test_the_length_of_a_spline_is_the_sum_over_its_pieces():
    """A cubic spline through noisy samples, whose third derivative jumps at each of 3000 knots."""
    knots = np.linspace(0.0, 300.0, 3001)
    random_walk = np.cumsum(np.random.default_rng(3).normal(size=(3001, 3)), axis=0)
    spline = CubicSpline(knots, random_walk + knots[:, None] * [5.0, 2.0, 0.0])
    coefficients = jnp.asarray(np.moveaxis(spline.c, 0, 1))

    def position(t):
        k = jnp.clip((t / 0.1).astype(int), 0, 2999)
        d = t - 0.1 * k.astype(float)
        a = coefficients[k]
        return ((a[0] * d + a[1]) * d + a[2]) * d + a[3]

    nodes, weights = np.polynomial.legendre.leggauss(60)
    speeds = np.linalg.norm(spline(0.05 + 0.05 * nodes + knots[:-1, None], 1), axis=-1)
    expected = np.sum(0.05 * weights * speeds)
    np.testing.assert_allclose(qt.Curve(position, 300.0).length(), expected, rtol=100 * TOLERANCE)


def test_a_length_is_differentiated_forwards_and_backwards_under_jit_and_vmap():
    """2000 waves of height a: the refined sum has the derivative of the length for any number of panels."""

    def length(a):
        return qt.Curve(lambda t: jnp.stack([10.0 * t, a * jnp.sin(125.0 * t), 0.0 * t]), 100.0).length()

    heights = jnp.asarray([0.5, 5.0])
    backwards = jax.jit(jax.vmap(jax.grad(length)))(heights)
    np.testing.assert_allclose(backwards, jax.vmap(jax.jacfwd(length))(heights), rtol=1e-12)
    for a, slope in zip((0.5, 5.0), backwards, strict=True):
        difference = (length(a + 1e-3) - length(a - 1e-3)) / 2e-3
        np.testing.assert_allclose(slope, difference, rtol=1e-6)


def test_a_length_that_does_not_converge_is_nan():
    """A million speeds cannot resolve ten thousand million waves."""
    assert np.isnan(wave(10**10).length())


def test_the_length_of_a_circle_and_its_gradient_are_exact():
    def circle(radius):
        return qt.SpiralHelix(jnp.stack([radius]), [0.0, 2 * np.pi], [0.0], 1.0).length()

    np.testing.assert_allclose(circle(jnp.asarray(3.0)), 6 * np.pi, rtol=1e-15)
    np.testing.assert_allclose(jax.grad(circle)(3.0), 2 * np.pi, rtol=1e-14)


def test_a_path_at_rest_has_no_length_and_a_finite_gradient():
    def length(slope):
        return qt.SpiralHelix(jnp.stack([jnp.asarray(2.0), slope]), [0.3], [1.0], 2.0).length()

    assert length(jnp.asarray(0.0)) == 0
    assert np.isfinite(jax.grad(length)(0.0))


def test_a_state_is_position_and_velocity(helix):
    state = helix.state(2.0)
    np.testing.assert_array_equal(state.position, helix.position(2.0))
    np.testing.assert_array_equal(state.velocity, helix.velocity(2.0))


def test_a_curve_takes_modules_and_differentiates_in_them():
    line = qt.Curve(qt.SpiralHelix([2.0, 1.0], [0.0, 1.0], [0.0], 1.0).position, 1.0)
    np.testing.assert_allclose(line.velocity(0.0), [1.0, 2.0, 0.0], atol=1e-15)
    jitted = jax.jit(lambda curve, t: curve.velocity(t))
    np.testing.assert_allclose(jitted(line, 0.0), [1.0, 2.0, 0.0], atol=1e-15)


def test_a_subclass_needs_only_derivatives():
    class Line(qt.AbstractHodograph):
        duration: float = 2.0

        def derivatives(self, t, order):
            rows = [jnp.stack([2.0 * t, 0.0 * t, 0.0 * t]), jnp.asarray([2.0, 0.0, 0.0])]
            return jnp.stack((rows + [jnp.zeros(3)] * order)[: order + 1])

    assert not bool(qt.trihedral(Line(), 1.0).defined)
    assert qt.evaluate(Line(), [0.0, 1.0], ["speed"]).speed.tolist() == [2.0, 2.0]


def test_float32_is_kept():
    coefficients = [jnp.asarray(c, jnp.float32) for c in ([20.0, 1.0], [0.0, 0.3], [1.0, 0.5])]
    path = qt.SpiralHelix(*coefficients, jnp.asarray(4.0, jnp.float32))
    assert path.derivatives(1.0, 3).dtype == jnp.float32
    assert path.length().dtype == jnp.float32
    trihedral = qt.trihedral(path, 1.0)
    assert all(leaf.dtype in (jnp.float32, bool) for leaf in jax.tree.leaves(trihedral))


@pytest.mark.parametrize(
    ("make", "fragment"),
    [
        (lambda: qt.Curve(3.0, 1.0), "not callable"),
        (lambda: qt.Curve(lambda t: jnp.zeros(3), 0.0), "positive"),
        (lambda: qt.SpiralHelix([1.0], [0.0, 1.0], [0.0], -2.0), "positive"),
        (lambda: qt.SpiralHelix([1.0], [0.0, 1.0], [0.0], float("nan")), "positive"),
        (lambda: qt.SpiralHelix([1.0], [0.0, 1.0], [0.0], [2.0]), "one number"),
        (lambda: qt.SpiralHelix(["a"], [0.0, 1.0], [0.0], 2.0), "radius of a spiral-helix must be numbers"),
        (lambda: qt.Curve(lambda t: jnp.stack([t, t]), 1.0), "shape (2,)"),
        (lambda: qt.Curve(lambda t: np.sin(t) * np.ones(3), 1.0), "jax.numpy"),
        (lambda: qt.SpiralHelix([[1.0]], [0.0, 1.0], [0.0], 1.0), "vector of ascending"),
        (lambda: qt.SpiralHelix([], [0.0, 1.0], [0.0], 1.0), "vector of ascending"),
        (lambda: qt.SpiralHelix([1.0], [0.0, float("inf")], [0.0], 1.0), "finite"),
        (lambda: qt.BoundaryState([1.0, 2.0], [0.0, 0.0, 0.0]), "shape (3,)"),
        (lambda: qt.BoundaryState([1.0, 2.0, float("nan")], [0.0, 0.0, 0.0]), "finite"),
        (lambda: qt.BoundaryState(["a", "b", "c"], [0.0, 0.0, 0.0]), "3 real numbers"),
        (lambda: qt.Placement(orientation=[0.0, 0.0, 0.0, 0.0]), "must be a nonzero quaternion"),
    ],
)
def test_bad_input_is_an_error_with_a_reason(make, fragment):
    with pytest.raises(ValueError) as caught:
        make()
    assert fragment in str(caught.value)


def test_coarse_float32_positions_warn():
    with pytest.warns(UserWarning, match=r"has a resolution of only 0\.5 m"):
        qt.BoundaryState(jnp.asarray([623425.5, 4848821.0, 153.0], jnp.float32), jnp.zeros(3, jnp.float32))


HELIX = qt.SpiralHelix([20.0], [0.0, 0.3], [0.0, 0.5], 10.0)
LINES = jax.vmap(lambda r: qt.SpiralHelix(jnp.stack([r]), [0.0, 0.3], [0.0, 0.5], 10.0))(jnp.array([10.0, 20.0, 30.0]))


@pytest.mark.parametrize(
    "path",
    [
        HELIX,
        qt.Curve(lambda t: jnp.stack([t, t**3, jnp.sin(t)]), 3.0),
        qt.Route([0.0, 1.0, 3.0], np.eye(3), np.ones((3, 3)), np.zeros((3, 3))),
        qt.RetimedPath(HELIX, qt.Timing([[1.0, 0.1, 0.0, 0.0]], [0.0, 3.0])),
    ],
    ids=lambda x: type(x).__name__,
)
def test_the_jerk_is_the_derivative_of_the_acceleration(path):
    h = 1e-4
    difference = (path.acceleration(1.5 + h) - path.acceleration(1.5 - h)) / (2 * h)
    np.testing.assert_allclose(path.jerk(1.5), difference, rtol=1e-6, atol=1e-7)


def test_paths_of_a_batch():
    assert len(LINES) == 3
    assert float(LINES[1].radius[0]) == 20.0
    assert float(LINES[-1].radius[0]) == 30.0
    assert [float(path.radius[0]) for path in LINES] == [10.0, 20.0, 30.0]
    assert len(LINES[1:]) == 2
    np.testing.assert_allclose(LINES[0].position(2.0), qt.evaluate(LINES, [2.0]).position[0, 0], rtol=1e-14)
    with pytest.raises(IndexError, match="there are 3 paths in the batch"):
        LINES[3]


def test_a_path_of_a_batch_inside_a_trace():
    radius = jax.jit(lambda paths: paths[2].radius[0] + len(paths))(LINES)
    assert float(radius) == 33.0


@pytest.mark.parametrize("use", [lambda p: p[0], len, list], ids=["element", "length", "iteration"])
def test_a_single_path_is_not_a_batch(use):
    with pytest.raises(TypeError, match="a single SpiralHelix is not a batch"):
        use(HELIX)
    assert HELIX


@pytest.mark.parametrize("result", [list, tuple])
def test_the_function_of_a_curve_may_return_a_list(result):
    listed, stacked = (
        qt.Curve(f, 2.0) for f in (lambda t: result([t, t * t, 0]), lambda t: jnp.stack([t, t * t, 0 * t]))
    )
    np.testing.assert_array_equal(listed.derivatives(1.5, 3), stacked.derivatives(1.5, 3))
    np.testing.assert_array_equal(qt.evaluate(listed, [0.0, 1.0]).velocity, qt.evaluate(stacked, [0.0, 1.0]).velocity)
    with pytest.raises(ValueError, match=r"shape \(2,\)"):
        qt.Curve(lambda t: result([t, t]), 2.0)


@pytest.mark.parametrize(
    ("index", "error", "fragment"),
    [
        (slice(5, None), IndexError, "selects none of them"),
        (None, TypeError, "has the indices 0 to"),
        (True, TypeError, "has the indices 0 to"),
        ((0, 1), TypeError, "has the indices 0 to"),
        ("a", TypeError, "has the indices 0 to"),
    ],
)
def test_other_indices_of_a_batch_are_refused(index, error, fragment):
    with pytest.raises(error, match=fragment):
        LINES[index]


def test_a_list_selects_paths_of_a_batch():
    np.testing.assert_array_equal(LINES[[1, 0]].radius, LINES.radius[np.array([1, 0])])
