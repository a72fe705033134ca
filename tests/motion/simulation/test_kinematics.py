"""Attitude and rate from the angular acceleration, in R⁸."""

import subprocess
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.foundation.types import Scalar
from qtraj.motion.attitude import AbstractProgram
from qtraj.motion.simulation.kinematics import integrate

from ..rigs import ThreeAxis

AT_DEFAULTS = 1e-10
"""Error of a program reproduced from its acceleration, at the default tolerances."""
ROUND_OFF = 1e-13
TIMES = np.linspace(0.0, 6.0, 31)
OMEGA0 = 0.3  # initial virtual rate [rad/s]


def virtual(t):
    """The virtual acceleration ε₀(t)."""
    return 0.4 * jnp.cos(1.3 * t) - 0.1


def integrated_virtual_rate(t):
    """∫₀ᵗ ω0, with ω0 = OMEGA0 + ∫ε₀."""
    return OMEGA0 * t + 0.4 * (1 - np.cos(1.3 * t)) / 1.3**2 - 0.05 * t**2


class Driven(eqx.Module):
    """A program's acceleration in either axes, with a virtual part; time starts at `origin`."""

    program: ThreeAxis
    origin: Scalar
    inertial: bool = eqx.field(static=True, default=False)

    def __call__(self, t, quaternion, rate):
        at = self.program(t - self.origin)
        vector = qt.quaternion.rotate(at.quaternion, at.acceleration) if self.inertial else at.acceleration
        return jnp.concatenate([virtual(t - self.origin)[None], vector])


@pytest.fixture(scope="module")
def program():
    return ThreeAxis()


def start(program, scale=1.0):
    at = program(0.0)
    return scale * at.quaternion, jnp.concatenate([jnp.asarray([OMEGA0]), at.rate])


@pytest.fixture(scope="module")
def in_body_axes(program):
    return integrate(Driven(program, jnp.asarray(0.0)), *start(program), TIMES)


def test_the_acceleration_of_a_program_reproduces_it(program, in_body_axes):
    expected = jax.jit(jax.vmap(lambda t: program(t)))(TIMES)
    directions = in_body_axes.quaternion / in_body_axes.norm[:, None]
    np.testing.assert_allclose(directions, expected.quaternion, atol=AT_DEFAULTS)
    np.testing.assert_allclose(in_body_axes.rate[:, 1:], expected.rate, atol=AT_DEFAULTS)
    assert in_body_axes.successful
    assert in_body_axes.result.startswith("finished")


class Own(eqx.Module):
    """ε⁰ of a program."""

    program: AbstractProgram

    def __call__(self, t, quaternion, rate):
        return jnp.concatenate([jnp.zeros(1), self.program(t).acceleration])


def test_the_acceleration_of_a_frame_reproduces_it():
    """A climbing turn of varying radius and rate: ε⁰ integrated from the initial attitude and rate."""
    path = qt.SpiralHelix([20.0, 0.5, -0.1], [0.3, 0.9, 0.05], [0.0, 1.0, 0.3, -0.05], 6.0)
    check_reproduced(qt.FrameProgram(path), None)


def test_the_acceleration_of_a_slew_reproduces_it_across_its_switches():
    turn = qt.EulerTurn([1.0, 0, 0, 0], [0.3, 0.5, -0.4, 0.6], qt.TimeOptimal(0.6, 0.4))
    check_reproduced(turn, turn.profile.switches)


def check_reproduced(program, jumps):
    at = program(0.0)
    rate = jnp.concatenate([jnp.zeros(1), at.rate])
    solution = integrate(Own(program), at.quaternion, rate, TIMES, jumps=jumps)
    expected = jax.jit(jax.vmap(lambda t: program(t)))(TIMES)
    np.testing.assert_allclose(solution.quaternion, expected.quaternion, rtol=0, atol=AT_DEFAULTS)
    np.testing.assert_allclose(solution.rate[:, 1:], expected.rate, rtol=0, atol=AT_DEFAULTS)
    assert np.linalg.norm(np.diff(solution.quaternion, axis=0), axis=1).sum() > 0.5


def test_the_length_increases_with_a_positive_virtual_rate(in_body_axes):
    np.testing.assert_allclose(in_body_axes.norm**2, np.exp(integrated_virtual_rate(TIMES)), rtol=AT_DEFAULTS)


def test_body_and_inertial_forms_agree(program, in_body_axes):
    quaternion, rate = start(program)
    inertial_rate = rate.at[1:].set(qt.quaternion.rotate(quaternion, rate[1:]))
    other = integrate(Driven(program, jnp.asarray(0.0), True), quaternion, inertial_rate, TIMES, axes="inertial")
    np.testing.assert_allclose(other.quaternion, in_body_axes.quaternion, rtol=0, atol=5 * AT_DEFAULTS)
    rates = jax.vmap(qt.quaternion.rotate)(in_body_axes.quaternion, in_body_axes.rate[:, 1:])
    np.testing.assert_allclose(other.rate[:, 1:], rates, atol=5 * AT_DEFAULTS)
    np.testing.assert_allclose(other.rate[:, 0], in_body_axes.rate[:, 0], atol=AT_DEFAULTS)


