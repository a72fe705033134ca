"""The diffrax term and solver: order, |λ|, adaptive steps, dense output, axes, and both directions of time."""

import subprocess
import sys

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from qtraj.motion.propagation.propagate import propagate
from qtraj.motion.propagation.solver import AttitudeTerm, QuaternionMagnus

from .coning import FAST, Coning, angles

END = 2.3
INITIAL = jnp.asarray(FAST.quaternions([0.0])[0])
ROUND_OFF = 1e-13
ORDER_MARGIN = 0.3
STEP = 1e-5
DIFFERENCE_ERROR = 1e-7
SOMEWHERE = np.linspace(0.013, END - 0.017, 41)


def pid(tolerance, scale=1.0):
    return diffrax.PIDController(rtol=tolerance, atol=tolerance * scale)


@eqx.filter_jit
def solve(term, y0, controller, saveat, dt0=None, solver=None, t0=0.0, t1=END):
    solver = QuaternionMagnus() if solver is None else solver
    return diffrax.diffeqsolve(
        term, solver, t0, t1, dt0, y0, stepsize_controller=controller, saveat=saveat, max_steps=4096
    )


class Swinging(eqx.Module):
    """A rate of four components: ω0 = sin 3t, followed by coning."""

    def __call__(self, t):
        return jnp.concatenate([jnp.sin(3 * t)[None], FAST(t)])


def test_orders_of_steps_and_of_dense_output():
    ends, between = [], []
    for count in (40, 80):
        saveat = diffrax.SaveAt(subs=[diffrax.SubSaveAt(ts=SOMEWHERE), diffrax.SubSaveAt(t1=True)])
        step = jnp.asarray(END / count)
        solution = solve(AttitudeTerm(FAST), INITIAL, diffrax.ConstantStepSize(), saveat, step)
        inside, last = solution.ys
        between.append(angles(inside, FAST.quaternions(SOMEWHERE)).max())
        ends.append(angles(last, FAST.quaternions([END]))[0])
        np.testing.assert_allclose(np.linalg.norm(inside, axis=1), 1.0, rtol=ROUND_OFF, atol=0)
    assert np.log2(ends[0] / ends[1]) > 6 - ORDER_MARGIN
    assert np.log2(between[0] / between[1]) > 5 - ORDER_MARGIN


@pytest.mark.parametrize("tolerance", [1e-5, 1e-9])
def test_adaptive_steps_meet_the_tolerance(tolerance):
    solution = solve(AttitudeTerm(FAST), INITIAL, pid(tolerance), diffrax.SaveAt(t1=True))
    error = angles(solution.ys, FAST.quaternions([END]))[0]
    assert error < 10 * tolerance
    assert solution.stats["num_steps"] < 40 * (1e-5 / tolerance) ** (1 / 5)
    assert np.linalg.norm(solution.ys[0]) == pytest.approx(1.0, abs=ROUND_OFF)


def test_the_error_estimate_for_a_fixed_axis():
    """The expansion is then exact, so the estimate must come from the integral of the rate."""

    def omega(t):
        return jnp.exp(-200 * (t - 1.1) ** 2) * jnp.asarray([0.0, 0.6, 0.8])

    solution = solve(AttitudeTerm(omega), jnp.eye(4)[0], pid(1e-9), diffrax.SaveAt(t1=True))
    assert 2 * np.arccos(solution.ys[0, 0]) == pytest.approx(np.sqrt(np.pi / 200), abs=1e-8)


SCALE = -1e-3
SCALED = SCALE * jnp.asarray([0.1, -0.7, 0.5, 0.4])
CLOSE = 1e-9 * abs(SCALE)
"""Ten times the tolerance of the solves."""


