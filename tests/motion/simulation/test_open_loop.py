"""Open-loop control: the acceleration of a program reproduces it, without correcting errors."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import qtraj as qt

from ..rigs import Rest, ThreeAxis

REPRODUCED = 1e-9
"""Tolerance of λ and ω over a program of a few seconds, with default tolerances and double integration."""
START, END = [0.9, 0.1, -0.3, 0.2], [0.2, 0.8, 0.4, -0.5]


def programs():
    helix = qt.SpiralHelix([8.0, 0.3, 0.1], [0.4, 0.5, 0.05], [1.0, 0.4, -0.2, 0.03], 2.5)
    return {
        "smooth turn": qt.EulerTurn(START, END, qt.Septic(duration=2.5)),
        "time-optimal turn": qt.EulerTurn(START, END, qt.TimeOptimal(2.0, 3.0)),
        "natural trihedral": qt.FrameProgram(helix),
        "upright frame": qt.FrameProgram(helix, qt.Upright()),
        "three axes": ThreeAxis(),
    }


@pytest.mark.parametrize("axes", ["body", "inertial"])
@pytest.mark.parametrize("name", programs())
def test_the_acceleration_of_a_program_reproduces_it(name, axes):
    """(1.5) and (1.6): attitude, rate and norm, from ε⁰ alone."""
    program = programs()[name]
    times = jnp.linspace(0.0, program.duration * 0.999, 11)
    solution = qt.open_loop(program, times, axes=axes)
    wanted = jax.vmap(lambda t: program.at(t, axes))(times)
    assert solution.successful
    np.testing.assert_allclose(solution.quaternion, wanted.quaternion, rtol=0, atol=REPRODUCED)
    np.testing.assert_allclose(solution.rate[:, 1:], wanted.rate, rtol=0, atol=REPRODUCED)
    np.testing.assert_array_equal(solution.rate[:, 0], 0.0)
    np.testing.assert_allclose(solution.norm, 1.0, rtol=0, atol=REPRODUCED)
    np.testing.assert_allclose(solution.angle, 0.0, atol=2 * REPRODUCED)
    np.testing.assert_allclose(solution.physical_command[:-1], jax.vmap(program)(times[:-1]).acceleration, atol=1e-7)
    assert solution.axes == axes


def test_against_scipy_off_the_program():
    """From another state, in both axes and with a disturbance: SciPy integrates the components."""
    program, start, rate = ThreeAxis(), np.array([0.8, 0.4, -0.2, 0.5]), np.array([0.1, 0.3, -0.2, 0.4])
    push = np.array([0.02, -0.01, 0.03])
    times = np.linspace(0.0, 3.0, 7)
    at = {axes: jax.jit(lambda t, axes=axes: program.at(t, axes).acceleration) for axes in ("body", "inertial")}

    def left(q):
        a, b, c, d = q
        return np.array([[a, -b, -c, -d], [b, a, -d, c], [c, d, a, -b], [d, -c, b, a]])

    def right(q):
        a, b, c, d = q
        return np.array([[a, -b, -c, -d], [b, a, d, -c], [c, -d, a, b], [d, c, -b, a]])

    def flow(t, y, axes):
        q, w = y[:4], y[4:]
        turned = left(q) @ right(np.array([1, -1, -1, -1]) * q) / (q @ q)
        pushed = push if axes == "body" else turned[1:, 1:] @ push
        epsilon = np.concatenate([[0.0], np.asarray(at[axes](t)) + pushed])
        return np.concatenate([0.5 * (left(q) @ w if axes == "body" else right(q) @ w), epsilon])

    for axes in ("body", "inertial"):
        expected = solve_ivp(
            flow, (0, 3), [*start, *rate], args=(axes,), method="DOP853", rtol=1e-11, atol=1e-12, t_eval=times
        ).y.T
        solution = qt.open_loop(program, times, start, rate, axes, disturbance=lambda t: jnp.asarray(push))
        np.testing.assert_allclose(solution.quaternion, expected[:, :4], rtol=0, atol=1e-8)
        np.testing.assert_allclose(solution.rate, expected[:, 4:], rtol=0, atol=1e-8)


def test_errors_are_not_corrected():
    """An attitude error remains; a rate error causes one that grows with time, a disturbance one with its square."""
    program, times = programs()["smooth turn"], jnp.linspace(0.0, 2.5, 6)
    first, off = program(0.0), qt.rotation.from_rotation_vector(jnp.asarray([0.2, -0.1, 0.3]))
    left = qt.open_loop(program, times, qt.quaternion.product(off, first.quaternion))
    np.testing.assert_allclose(left.angle, np.sqrt(0.14), atol=REPRODUCED)  # μ* is constant
    still = qt.open_loop(Rest(), times, rate=[0.0, 0.01, 0.0, 0.0])
    np.testing.assert_allclose(still.angle, 0.01 * times, atol=REPRODUCED)
    pushed = qt.open_loop(Rest(), times, disturbance=lambda t: jnp.asarray([0.0, 0.02, 0.0]))
    np.testing.assert_allclose(pushed.angle, 0.01 * times**2, atol=REPRODUCED)
    law = qt.AccelerationLaw(*qt.control.from_settling_time(1.0))
    closed = qt.simulate(Rest(), law, [1.0, 0, 0, 0], np.zeros(4), times, lambda t: jnp.asarray([0.0, 0.02, 0.0]))
    assert closed.angle[-1] < 0.02 * pushed.angle[-1]


def test_derivatives_and_batches():
    def missed(end, lag):
        turn = qt.EulerTurn(START, end, qt.Septic(duration=2.5))
        motion = qt.open_loop(turn, [0.0, 2.5], rate=jnp.zeros(4).at[3].set(lag), rtol=1e-12)
        return jnp.sum(motion.quaternion[-1] ** 2 * jnp.arange(4.0))

    end = jnp.asarray(END)
    slope = jax.jit(jax.grad(missed))(end, jnp.asarray(0.01))
    shift = jnp.asarray([0.3, -0.4, 0.2, 0.1])
    central = (missed(end + 1e-3 * shift, 0.01) - missed(end - 1e-3 * shift, 0.01)) / 2e-3
    np.testing.assert_allclose(slope @ shift, central, rtol=1e-4)
    many = jax.jit(jax.vmap(missed, (None, 0)))(end, jnp.asarray([0.0, 0.01]))
    np.testing.assert_allclose(many[1], missed(end, 0.01), rtol=1e-12)


def test_invalid_arguments():
    for arguments, expected in (
        ((lambda t: t, [0.0, 1.0]), "an attitude program such as"),
        ((Rest(), [0.0, 1.0], None, None, "world"), "axes must be 'body' or 'inertial'"),
        ((Rest(), [1.0, 0.0]), "times must increase strictly"),
        ((Rest(), [0.0, 1.0], [0.0, 0, 0, 0]), "must not be zero"),
    ):
        with pytest.raises(ValueError, match=expected):
            qt.open_loop(*arguments)
    with pytest.raises(ValueError, match="sign must be"):
        qt.open_loop(Rest(), [0.0, 1.0], sign="far")
