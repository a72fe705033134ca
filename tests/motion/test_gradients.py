"""Forward and reverse derivatives of slews, propagation, integration and simulation, also at Φ → 0."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt

RELATIVE = 1e-6
"""Error of central differences with STEP, relative to the size of the gradient."""
STEP = 1e-5
START = np.array([0.5, -0.5, 0.1, 0.7])
TIMES = np.array([0.0, 0.7, 1.6])
WEIGHTS = np.random.default_rng(6).normal(size=(2, 4))

ENDS = {
    "equal attitudes": START,
    "equal attitudes, opposite signs": -2 * START,
    "a slew": np.array([0.3, 0.2, -0.6, 0.4]),
}


def check_gradient(f, points):
    """Compare reverse and forward mode of `f` with central differences in every variable."""

    forward = jax.jit(lambda x, direction: jax.jvp(f, (x,), (direction,)))
    reverse = jax.jit(jax.grad(f))
    for x in points:
        ends = [[forward(x + sign * STEP * e, e)[0] for sign in (1, -1)] for e in np.eye(len(x))]
        difference = np.array([(above - below) / (2 * STEP) for above, below in ends])
        size = np.linalg.norm(difference)
        assert size > 0.1
        np.testing.assert_allclose(reverse(x), difference, rtol=0, atol=RELATIVE * size)
        for direction in np.random.default_rng(7).normal(size=(2, len(x))):
            slope = difference @ direction
            np.testing.assert_allclose(forward(x, direction)[1], slope, rtol=0, atol=len(x) * RELATIVE * size)


def slew(end):
    return qt.EulerTurn(START, end, qt.Quintic(duration=2.0))


def test_euler_turn():
    def goal(end):
        at = slew(end)(0.9)
        return WEIGHTS[0] @ at.quaternion + WEIGHTS[1, :3] @ at.rate + WEIGHTS[0, :3] @ at.acceleration

    check_gradient(goal, ENDS.values())


def test_propagate():
    def goal(x):
        program = slew(x[:4])
        qs = qt.propagate(lambda t: program(t).rate, x[4:], TIMES, steps=2)
        return jnp.sum(qs[1:] * WEIGHTS)

    check_gradient(goal, [np.concatenate([end, START]) for end in ENDS.values()])


@pytest.mark.slow
def test_integrate():
    def goal(x):
        program = slew(x[:4])

        def epsilon(t, quaternion, rate):
            return jnp.concatenate([jnp.sin(t)[None], program(t).acceleration])

        motion = qt.integrate(epsilon, x[4:8], x[8:], TIMES, rtol=1e-12)
        return jnp.sum(motion.quaternion[1:] * WEIGHTS) + jnp.sum(motion.rate[1:] * WEIGHTS[::-1])

    state = np.concatenate([START, [0.1, 0.2, -0.3, 0.4]])
    check_gradient(goal, [np.concatenate([end, state]) for end in ENDS.values()])


@pytest.mark.slow
def test_simulate():
    """With respect to the program, the gains, the state, and a disturbance."""

    def goal(x):
        motion = qt.simulate(
            slew(x[:4]),
            qt.AccelerationLaw(x[4], x[5]),
            x[6:10],
            x[10:14],
            TIMES,
            disturbance=qt.DisturbanceAcceleration(x[14:]),
            rtol=1e-12,
        )
        return jnp.sum(motion.quaternion[1:] * WEIGHTS) + jnp.sum(motion.command[1:] * WEIGHTS[::-1])

    away = START + np.array([0.05, 0.1, 0.2, -0.1])
    state = np.concatenate([[2.1, 1.3], away, [0.1, 0.2, -0.3, 0.4], [0.1, -0.2, 0.05]])
    check_gradient(goal, [np.concatenate([end, state]) for end in (ENDS["equal attitudes"], ENDS["a slew"])])
