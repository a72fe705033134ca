"""Errors, commands and baselines at single states; test_simulate has the closed loops."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.motion import control
from qtraj.motion.attitude import Attitude
from qtraj.motion.control import AccelerationLaw, GeometricFeedback, LogarithmicFeedback, QuaternionFeedback, RateLaw

from ..rigs import ThreeAxis, random_gains

EXACT = 1e-12
KINDS = ("body", "inertial", "additive")
IDENTITY = np.array([1.0, 0, 0, 0])
BASELINES = (QuaternionFeedback, GeometricFeedback, LogarithmicFeedback)

program = jax.jit(lambda t: ThreeAxis()(t))


def random_states(count=20):
    """Times, quaternions of any length and rates with virtual parts."""
    rng = np.random.default_rng(1991)
    return rng.uniform(0, 6, count), rng.normal(size=(count, 4)), rng.normal(size=(count, 4))


def jet(quaternion, rate, acceleration):
    """λ(s) of a body with this state and acceleration, exact to second order in s."""
    velocity = 0.5 * qt.quaternion.product(quaternion, rate)
    second = 0.5 * (qt.quaternion.product(velocity, rate) + qt.quaternion.product(quaternion, acceleration))
    return lambda s: quaternion + s * velocity + 0.5 * s**2 * second


def ahead(s, reference, quaternion, rate, acceleration):
    """Program and body after the time s, exact to second order in s."""
    zero = jnp.zeros(1)
    omega, epsilon = (jnp.concatenate([zero, v]) for v in (reference.rate, reference.acceleration))
    moved = jet(reference.quaternion, omega, epsilon)(s)
    return Attitude(moved, reference.rate, reference.acceleration), jet(quaternion, rate, acceleration)(s)


def derivatives(f):
    """f, f' and f'' at 0, by nested forward differentiation."""
    zero, one = jnp.asarray(0.0), jnp.asarray(1.0)

    def first(s):
        return jax.jvp(f, (s,), (one,))

    (value, rate), (_, second) = jax.jvp(first, (zero,), (one,))
    return value, rate, second


@pytest.mark.parametrize("kind", KINDS)
def test_the_commanded_acceleration_makes_the_error_linear(kind):
    gains = random_gains(np.random.default_rng(3))[1:]  # scalar gains: test_the_explicit_form_for_scalar_gains
    target = np.zeros(4) if kind == "additive" else IDENTITY

    def residuals(t, quaternion, rate):
        reference = program(t)
        found = []
        for k1, k2 in gains:
            command = AccelerationLaw(k1, k2, kind)(reference, quaternion, rate)
            moving = functools.partial(
                ahead, reference=reference, quaternion=quaternion, rate=rate, acceleration=command
            )
            x, v, a = derivatives(lambda s: control.error_quaternion(*moving(s), kind))  # noqa: B023
            full1, full2 = (np.eye(4) * k if np.ndim(k) < 2 else k for k in (k1, k2))
            found += [a + full1 @ v + full2 @ (x - target), v - control.error_rate(reference, quaternion, rate, kind)]
        return jnp.stack(found)

    found = jax.jit(jax.vmap(residuals))(*random_states())
    np.testing.assert_allclose(found, 0, atol=100 * EXACT)


def test_the_commanded_rate_makes_the_error_linear():
    def residuals(t, quaternion, rate):
        found = []
        for k, _ in random_gains(np.random.default_rng(3)):
            command = RateLaw(k)(program(t), quaternion, rate)
            moving = functools.partial(
                ahead, reference=program(t), quaternion=quaternion, rate=command, acceleration=jnp.zeros(4)
            )
            x, v, _ = derivatives(lambda s: control.error_quaternion(*moving(s)))  # noqa: B023
            found.append(v + (np.eye(4) * k if np.ndim(k) < 2 else k) @ (x - IDENTITY))
        return jnp.stack(found)

    np.testing.assert_allclose(jax.jit(jax.vmap(residuals))(*random_states()), 0, atol=10 * EXACT)


