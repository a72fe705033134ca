"""Forward and reverse gradients of profiles in angle and limits, also at regime boundaries and at Φ = 0."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.derivatives import with_jacobians

from qtraj.motion.profiles.s_curve import SCurve
from qtraj.motion.profiles.smooth_step import Quintic
from qtraj.motion.profiles.time_optimal import TimeOptimal

from .factories import FROM_LIMITS, IN_TIME

FINITE_DIFFERENCE = 1e-6  # of central differences with a step of 1e-5


def outputs(name, x, t=0.83):
    """Duration, angle, rate and acceleration at one instant from (Φ, V, A, J) or (Φ, V, A, J, T)."""
    factories = FROM_LIMITS if x.shape == (4,) else IN_TIME
    profile = factories[name](*x[1:]).profile(x[0])
    return jnp.concatenate([profile.duration[None], profile.derivatives(t, 2)])


@pytest.mark.parametrize(
    ("name", "points"),
    [
        ("time-optimal", [(2.0, 0.9, 1.1, 3.0), (0.7, 2.0, 1.1, 3.0)]),
        ("s-curve", [(2.0, 0.8, 1.1, 3.0), (2.0, 0.8, 1.1, 0.7), (0.3, 2.0, 1.1, 3.0), (3.0, 2.0, 1.0, 3.0)]),
        ("quintic", [(1.0, 0.9, 9.9, 30.0), (1.0, 9.0, 1.9, 70.0), (1.0, 9.0, 9.9, 7.0)]),
        ("time-optimal", [(1.0, 0.9, 1.1, 3.0, 3.3), (1.0, 0.9, 1.1, 3.0, 2.3)]),
        ("s-curve", [(1.0, 0.9, 1.1, 30.0, 3.3), (1.0, 0.9, 1.1, 1.1, 6.0)]),
        ("quintic", [(1.0, 0.9, 9.1, 50.0, 4.0)]),
    ],
)
def test_gradients(name, points):
    def f(x):
        return outputs(name, x)

    h, points = 1e-5, np.array(points)
    steps = h * np.eye(points.shape[1])
    values = jax.jit(jax.vmap(jax.vmap(jax.vmap(f))))(points[:, None, None] + np.stack([steps, -steps])[None])
    _, forward, reverse = jax.jit(jax.vmap(with_jacobians(f)))(points)
    difference = np.swapaxes(values[:, 0] - values[:, 1], 1, 2) / (2 * h)
    np.testing.assert_allclose(forward, difference, rtol=FINITE_DIFFERENCE, atol=FINITE_DIFFERENCE)
    np.testing.assert_allclose(reverse, forward, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize(
    ("name", "points"),
    [
        ("time-optimal", [(0.8, 0.8, 0.8, 1.0)]),  # Φ = V²/A
        ("s-curve", [(3.0, 1.0, 1.0, 1.0), (2.0, 5.0, 1.0, 1.0)]),  # VJ = A², Φ = 2A³/J²
    ],
)
def test_gradients_agree_on_both_sides_of_a_regime_boundary(name, points):
    """Gradients of the duration, and of angle and rate before and after the switches that coincide there."""
    points = np.array(points)[:, None]
    h = 1e-7
    around = points + h * np.concatenate([np.zeros((1, 4)), np.eye(4), -np.eye(4)])

    def everything(x):
        first, last = outputs(name, x, 0.83), outputs(name, x, 1.57)
        return jnp.concatenate([first[:3], last[1:3]])

    both = jax.jit(jax.vmap(jax.vmap(lambda x: with_jacobians(everything)(x)[::2])))
    values, gradients = (np.asarray(x) for x in both(around))
    assert np.isfinite(gradients).all()
    assert (np.abs(gradients).max(axis=(0, 1, 3)) > 0.05).all()
    np.testing.assert_allclose(gradients, np.broadcast_to(gradients[:, :1], gradients.shape), atol=1e-5)
    steps = h * np.moveaxis(gradients[:, 0], 1, 2)
    np.testing.assert_allclose(values[:, 1:5] - values[:, :1], steps, atol=1e-12)
    np.testing.assert_allclose(values[:, 5:] - values[:, :1], -steps, atol=1e-12)


AT_ZERO = {
    "time-optimal": TimeOptimal(1.0, 1.0),
    "s-curve": SCurve(1.0, 1.0, 1.0),
    "quintic": Quintic(max_acceleration=1.0),
    "time-optimal in time": TimeOptimal(1.0, 1.0, duration=2.0),
    "s-curve in time": SCurve(1.0, 1.0, 1.0, duration=2.0),
    "quintic in time": Quintic(duration=2.0),
    "zero end rates": TimeOptimal(1.0, 1.0, start_rate=0.0, end_rate=0.0),
}


@pytest.mark.parametrize("name", AT_ZERO)
def test_a_zero_angle(name):
    motion_profile = AT_ZERO[name]

    def f(x):
        profile = motion_profile.profile(x)
        return jnp.concatenate([profile.duration[None], profile.derivatives(0.7, 2)])

    h = 1e-10  # the profiles are smooth in Φ at a fixed instant, but their switches move as √Φ or ∛Φ
    values = jax.jit(jax.vmap(f))(np.array([0.0, h, -h]))
    _, forward, reverse = jax.jit(with_jacobians(f))(0.0)
    np.testing.assert_array_equal(values[0], [0.0 if motion_profile.duration is None else 2.0, 0, 0, 0])
    np.testing.assert_array_equal(forward, reverse)
    # Without a fixed duration the slew ends at once: Φ(t) = Φ.
    difference = np.array([0.0, 1, 0, 0]) if motion_profile.duration is None else (values[1] - values[2]) / (2 * h)
    np.testing.assert_allclose(forward, difference, atol=1e-4)