@pytest.mark.parametrize("scale", [2.0**-20, -(2.0**20)])
def test_the_tolerance_is_relative_to_the_length_of_the_quaternion(program, in_body_axes, scale):
    other = integrate(Driven(program, jnp.asarray(0.0)), *start(program, scale), TIMES)
    np.testing.assert_allclose(other.quaternion / scale, in_body_axes.quaternion, rtol=0, atol=ROUND_OFF)


def test_times_far_from_zero_change_nothing(program, in_body_axes):
    origin = 2.0**17  # float64 resolves 3e-11 s there
    other = integrate(Driven(program, jnp.asarray(origin)), *start(program), origin + TIMES)
    np.testing.assert_allclose(other.quaternion, in_body_axes.quaternion, rtol=0, atol=1e-9)


def test_the_steps_are_those_of_diffrax(program, in_body_axes):
    """With an adjoint, `diffeqsolve` of diffrax integrates; without, its solver and controller in a loop of ours."""
    import diffrax

    other = integrate(Driven(program, jnp.asarray(0.0)), *start(program), TIMES, adjoint=diffrax.ForwardMode())
    np.testing.assert_allclose(in_body_axes.quaternion, other.quaternion, rtol=0, atol=ROUND_OFF)
    np.testing.assert_allclose(in_body_axes.rate, other.rate, rtol=0, atol=ROUND_OFF)


def test_tighter_tolerances_reach_round_off(program):
    other = integrate(Driven(program, jnp.asarray(0.0)), *start(program), TIMES, rtol=1e-13, atol=1e-15)
    exact = jax.jit(jax.vmap(program.attitude))(TIMES) * np.exp(0.5 * integrated_virtual_rate(TIMES))[:, None]
    np.testing.assert_allclose(other.quaternion, exact, rtol=0, atol=ROUND_OFF)


# A slew about one axis, accelerated until a switch and decelerated afterwards: closed forms of value and derivatives.
AXIS = np.array([2.0, -1.0, 2.0]) / 3


def bang_bang(switch, acceleration, end, angle):
    """λ at the end of the slew from an initial angle, with the switch as a jump of ε."""

    def epsilon(t, quaternion, rate):
        sign = jnp.where(t < switch, 1.0, -1.0)
        return jnp.concatenate([jnp.zeros(1), sign * acceleration * AXIS])

    quaternion = jnp.concatenate([jnp.cos(angle / 2)[None], jnp.sin(angle / 2) * AXIS])
    times = jnp.stack([jnp.zeros_like(end), end])
    solution = integrate(epsilon, quaternion, jnp.zeros(4), times, jumps=switch[None], max_steps=16)
    return solution.quaternion[-1]


def bang_bang_exactly(switch, acceleration, end, angle):
    rest = end - switch
    turned = acceleration * (0.5 * switch**2 + switch * rest - 0.5 * rest**2)
    half = (angle + turned) / 2
    return jnp.concatenate([jnp.cos(half)[None], jnp.sin(half) * AXIS])


def test_derivatives_are_exact_in_both_modes_also_in_switch_and_end_time():
    point = tuple(jnp.asarray(x) for x in (0.7, 1.1, 1.9, 0.4))
    weights = tuple(jnp.asarray(x) for x in (0.3, -1.0, 0.5, 2.0))

    @jax.jit
    def both_modes(*point):
        value, slope = jax.jvp(bang_bang, point, weights)
        _, pull = jax.vjp(bang_bang, *point)
        return value, slope, jnp.stack(pull(jnp.stack(weights)))

    value, slope, gradient = both_modes(*point)
    expected, expected_slope = jax.jvp(bang_bang_exactly, point, weights)
    _, expected_pull = jax.vjp(bang_bang_exactly, *point)
    np.testing.assert_allclose(value, expected, atol=ROUND_OFF)
    np.testing.assert_allclose(slope, expected_slope, atol=1e-12)
    np.testing.assert_allclose(gradient, expected_pull(jnp.stack(weights)), atol=1e-12)


def test_failed_elements_do_not_affect_the_rest_of_a_batch():
    count, poles, bad = 256, 17, 101
    rng = np.random.default_rng(5)
    rates = rng.normal(size=(count, 4)) * [0.1, 1, 1, 1]
    rates[bad] = np.nan
    pole = np.full(count, 9.0)
    pole[poles] = 1.01
    times = np.linspace(0.0, 2.0, 5)

    def motion(rate, pole):
        def spring(t, q, w):
            return w / (pole - t) - 0.3 * jnp.concatenate([jnp.zeros(1), q[1:]])

        return integrate(spring, [1.0, 0.0, 0.0, 0.0], rate, times, rtol=1e-6, atol=1e-8)

    run = jax.jit(jax.vmap(motion))
    both = run(rates, pole)
    good = np.ones(count, bool)
    good[[poles, bad]] = False
    np.testing.assert_array_equal(both.successful, good)
    assert np.isfinite(both.quaternion[good]).all()
    assert np.isfinite(both.quaternion[poles, :3]).all()  # up to the pole
    assert np.isnan(both.quaternion[poles, 3:]).all()
    assert "t = 1 s" in both.result[poles]
    assert "stopped" in both.result[bad]
    healthy = np.where(np.isnan(rates), 0.1, rates)
    pole[poles] = 9.0
    alone = run(healthy, pole)
    assert alone.successful.all()
    np.testing.assert_allclose(both.quaternion[good], alone.quaternion[good], rtol=0, atol=1e-14)