def test_the_explicit_form_for_scalar_gains():
    """ε_v = μ⁻¹ε⁰μ + w×Ω − (K1+ω0)Ω − 2K2 μ_v/|μ|², ε0 = −½(ω0²−|Ω|²) − K1ω0 − 2K2(1−μ0/|μ|²)."""
    k1, k2 = 1.7, 0.8
    for t, quaternion, rate in zip(*random_states(5), strict=True):
        at = program(t)
        mu = np.asarray(control.error_quaternion(at, jnp.asarray(quaternion)))
        square = mu @ mu
        back = qt.quaternion.conjugate(jnp.asarray(mu))
        w = qt.quaternion.rotate(back, at.rate)
        rate_error = rate[1:] - w
        vector = (
            qt.quaternion.rotate(back, at.acceleration)
            + np.cross(w, rate_error)
            - (k1 + rate[0]) * rate_error
            - 2 * k2 * mu[1:] / square
        )
        scalar = -0.5 * (rate[0] ** 2 - rate_error @ rate_error) - k1 * rate[0] - 2 * k2 * (1 - mu[0] / square)
        command = AccelerationLaw(k1, k2)(at, jnp.asarray(quaternion), jnp.asarray(rate))
        np.testing.assert_allclose(command, [scalar, *vector], rtol=EXACT, atol=EXACT)


@pytest.mark.parametrize("law", [AccelerationLaw(2.0, 1.0, kind) for kind in KINDS] + [B(2.0, 1.0) for B in BASELINES])
def test_without_an_error_the_command_is_the_program(law):
    at = program(1.7)
    command = law(at, at.quaternion, jnp.concatenate([jnp.zeros(1), at.rate]))
    np.testing.assert_allclose(command, [0, *at.acceleration], atol=EXACT)


def test_scalar_diagonal_and_full_gains_agree():
    at, (_, (quaternion,), (rate,)) = program(0.4), random_states(1)
    for kind in KINDS:
        commands = [
            AccelerationLaw(2.0 * unit, 1.5 * unit, kind)(at, jnp.asarray(quaternion), jnp.asarray(rate))
            for unit in (1.0, np.ones(4), np.eye(4))
        ]
        np.testing.assert_allclose(commands[1:], [commands[0]] * 2, rtol=EXACT)


@pytest.mark.parametrize("kind", KINDS)
def test_state_from_error_inverts_error_and_error_rate(kind):
    for t, quaternion, rate in zip(*random_states(3), strict=True):
        at, quaternion, rate = program(t), jnp.asarray(quaternion), jnp.asarray(rate)
        x, v = control.error_quaternion(at, quaternion, kind), control.error_rate(at, quaternion, rate, kind)
        back = control.state_from_error(at, x, v, kind)
        np.testing.assert_allclose(back[0], quaternion, atol=EXACT)
        np.testing.assert_allclose(back[1], rate, atol=100 * EXACT)


def test_the_two_compositions():
    """(2.1) adds components in two bases, (2.2) adds vectors: Δε is the difference of the vectors, δε is not."""
    at, (_, (quaternion,), (rate,)) = program(2.1), random_states(1)
    quaternion = jnp.asarray(quaternion)
    command = AccelerationLaw(2.0, 1.0)(at, quaternion, jnp.asarray(rate))
    inner = control.body_correction(at, command)
    outer = control.inertial_correction(at, quaternion, command)
    np.testing.assert_allclose(control.body_command(at, inner), command, atol=EXACT)
    np.testing.assert_allclose(control.inertial_command(at, quaternion, outer), command, atol=EXACT)
    world = qt.quaternion.rotate(quaternion, command[1:])
    difference = world - qt.quaternion.rotate(at.quaternion, at.acceleration)
    np.testing.assert_allclose(outer[1:], difference, atol=EXACT)
    assert np.linalg.norm(qt.quaternion.rotate(quaternion, inner[1:]) - difference) > 0.1


def body(angle, axis):
    axis = np.asarray(axis) / np.linalg.norm(axis)
    return jnp.concatenate([jnp.cos(angle / 2)[None], jnp.sin(angle / 2) * axis])


RESTING = Attitude(jnp.asarray(IDENTITY), jnp.zeros(3), jnp.zeros(3))


@pytest.mark.parametrize("angle", [1e-9, 0.3, 1.2, 3.0])
def test_the_lengths_of_the_baselines_errors(angle):
    axis = np.array([1.0, -2, 2]) / 3
    for kind, length in zip(BASELINES, (2 * np.sin(angle / 2), np.sin(angle), angle), strict=True):
        for scale in (1.0, -1.0, 0.01):
            command = kind(0.0, 1.0)(RESTING, scale * body(jnp.asarray(angle), axis), jnp.zeros(4))
            np.testing.assert_allclose(command, [0, *(-length * axis)], atol=EXACT * max(angle, 1e-3))


