"""A profile from a function: its derivatives, ends, limits of its peaks, and refusals."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt

IDENTITY = [1.0, 0.0, 0.0, 0.0]
CYCLOID = qt.FunctionProfile(lambda t: t - jnp.sin(t), 2 * np.pi)


def test_all_derivatives_are_those_of_the_function():
    profile = CYCLOID.profile(-1.5)
    for t in np.linspace(0.0, 6.28, 23):
        expected = -1.5 / (2 * np.pi) * np.array([t - np.sin(t), 1 - np.cos(t), np.sin(t), np.cos(t)])
        np.testing.assert_allclose(profile.derivatives(t, 3), expected, atol=1e-10)
    assert float(profile.angle(10.0)) == -1.5
    assert float(profile.rate(10.0)) == 0.0
    np.testing.assert_allclose(profile.peak(1), [np.pi, 1.5 / np.pi], rtol=1e-12)


def test_a_polynomial_agrees_with_its_own_class():
    duration = 3.0
    own = qt.FunctionProfile(
        lambda t: (t / duration) ** 3 * (10 - 15 * t / duration + 6 * (t / duration) ** 2), duration
    )
    known, end = qt.Quintic(duration=duration), [1.0, 0.3, -0.2, 0.5]
    for t in (0.0, 0.7, 2.9, 4.0):
        a, b = (qt.EulerTurn(IDENTITY, end, law)(t) for law in (own, known))
        np.testing.assert_allclose(a.quaternion, b.quaternion, atol=1e-13)
        np.testing.assert_allclose(a.acceleration, b.acceleration, atol=1e-11)
    a, b = (qt.peak_torque(qt.EulerTurn(IDENTITY, end, law), [1.0, 2.0, 2.5]).norm for law in (own, known))
    np.testing.assert_allclose(a, b, rtol=1e-9)
    verdicts = [qt.judge_slew(qt.EulerTurn(IDENTITY, end, law)) for law in (own, known)]
    np.testing.assert_allclose(verdicts[0].peaks, verdicts[1].peaks, rtol=1e-9)
    sequence = qt.SlewSequence([IDENTITY, end, IDENTITY], own)
    np.testing.assert_allclose(sequence.duration, 2 * duration)


def test_a_uniform_rotation_does_not_start_at_rest():
    turn = qt.EulerTurn(IDENTITY, [1.0, 1.0, 0.0, 0.0], qt.FunctionProfile(lambda t: t, 2.0))
    for t in (0.0, 1.0, 2.0):
        np.testing.assert_allclose(turn(t).rate, [np.pi / 4, 0.0, 0.0], atol=1e-12)


def test_derivatives_and_batches_with_respect_to_parameters():
    def component(a):
        law = qt.FunctionProfile(lambda t: t**2 * (3 - t) + a * t**2 * (2 - t) ** 2, 2.0)
        return qt.EulerTurn(IDENTITY, [1.0, 0.3, 0.0, 0.0], law)(0.7).quaternion[1]

    step = 1e-5
    difference = (component(0.1 + step) - component(0.1 - step)) / (2 * step)
    np.testing.assert_allclose(jax.grad(component)(0.1), difference, rtol=1e-7)
    batch = jax.jit(jax.vmap(component))(jnp.array([0.0, 0.1]))
    np.testing.assert_allclose(batch[1], component(0.1), atol=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: qt.FunctionProfile(3.0, 1.0), "needs a function of time"),
        (lambda: qt.FunctionProfile(lambda t: jnp.stack([t, t]), 1.0), "must return a scalar"),
        (lambda: qt.FunctionProfile(lambda t: np.sin(t), 1.0), "cannot be traced by JAX"),
        (lambda: qt.FunctionProfile(lambda t: 0 * t, 1.0), "different values at 0 and at the duration"),
        (lambda: qt.FunctionProfile(lambda t: jnp.sqrt(t), 1.0), "must be finite, with four derivatives"),
        (lambda: qt.FunctionProfile(lambda t: t, -1.0), "must be positive"),
        (lambda: qt.FunctionProfile(lambda t: t, 1.0, cells=0), "cells must be a positive integer"),
    ],
)
def test_invalid_functions_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()
