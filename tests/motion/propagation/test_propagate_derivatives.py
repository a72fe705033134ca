"""Derivatives of a propagation in the rate, the initial attitude and the times, compared with differences."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.foundation.types import Scalar
from qtraj.motion.propagation.gauss_legendre import GaussLegendre
from qtraj.motion.propagation.magnus import Magnus
from qtraj.motion.propagation.propagate import propagate

from .coning import FAST

QUATERNION = jnp.asarray([0.1, -0.7, 0.5, 0.4])
TIMES = jnp.asarray([0.0, 0.4, 1.3])
STEP = 1e-5
DIFFERENCE_ERROR = 1e-8
"""Error of central differences with STEP, relative to the size of the gradient."""
TOLERANCE = 1e-11


class Rate(eqx.Module):
    """A rate with parameters, one of which enters the scalar part."""

    pitch: Scalar
    yaw: Scalar

    def __call__(self, t):
        return jnp.stack([self.yaw * t, self.pitch * jnp.sin(4 * t), jnp.cos(self.yaw * t), self.pitch + t])


def goal(parameters, method, **how):
    """A scalar that depends on all parameters: (pitch, yaw, q0, times) as one vector."""
    rate = Rate(parameters[0], parameters[1])
    qs = propagate(rate, parameters[2:6], parameters[6:], method, **how)
    return jnp.sum(qs[1:] * jnp.arange(1.0, 9.0).reshape(2, 4))


PARAMETERS = jnp.concatenate([jnp.asarray([1.2, 0.7]), QUATERNION, TIMES])


def central_differences(f, x):
    return np.array([(f(x + STEP * e) - f(x - STEP * e)) / (2 * STEP) for e in np.eye(len(x))])


def test_both_modes_agree_with_differences():
    """Without jit: the steps are chosen although grad traces the parameters of the rate."""
    expected = central_differences(lambda x: goal(x, GaussLegendre(8)), PARAMETERS)
    scale = DIFFERENCE_ERROR * np.linalg.norm(expected)
    reverse = jax.grad(lambda x: goal(x, GaussLegendre(8)))(PARAMETERS)
    forward = jax.jacfwd(lambda x: goal(x, GaussLegendre(8)))(PARAMETERS)
    np.testing.assert_allclose(reverse, expected, rtol=0, atol=scale)
    np.testing.assert_allclose(forward, reverse, rtol=0, atol=TOLERANCE)


def test_fixed_steps_under_jit():
    """A fixed number of Magnus steps in each interval."""
    both = jax.jit(jax.value_and_grad(lambda x: goal(x, Magnus(6), steps=32)))
    expected = central_differences(lambda x: both(x)[0], PARAMETERS)
    gradient = both(PARAMETERS)[1]
    np.testing.assert_allclose(gradient, expected, rtol=0, atol=DIFFERENCE_ERROR * np.linalg.norm(expected))


def test_under_jit_through_a_closure():
    """The rate is a closure over a traced number, so its steps are chosen at run time."""

    def last(pitch):
        rate = Rate(pitch, jnp.asarray(0.7))
        return propagate(lambda t: rate(t)[1:], QUATERNION, TIMES, max_steps=16)[-1]

    pitch = jnp.asarray(1.2)
    expected = (last(pitch + STEP) - last(pitch - STEP)) / (2 * STEP)
    np.testing.assert_allclose(jax.jit(jax.jacrev(last))(pitch), expected, rtol=0, atol=DIFFERENCE_ERROR)


def test_the_derivatives_in_the_initial_attitude_and_the_last_time():
    """λ is linear in λ0: column k of the Jacobian is the propagated unit quaternion k."""
    jacobian, slope = jax.jacfwd(lambda q, t: propagate(FAST, q, TIMES.at[2].set(t))[-1], (0, 1))(QUATERNION, TIMES[2])
    rotation = propagate(FAST, [1.0, 0, 0, 0], TIMES)[-1]
    np.testing.assert_allclose(jacobian, qt.quaternion.right_matrix(rotation), rtol=0, atol=TOLERANCE)
    last = qt.quaternion.product(QUATERNION, rotation)
    np.testing.assert_allclose(slope, qt.quaternion.derivative(last, FAST(TIMES[2])), rtol=0, atol=TOLERANCE)


@pytest.mark.slow
def test_second_derivative_at_rest():
    """Where rate and rotation vanish: λ = exp(p²t e/2), λ'' = t e at p = 0."""

    def last(p):
        return propagate(lambda t: jnp.stack([p * p, 0 * t, 0 * t]), [1.0, 0, 0, 0], TIMES, Magnus(4), steps=2)[-1]

    second = jax.jacfwd(jax.jacrev(last))(jnp.asarray(0.0))
    np.testing.assert_allclose(second, [0.0, TIMES[2], 0.0, 0.0], rtol=0, atol=TOLERANCE)