def test_the_geometric_error_is_half_the_sum_of_the_cross_products_of_the_axes():
    at, (_, (quaternion,), _) = program(3.3), random_states(1)
    R, Rd = (np.asarray(qt.rotation.to_dcm(jnp.asarray(q))).T for q in (quaternion, at.quaternion))
    skew = 0.5 * (Rd.T @ R - R.T @ Rd)
    half_sum = 0.5 * sum(np.cross(Rd[:, k], R[:, k]) for k in range(3))  # world axes
    still = Attitude(at.quaternion, jnp.zeros(3), jnp.zeros(3))
    command = GeometricFeedback(0.0, 1.0)(still, jnp.asarray(quaternion), jnp.zeros(4))[1:]
    np.testing.assert_allclose(command, -np.array([skew[2, 1], skew[0, 2], skew[1, 0]]), atol=EXACT)
    np.testing.assert_allclose(R @ command, -half_sum, atol=EXACT)


def test_baselines_damp_the_rate_error_and_feed_the_program_forward():
    """Ω̇ = −K1Ω − K2e, with Ω = ω_v − w differentiated along the motion."""
    k1, k2 = 1.5, jnp.diag(jnp.asarray([0.5, 0.7, 0.9]))
    law = QuaternionFeedback(k1, k2)
    t, quaternion, rate = 0.9, jnp.asarray([0.9, 0.2, -0.1, 0.3]), jnp.asarray([0.0, 0.5, -0.2, 0.4])
    command = law(program(t), quaternion, rate)
    curve = jet(quaternion, rate, command)

    def rate_error(s):
        q = curve(s)
        mu = control.error_quaternion(program(t + s), q)
        return rate[1:] + s * command[1:] - qt.quaternion.rotate(qt.quaternion.conjugate(mu), program(t + s).rate)

    omega, slope = jax.jvp(rate_error, (jnp.asarray(0.0),), (jnp.asarray(1.0),))
    mu = qt.quaternion.unit(control.error_quaternion(program(t), quaternion))
    np.testing.assert_allclose(slope, -k1 * omega - k2 @ (2 * mu[1:]), atol=EXACT)


@pytest.mark.parametrize("law", [AccelerationLaw(2.0, 1.0), RateLaw(1.0)] + [B(2.0, 1.0) for B in BASELINES])
def test_commands_have_finite_derivatives_on_the_program_and_at_half_turns(law):
    jacobian = jax.jit(jax.jacfwd(lambda q: law(RESTING, q, jnp.zeros(4))))
    for quaternion in (IDENTITY, [0.0, 1, 0, 0], [0.0, 0.6, 0, -0.8]):
        slope = jacobian(jnp.asarray(quaternion))
        assert np.isfinite(slope).all()


def test_wrong_gains_and_errors_are_refused():
    with pytest.raises(
        ValueError, match=r"k1 must be a number, 4 numbers for a diagonal, or a 4 × 4 matrix, but .* with shape \(3,\)"
    ):
        AccelerationLaw(np.ones(3), 1.0)
    with pytest.raises(ValueError, match=r"k2 must be a number, 3 numbers for a diagonal, or a 3 × 3 matrix"):
        LogarithmicFeedback(1.0, np.ones(4))
    with pytest.raises(ValueError, match="finite"):
        RateLaw(np.nan)
    with pytest.raises(ValueError, match="'body', 'inertial', 'additive'"):
        AccelerationLaw(1.0, 1.0, error="world")


@pytest.mark.parametrize(
    "law", [AccelerationLaw(np.eye(4) / 3, [1, 2, 3, 4], "inertial"), RateLaw(0.1), LogarithmicFeedback(0.1, 0.7)]
)
def test_laws_are_stored_and_read_back(law, tmp_path):
    law.save(tmp_path / "law.toml")
    back = qt.load(tmp_path / "law.toml")
    assert jax.tree.structure(back) == jax.tree.structure(law)
    for a, b in zip(jax.tree.leaves(back), jax.tree.leaves(law), strict=True):
        np.testing.assert_array_equal(a, b)