def braked(t, quaternion, rate):
    return -rate


def test_float32_and_another_solver():
    import diffrax

    quaternion, rate = jnp.asarray([0.6, 0, 0.8, 0], jnp.float32), jnp.asarray([0, 0, 2, 0], jnp.float32)
    times = jnp.asarray([0.25, 1.0, 3.0], jnp.float32)
    solution = integrate(braked, quaternion, rate, times, solver=diffrax.Tsit5(), rtol=1e-6, atol=1e-6)
    half = np.arctan2(0.8, 0.6) + 1 - np.exp(-(times - 0.25))
    assert solution.quaternion.dtype == np.float32
    np.testing.assert_allclose(solution.quaternion[:, 0], np.cos(half), atol=1e-5)
    np.testing.assert_allclose(solution.quaternion[:, 2], np.sin(half), atol=1e-5)


def test_a_failure_gives_advice_and_throw_raises():
    few = {"max_steps": 1, "rtol": 1e-13}
    solution = integrate(braked, [1.0, 0, 0, 0], [0.0, 3, 0, 0], [1.0, 9.0], **few)
    assert not solution.successful
    assert "Last instant reached: t = 1 s" in solution.result
    with pytest.raises(RuntimeError, match="larger max_steps"):
        integrate(braked, [1.0, 0, 0, 0], [0.0, 3, 0, 0], [1.0, 9.0], **few, throw=True)


def test_one_instant_is_the_initial_state():
    only = integrate(braked, [0.6, 0, 0.8, 0], [0.0, 1, 2, 3], [0.25], max_steps=1)
    np.testing.assert_allclose(only.quaternion, [[0.6, 0, 0.8, 0]], rtol=1e-15)
    assert only.successful


def test_invalid_arguments_are_refused():
    def still(t, q, w):
        return jnp.zeros(4)

    one, rest = [1.0, 0.0, 0.0, 0.0], np.zeros(4)
    for times, message in [
        ([0.0, 1.0, 1.0], "increase strictly"),
        ([0.0, 2.0, 1.0], r"times\[2\] = 1 s follows times\[1\] = 2 s"),
        ([0.0, np.nan], "finite"),
        ([[0.0, 1.0]], "vector"),
        ([], "vector"),
        (1e5 + jnp.arange(3, dtype=jnp.float32) / 100, "increase|resolve"),
        (1e4 + jnp.arange(3, dtype=jnp.float32) / 64, "does not resolve the smallest step of times, 0.0156"),
    ]:
        dtype = getattr(times, "dtype", float)
        with pytest.raises(ValueError, match=message):
            integrate(still, jnp.asarray(one, dtype), jnp.asarray(rest, dtype), times)
    with pytest.raises(ValueError, match="axes must be"):
        integrate(still, one, rest, [0.0, 1.0], axes="world")
    with pytest.raises(ValueError, match="must not be zero"):
        integrate(still, np.zeros(4), rest, [0.0, 1.0])
    with pytest.raises(ValueError, match="the initial rate must have shape"):
        integrate(still, one, np.zeros(2), [0.0, 1.0])
    with pytest.raises(ValueError, match="rtol must be finite"):
        integrate(still, one, rest, [0.0, 1.0], rtol=-1.0)


def test_result_codes_are_numbers_in_a_trace(in_body_axes):
    @jax.jit
    def text(solution):
        return len(solution.result)

    with pytest.raises(ValueError, match="inside jit"):
        text(in_body_axes)
    assert in_body_axes.code == qt.ResultCode.successful
    with pytest.raises(ValueError, match="neither a command nor an error"):
        _ = in_body_axes.physical_command


def test_a_solution_is_stored_and_read_back(in_body_axes, tmp_path):
    file = tmp_path / "motion.toml"
    in_body_axes.save(file)
    back = qt.load(file)
    assert jax.tree.structure(back) == jax.tree.structure(in_body_axes)
    for a, b in zip(jax.tree.leaves(back), jax.tree.leaves(in_body_axes), strict=True):
        np.testing.assert_array_equal(a, b)


def test_diffrax_is_imported_by_the_first_solve_only():
    code = "import sys, qtraj.motion.simulation.simulate, qtraj.motion.control; assert 'diffrax' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)


def test_a_rate_of_three_components_has_the_scalar_part_zero():
    times = np.linspace(0.0, 1.0, 5)
    three, four = (
        integrate(lambda t, q, w: 0 * w, [1.0, 0, 0, 0], rate, times) for rate in ([1.0, 2, 3], [0, 1.0, 2, 3])
    )
    np.testing.assert_array_equal(three.quaternion, four.quaternion)