def test_inertial_axes_scalar_part_scale_and_both_directions():
    """Compared with `propagate`, forwards and backwards in time, with dense output."""
    term, controller = AttitudeTerm(Swinging(), "inertial"), pid(1e-10, abs(SCALE))
    expected = propagate(Swinging(), SCALED, [0.0, *SOMEWHERE, END], axes="inertial")
    saveat = diffrax.SaveAt(t1=True, dense=True)
    there = solve(term, SCALED, controller, saveat)
    np.testing.assert_allclose(there.ys[0], expected[-1], rtol=0, atol=CLOSE)
    back = solve(term, there.ys[0], controller, saveat, t0=END, t1=0.0)
    np.testing.assert_allclose(back.ys[0], SCALED, rtol=0, atol=CLOSE)
    for solution in (there, back):
        inside = jax.vmap(solution.evaluate)(jnp.asarray(SOMEWHERE))
        np.testing.assert_allclose(inside, expected[1:-1], rtol=0, atol=CLOSE)


@pytest.mark.parametrize("solver", [QuaternionMagnus(), diffrax.Dopri8()], ids=type)
def test_body_axes_and_the_term_with_another_solver(solver):
    expected = propagate(Swinging(), SCALED, [0.0, END])[-1]
    solution = solve(AttitudeTerm(Swinging()), SCALED, pid(1e-10, abs(SCALE)), diffrax.SaveAt(t1=True), solver=solver)
    np.testing.assert_allclose(solution.ys[0], expected, rtol=0, atol=10 * CLOSE)


def test_a_jump_in_the_rate():
    """With `jump_ts` the rate before the jump is not used after it, so few steps are needed."""

    def omega(t):
        return jnp.where(t < 0.7, 1.0, -2.0) * jnp.asarray([0.0, 0.6, 0.8])

    controller = diffrax.ClipStepSizeController(pid(1e-9), jump_ts=jnp.asarray([0.7]))
    solution = solve(AttitudeTerm(omega), jnp.eye(4)[0], controller, diffrax.SaveAt(t1=True))
    assert 2 * np.arccos(solution.ys[0, 0]) == pytest.approx(2 * (END - 0.7) - 0.7, abs=1e-9)
    assert solution.stats["num_steps"] < 40


@pytest.mark.slow
def test_derivatives():
    """Forward and reverse derivatives in rate parameters and initial attitude, at fixed steps."""

    def goal(x, adjoint):
        term = AttitudeTerm(Coning(50.0, x[0]))
        solution = diffrax.diffeqsolve(term, QuaternionMagnus(), 0.0, END, END / 32, x[1:], adjoint=adjoint)
        return jnp.sum(solution.ys[0] * jnp.arange(1.0, 5.0))

    x = jnp.asarray([3.0, 0.1, -0.7, 0.5, 0.4])
    reverse = jax.jit(jax.value_and_grad(lambda x: goal(x, diffrax.RecursiveCheckpointAdjoint())))
    forward = jax.jit(jax.jacfwd(lambda x: goal(x, diffrax.ForwardMode())))
    expected = np.array([(reverse(x + STEP * e)[0] - reverse(x - STEP * e)[0]) / (2 * STEP) for e in np.eye(5)])
    np.testing.assert_allclose(reverse(x)[1], expected, rtol=0, atol=DIFFERENCE_ERROR)
    np.testing.assert_allclose(forward(x), expected, rtol=0, atol=DIFFERENCE_ERROR)


def test_float32():
    coning = Coning(50.0, 2 * np.pi, jnp.float32)
    controller = pid(jnp.float32(1e-5))
    y0 = INITIAL.astype(jnp.float32)
    saveat = diffrax.SaveAt(ts=jnp.asarray([1.0, 2.0], jnp.float32))
    solution = solve(AttitudeTerm(coning), y0, controller, saveat, t0=jnp.float32(0.0), t1=jnp.float32(END))
    assert solution.ys.dtype == jnp.float32
    assert angles(np.asarray(solution.ys, float), FAST.quaternions([1.0, 2.0])).max() < 1e-4


def test_bad_axes():
    with pytest.raises(ValueError, match="'body' or 'inertial', but 'world'"):
        AttitudeTerm(FAST, "world")


def test_propagation_does_not_import_diffrax():
    """diffrax is slow to import, and only this solver needs it."""
    package = "qtraj.motion.propagation"
    code = f"import sys, {package}.propagate, {package}.strapdown; sys.exit('{package}.solver' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
