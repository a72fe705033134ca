"""Wrong arguments of propagation, frames, paths and profiles: each message says what was expected."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import qtraj as qt

HELIX = qt.SpiralHelix([10.0], [0.0, 1.0], [0.0, 3.0], 10.0)
ONE, TIMES = [1.0, 0.0, 0.0, 0.0], [0.0, 1.0]


def numpy_rate(t):
    return np.array([np.sin(t), 0.2, 0.0 * t])


def jax_rate(t):
    return jnp.stack([jnp.sin(t), 0.2 + 0 * t, 0 * t])


@pytest.mark.parametrize("stages", [1.5, True, 0, 65, "8", 8.0])
def test_stages_are_a_whole_number(stages):
    with pytest.raises(ValueError, match="the number of stages must be an integer from 1 to 64"):
        qt.GaussLegendre(stages)


@pytest.mark.parametrize("order", [4.0, True, "6", 5])
def test_the_order_of_an_expansion_is_4_or_6(order):
    with pytest.raises(ValueError, match="the order of a Magnus expansion must be 4 or 6"):
        qt.Magnus(order)


@pytest.mark.parametrize("steps", [1.5, 2.0, True, 0, "3"])
def test_steps_are_a_whole_number(steps):
    for function in (qt.propagate, qt.propagate_with_estimate):
        with pytest.raises(ValueError, match="steps must be a whole number, at least 1"):
            function(numpy_rate, ONE, TIMES, steps=steps)


@pytest.mark.parametrize("function", [qt.propagate, qt.propagate_with_estimate])
def test_a_method_by_name_is_refused(function):
    with pytest.raises(ValueError, match=r"method must be an integration method, .* but the str 'rk4' was given"):
        function(numpy_rate, ONE, TIMES, method="rk4")


@pytest.mark.parametrize("rate", [lambda t: [1j * t, 0, 0], lambda t: jnp.stack([jnp.asarray(t, complex)] * 3)])
def test_complex_rates_are_refused(rate):
    with pytest.raises(ValueError, match=r"omega\(t\) must return real numbers \[rad/s\]"):
        qt.propagate(rate, ONE, TIMES)


@pytest.mark.parametrize("options", [{}, {"steps": 6}, {"axes": "inertial"}])
def test_a_numpy_rate_with_a_traced_quaternion(options):
    """The rates are known, so they are constants of the trace."""
    q = jnp.array([0.8, 0.1, -0.3, 0.4])

    def of(rate):
        return lambda q: qt.propagate(rate, q, [0.0, 0.5, 1.0], **options)

    for transform in (jax.jit, jax.jacrev, lambda f: jax.vmap(f, axis_size=2, in_axes=None)):
        np.testing.assert_allclose(transform(of(numpy_rate))(q), transform(of(jax_rate))(q), atol=1e-12)


@pytest.mark.parametrize("transform", [jax.jit, jax.jacfwd])
def test_a_numpy_rate_at_traced_times_is_refused(transform):
    with pytest.raises(ValueError, match=r"omega cannot be traced by JAX, .* write it with jax\.numpy"):
        transform(lambda times: qt.propagate(numpy_rate, ONE, times))(jnp.array(TIMES))


PATHS = {
    "function": (lambda t: np.array([t, 0, 0]), "a function was given: qtraj.Curve(function, duration)"),
    "spline": (
        CubicSpline([0.0, 1.0, 2.0], np.arange(9.0).reshape(3, 3)),
        "a CubicSpline was given: convert it with qtraj.Route.from_piecewise(spline)",
    ),
    "points": (np.zeros((5, 3)), "an array of shape (5, 3) was given: qtraj.Shape.through(points)"),
}
USES = {
    "trihedral": lambda path: qt.trihedral(path, 0.0),
    "program": lambda path: qt.FrameProgram(path),
    "evaluate": lambda path: qt.evaluate(path, [0.0, 1.0]),
    "certify": lambda path: qt.certify(path, qt.Limits(speed=1.0)),
    "retime": lambda path: qt.retime(path, qt.Limits(speed=1.0)),
    "margins": lambda path: qt.Limits(speed=1.0).margins(path, 0.0),
    "values": lambda path: qt.Limits(speed=1.0).values(path, 0.0),
    "pose": lambda path: qt.PoseProgram(path, qt.FrameProgram(HELIX)),
    "arm": lambda path: qt.simulate_arm(
        qt.stanford_arm(), qt.FrameProgram(HELIX), qt.AccelerationLaw(1.0, 1.0), [0.1] * 6, [0.0] * 6, TIMES, path
    ),
    "route": lambda path: qt.Route.from_path(path),
    "forces": lambda path: qt.dynamics.forces(path, 0.0, 1.0, 9.8),
}


@pytest.mark.parametrize("use", USES)
@pytest.mark.parametrize("kind", PATHS)
def test_what_is_not_a_path_is_named_with_its_path(use, kind):
    given, text = PATHS[kind]
    with pytest.raises(ValueError, match="path") as error:
        USES[use](given)
    assert text in str(error.value)


DERIVABLE = {
    "spiral-helix": HELIX,
    "route": qt.Route.from_path(HELIX, 0.1),
    "curve": qt.Curve(lambda t: jnp.stack([t, t * t, t]), 3.0),
    "profile": qt.TimeOptimal(None, 1.0).profile(1.0),
}


@pytest.mark.parametrize("name", DERIVABLE)
@pytest.mark.parametrize("order", [-1, 1.5, True, "a", None])
def test_the_order_of_a_derivative_is_a_whole_number(name, order):
    with pytest.raises(ValueError, match="the order of a derivative must be a whole number, at least 0"):
        DERIVABLE[name].derivatives(1.0, order)


@pytest.mark.parametrize(
    "function", [lambda t: jnp.stack([jnp.asarray(t, complex)] * 3), lambda t: [jnp.asarray(t, complex)] * 3]
)
def test_a_curve_of_numbers_that_are_not_real_is_refused(function):
    with pytest.raises(ValueError, match="must return real numbers"):
        qt.Curve(function, 1.0)


@pytest.mark.parametrize("function", [lambda t: jnp.array([1, 2, 3]), lambda t: [1, 2, 3]])
def test_a_curve_of_integers_is_a_point(function):
    curve = qt.Curve(function, 1.0)
    np.testing.assert_array_equal(curve.derivatives(0.5, 2), [[1.0, 2.0, 3.0], [0.0] * 3, [0.0] * 3])


def test_a_traced_quaternion_in_single_precision_needs_no_double():
    """Warnings are errors here: JAX warns if float64 is requested without its 64-bit mode."""
    with jax.enable_x64(False):
        slope = jax.grad(lambda x: qt.EulerTurn(ONE, [1.0, x, 0, 0], qt.Quintic(duration=1.0))(0.5).quaternion[1])(0.3)
        table = jax.jit(lambda x: qt.TableProgram(TIMES, [ONE, [1.0, x, 0, 0]])(0.5).quaternion)(0.3)
    assert slope.dtype == table.dtype == np.float32
    assert float(slope) == pytest.approx(0.45385, abs=1e-5)


def test_a_tiny_initial_normal_is_a_direction():
    expected = qt.FrameProgram(HELIX, qt.RotationMinimizing([1.0, 0.0, 0.0]))(1.0).quaternion
    for size in (1e-200, 1e200, 1e-300):
        program = qt.FrameProgram(HELIX, qt.RotationMinimizing([size, 0.0, 0.0]))
        np.testing.assert_allclose(program(1.0).quaternion, expected, atol=1e-14)
    with pytest.raises(ValueError, match="must not be zero"):
        qt.RotationMinimizing([1e-320, 0.0, 0.0])


@pytest.mark.parametrize("size", [1e-170, 1e-300, 1e170])
def test_the_rate_does_not_depend_on_the_norm(size):
    q, q_dot = size * np.array([0.6, 0.0, 0.8, 0.0]), size * np.array([0.1, 0.5, 0.2, -0.3])
    for axes in ("body", "inertial"):
        expected = qt.matrices.rate(q / size, q_dot / size, axes)
        np.testing.assert_allclose(qt.matrices.rate(q, q_dot, axes), expected, rtol=1e-12)


def test_profiles_without_a_limit_on_the_rate():
    angle = 1.3
    assert float(qt.TimeOptimal(max_acceleration=0.5).profile(angle).duration) == pytest.approx(
        2 * (angle / 0.5) ** 0.5
    )
    short = qt.SCurve(max_acceleration=9.0, max_jerk=0.5).profile(angle)
    assert float(short.duration) == pytest.approx(4 * (angle / (2 * 0.5)) ** (1 / 3))
    for law in (qt.TimeOptimal, qt.SCurve):
        with pytest.raises(ValueError, match="max_acceleration must be a number, but None was given"):
            law(1.0)


def test_a_long_path_in_single_precision():
    path = qt.SpiralHelix(*(np.float32(x) for x in ([10.0], [0.0, 1.0], [0.0, 0.5])), np.float32(60.0))
    exact = 10 / (100 + 0.25)
    assert float(qt.trihedral(path, 30.0).curvature) == pytest.approx(exact, rel=1e-6)
    jitted = jax.jit(lambda t: qt.trihedral(jax.tree.map(jnp.asarray, path), t).curvature)(jnp.float32(30.0))
    assert float(jitted) == pytest.approx(exact, rel=1e-5)


def test_the_upright_frame_jumps_on_a_vertical_loop():
    t = np.linspace(0, 2 * np.pi, 33)
    zero = 0 * t
    r, v, a = (10 * np.stack(x, axis=1) for x in (
        (np.sin(t), zero, 1 - np.cos(t)), (np.cos(t), zero, np.sin(t)), (-np.sin(t), zero, np.cos(t))
    ))  # fmt: skip
    loop = qt.Route(t, r, v, a)
    before, after = (qt.trihedral(loop, np.pi / 2 + side, qt.Upright()) for side in (-1e-6, 1e-6))
    np.testing.assert_allclose(before.normal, -np.asarray(after.normal), atol=1e-5)
    found = qt.certify(loop, qt.Limits(yaw_rate=1.0))
    assert found.status["yaw_rate"] == "undefined"
    assert "on a vertical loop the upright frame jumps by 180° there" in str(found.result)


def test_a_negative_load_is_said():
    leap = qt.SpiralHelix([10.0], [0.0, 1.0], [0.0, 0.0, -8.0], 3.0)  # falls at 16 m/s²
    found = qt.certify(leap, qt.Limits(friction=0.5, vehicle=qt.Vehicle(mass=1000.0)))
    assert found.status["friction"] == "undefined"
    assert not found.holds
    assert "the load on the road is not positive" in str(found.result)
