"""Gains, the closed-form response, and the choice of sign and normalization."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
import scipy.linalg

from qtraj.motion import control
from qtraj.motion.control import AccelerationLaw, RateLaw, gains

from ..rigs import Rest, ThreeAxis, random_gains

EXACT = 1e-13
MU0, RATE0 = jnp.asarray([0.4, -0.5, 0.2, 0.7]), jnp.asarray([0.3, 0.9, -1.1, 0.2])
IDENTITY = np.array([1.0, 0, 0, 0])


def block(k1, k2):
    full = [np.eye(4) * k if np.ndim(k) < 2 else np.asarray(k) for k in (k1, k2)]
    return np.block([[np.zeros((4, 4)), np.eye(4)], [-full[1], -full[0]]])


@pytest.mark.parametrize(("index", "kind"), [(0, "additive"), (1, "body"), (2, "inertial")])
def test_the_response_is_the_exponential_of_the_block_matrix(index, kind):
    k1, k2 = random_gains(np.random.default_rng(7))[index]
    target = np.zeros(4) if kind == "additive" else IDENTITY
    times = np.array([0.0, 0.3, 2.0, 9.0])
    response = control.error_response(AccelerationLaw(k1, k2, kind), MU0, RATE0, times)
    for t, mu in zip(times, response, strict=True):
        moved = scipy.linalg.expm(block(k1, k2) * t) @ np.concatenate([MU0 - target, RATE0])
        np.testing.assert_allclose(mu, target + moved[:4], atol=10 * EXACT)
    one = control.error_state(AccelerationLaw(k1, k2, kind), MU0, RATE0, 2.0)
    np.testing.assert_allclose(one[0], response[2], atol=EXACT)
    moved = scipy.linalg.expm(block(k1, k2) * 2.0) @ np.concatenate([MU0 - target, RATE0])
    np.testing.assert_allclose(one[1], moved[4:], atol=10 * EXACT)


def test_the_response_of_the_rate_law():
    for k, _ in random_gains(np.random.default_rng(7)):
        full = np.eye(4) * k if np.ndim(k) < 2 else k
        expected = IDENTITY + scipy.linalg.expm(-full * 0.8) @ (MU0 - IDENTITY)
        np.testing.assert_allclose(control.error_response(RateLaw(k), MU0, None, 0.8), expected, atol=EXACT)
        mu, rate = control.error_state(RateLaw(k), MU0, None, 0.8)
        np.testing.assert_allclose(rate, -full @ (mu - IDENTITY), atol=EXACT)


@pytest.mark.parametrize(
    ("k1", "k2"),
    [(2.0, 1.0), (2.0, 1.0 + 1e-9), (2.0, 0.9), (2.0, 25.0), (50.0, 0.01), (0.0, 4.0), (0.0, 0.0), (3.0, -0.5)],
)
def test_the_elementary_solutions_at_and_near_critical_damping(k1, k2):
    def first(k1, k2, t):
        start = jnp.asarray([2.0, 0, 0, 0])  # x = (1, 0, 0, 0)
        return control.error_response(AccelerationLaw(k1, k2), start, -0.5 * start, t)[0] - 1

    value = jax.jit(jax.value_and_grad(first, argnums=(0, 1, 2)))
    for t in (0.01, 0.7, 3.0):
        with mpmath.workdps(40):

            def exact(a, b, t):
                moved = mpmath.expm(mpmath.matrix([[0, t], [-b * t, -a * t]]))
                return moved[0, 0] - moved[0, 1]

            expected = float(exact(k1, k2, t))
            slopes = [float(mpmath.diff(exact, (k1, k2, t), n)) for n in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
        found, slope = value(k1, k2, t)
        np.testing.assert_allclose(found, expected, rtol=EXACT, atol=EXACT)
        np.testing.assert_allclose(slope, slopes, rtol=1e-9, atol=1e-10)


def test_no_overflow_at_large_times():
    for k1, k2 in ((50.0, 0.01), (2.0, 1.0), (0.2, 9.0)):
        far = control.error_response(AccelerationLaw(k1, k2), MU0, RATE0, 1e6)
        np.testing.assert_allclose(far, IDENTITY, atol=EXACT)
        slope = jax.grad(lambda k: control.error_response(AccelerationLaw(k, k2), MU0, RATE0, 1e6)[0])(k1)  # noqa: B023
        assert np.isfinite(slope)


def test_an_acceleration_law_needs_the_rate():
    with pytest.raises(ValueError, match="needs mu_rate0"):
        control.error_response(AccelerationLaw(2.0, 1.0), MU0, None, 1.0)


@pytest.mark.parametrize(("residual", "kt"), [(0.05, 4.744), (0.02, 5.834), (0.01, 6.638), (0.001, 9.233)])
def test_gains_from_a_settling_time(residual, kt):
    k1, k2 = gains.from_settling_time(10.0, residual)
    np.testing.assert_allclose(k1, 2 * kt / 10, atol=1e-4)
    np.testing.assert_allclose(k2, k1**2 / 4, rtol=EXACT)
    final = control.error_response(AccelerationLaw(k1, k2, "additive"), MU0, np.zeros(4), 10.0)
    np.testing.assert_allclose(final, residual * MU0, rtol=1e-11)


@pytest.mark.parametrize("residual", [1 - 1e-9, 0.5, 1e-3, 1e-300])
def test_settling_gains_are_exact_and_differentiable_at_extreme_residuals(residual):
    k1, _ = gains.from_settling_time(1.0, residual)
    x = 0.5 * float(k1)
    np.testing.assert_allclose(np.log1p(x) - x, np.log(residual), rtol=1e-6 if residual > 0.99 else 1e-13)
    slope = jax.grad(lambda r: gains.from_settling_time(1.0, r)[0])(residual)
    np.testing.assert_allclose(slope, -2 * (1 + x) / (x * residual), rtol=1e-5 if residual > 0.99 else 1e-12)


def test_gains_from_damping_and_from_weights():
    np.testing.assert_allclose(gains.from_damping(0.7, 3.0), (4.2, 9.0), rtol=EXACT)
    np.testing.assert_allclose(gains.from_damping(1.0, 2.0), (4.0, 4.0), rtol=EXACT)
    A, B = np.array([[0.0, 1], [0, 0]]), np.array([[0.0], [1]])
    for q1, q2, r in ((4.0, 0.0, 1.0), (3.0, 2.0, 0.5)):
        P = scipy.linalg.solve_continuous_are(A, B, np.diag([q1, q2]), np.array([[r]]))
        k2, k1 = (B.T @ P / r)[0]
        np.testing.assert_allclose(gains.from_weights(q1, q2, r), (k1, k2), rtol=1e-10)


def test_arguments_of_single_and_double_precision_can_be_mixed():
    for make in (gains.from_settling_time, gains.from_damping):
        np.testing.assert_allclose(make(np.float32(2.0), 0.5), make(2.0, 0.5), rtol=EXACT)
    np.testing.assert_allclose(gains.from_weights(np.float32(4.0), 2.0, 1.0), gains.from_weights(4.0, 2.0, 1.0))
    assert gains.from_damping(np.float32(2.0), np.float32(0.5))[0].dtype == np.float64


def test_arguments_out_of_range_are_refused():
    for call, message in [
        (lambda: gains.from_settling_time(-1.0), "settling time must be positive"),
        (lambda: gains.from_settling_time(1.0, 1.0), "between 0 and 1"),
        (lambda: gains.rate_from_settling_time(0.0), "settling time must be positive"),
        (lambda: gains.rate_from_settling_time(1.0, 0.0), "between 0 and 1"),
        (lambda: gains.from_damping(0.0, 1.0), "damping ratio"),
        (lambda: gains.from_damping(1.0, -1.0), "natural frequency"),
        (lambda: gains.from_weights(0.0, 1.0, 1.0), "weight of the error"),
        (lambda: gains.from_weights(1.0, -1.0, 1.0), "must not be negative"),
        (lambda: gains.from_weights(1.0, 1.0, 0.0), "weight of the command"),
    ]:
        with pytest.raises(ValueError, match=message):
            call()


def unit_starts(count, spread):
    """|μ| = 1, μ0 ≥ 0, ω0 = 0 (so μ̇ ⊥ μ), at rates up to a few times `spread`."""
    rng = np.random.default_rng(12)
    mu = rng.normal(size=(count, 4))
    mu /= np.linalg.norm(mu, axis=1, keepdims=True)
    mu[:, 0] = np.abs(mu[:, 0])
    rate = spread * rng.normal(size=(count, 4))
    return mu, rate - np.sum(rate * mu, axis=1, keepdims=True) * mu


def test_the_error_does_not_vanish_with_the_near_sign_at_any_rate():
    """For critical and overdamped scalar gains; `least_norm` agrees with a dense scan."""
    times = np.concatenate([np.linspace(0, 3, 1500), np.linspace(3, 60, 600)])

    def both(mu, rate, k1):
        law = AccelerationLaw(k1, 1.0)
        dense = jnp.linalg.norm(control.error_response(law, mu, rate, times), axis=1)
        return control.least_norm(law, mu, rate), jnp.min(dense)

    run = jax.jit(jax.vmap(both, in_axes=(0, 0, None)))
    for spread in (1.0, 30.0):
        mu, rate = unit_starts(60, spread)
        for k1 in (2.0, 5.0):
            minimum, dense = run(mu, rate, k1)
            assert (minimum > 0.01 / spread).all()
            assert (minimum <= dense + 1e-12).all()
            np.testing.assert_allclose(minimum, dense, atol=2e-2)


def test_the_error_vanishes_with_the_far_sign():
    law = AccelerationLaw(2.0, 1.0)
    assert control.least_norm(law, -jnp.asarray(IDENTITY), jnp.zeros(4)) < 1e-9
    assert control.least_norm(RateLaw(1.0), -jnp.asarray(IDENTITY)) < 1e-9
    assert control.least_norm(law, jnp.asarray(IDENTITY), jnp.zeros(4)) == 1.0
    with pytest.raises(ValueError, match="additive"):
        control.least_norm(AccelerationLaw(2.0, 1.0, "additive"), MU0, RATE0)


def test_the_chosen_sign_is_the_near_one_at_rest_and_the_larger_minimum_at_speed():
    rest, still = Rest()(0.0), jnp.zeros(4)
    near = jnp.asarray([0.3, 0.9, -0.2, 0.1])
    laws = [AccelerationLaw(2.0, 1.0, kind) for kind in ("body", "inertial", "additive")] + [RateLaw(1.0)]
    for law in laws:
        for start in (near, -near):
            np.testing.assert_allclose(control.choose_sign(law, rest, start, still), near)
    # At a fast rate away from λ⁰ the error keeps further from zero towards −λ⁰.
    law, fast = AccelerationLaw(2.0, 1.0), jnp.asarray([0.0, 12.0, 0, 0])
    start = jnp.asarray([0.3, np.sqrt(1 - 0.09), 0, 0])
    chosen = control.choose_sign(law, rest, start, fast)
    sizes = [
        control.least_norm(law, sign * start, control.error_rate(rest, sign * start, fast)) for sign in (1.0, -1.0)
    ]
    assert sizes[1] > sizes[0]
    np.testing.assert_array_equal(chosen, -start)


def test_the_gibbs_normalization_keeps_the_scalar_at_one_and_the_gibbs_vector_linear():
    program, k1, k2 = ThreeAxis(), 2.5, 1.2
    at = program(1.0)
    quaternion, rate = jnp.asarray([0.2, -0.4, 0.3, -0.6]), jnp.asarray([0.7, 0.5, -0.3, 0.9])
    scaled, normalized = control.gibbs_normalization(at, quaternion, rate)
    np.testing.assert_allclose(normalized[1:], rate[1:])
    np.testing.assert_allclose(np.abs(scaled @ quaternion), np.linalg.norm(scaled) * np.linalg.norm(quaternion))
    for kind in ("body", "inertial"):
        mu, slope = control.error_quaternion(at, scaled, kind), control.error_rate(at, scaled, normalized, kind)
        np.testing.assert_allclose([mu[0], slope[0]], [1, 0], atol=EXACT)
        response = control.error_response(AccelerationLaw(k1, k2, kind), mu, slope, np.linspace(0, 5, 6))
        np.testing.assert_allclose(response[:, 0], 1, atol=EXACT)
        gibbs = response[:, 1:] / response[:, :1]
        alone = control.error_response(AccelerationLaw(k1, k2, "additive"), mu * (1 - IDENTITY), slope, 5.0)
        np.testing.assert_allclose(gibbs[-1], alone[1:], atol=EXACT)
