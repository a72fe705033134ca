"""The free choices at the start: the sign of λ, its length |λ| and the virtual rate ω0.

λ and −λ are one attitude, but two errors, μ and −μ, and only μ = 1 is the goal. With scalar gains, critical or
overdamped, |μ(0)| = 1, ω0(0) = 0 and μ0(0) ≥ 0, μ(t) never vanishes; from the other sheet it may pass by zero, where
the command has a pole. Since the error is known in closed form, so is the least |μ|, before anything has moved.
"""

import equinox as eqx
import jax
import jax.numpy as jnp

from qtraj.algebra.quaternion import norm_squared
from qtraj.algebra.vector import norm
from qtraj.foundation.arrays import concrete
from qtraj.foundation.types import Quat, Scalar, ScalarLike, Vec3
from qtraj.motion.attitude import Attitude
from qtraj.motion.control.errors import error_quaternion, error_rate, pure, state_from_error
from qtraj.motion.control.laws import AbstractLaw, AccelerationLaw, RateLaw
from qtraj.motion.control.response import error_state

SIGNS, GAUGES = ("auto", "near", "far"), ("unit", "gibbs")
HALF_TURN = 1e-6
"""No Gibbs gauge where the scalar part of the unit error quaternion is smaller."""

_SAMPLES = 128
_REFINEMENTS = 40


@eqx.filter_jit
def least_norm(law: AccelerationLaw | RateLaw, mu0: Quat, mu_rate0: Quat | None = None) -> Scalar:
    """min |μ(t)| over t ≥ 0 of the closed-form response to `mu0` and `mu_rate0` [1/s].

    The command grows as 1/|μ|: a small value foretells a large peak.

    **Raises:** ValueError for the additive error, whose |λ| depends on the program.
    """
    if isinstance(law, AccelerationLaw) and law.error == "additive":
        raise ValueError("the additive error foretells no |λ| without the program: take error='body' or 'inertial'")

    def size(t: Scalar) -> Scalar:
        return norm(error_state(law, mu0, mu_rate0, t)[0])

    tau = _time_scale(law).astype(mu0.dtype)
    u = jnp.arange(_SAMPLES, dtype=mu0.dtype) / _SAMPLES
    times = tau * u / (1 - u)  # from 0 to far beyond the slowest mode
    k = jnp.argmin(jax.vmap(size)(times))
    low, high = times[jnp.maximum(k - 1, 0)], times[jnp.minimum(k + 1, _SAMPLES - 1)]

    def narrow(_: ScalarLike, bounds: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
        low, high = bounds
        a, b = low + (high - low) / 3, high - (high - low) / 3
        left = size(a) <= size(b)
        return jnp.where(left, low, a), jnp.where(left, b, high)

    low, high = jax.lax.stop_gradient(jax.lax.fori_loop(0, _REFINEMENTS, narrow, (low, high)))
    # At an interior minimum the time has no first-order effect: the value's derivative is exact.
    return jnp.minimum(size(0.5 * (low + high)), norm(mu0))


def choose_sign(law: AccelerationLaw | RateLaw, reference: Attitude, quaternion: Quat, rate: Quat) -> Quat:
    """λ or −λ, whichever keeps the larger |μ| on the way to the program; for equal ones, and at rest, μ0 ≥ 0.

    `rate` (4,) [rad/s], body axes. For the additive error the nearer of the two is taken.
    """
    mu = error_quaternion(reference, quaternion)
    scalar = mu[0]
    if isinstance(law, AccelerationLaw) and law.error == "additive":
        return jnp.where(scalar < 0, -quaternion, quaternion)
    kind = law.error if isinstance(law, AccelerationLaw) else "body"
    x, v = error_quaternion(reference, quaternion, kind), error_rate(reference, quaternion, rate, kind)
    near = jnp.where(scalar < 0, -jnp.ones_like(scalar), 1.0)
    here, there = (least_norm(law, sign * near * x, sign * near * v) for sign in (1.0, -1.0))
    sign = jax.lax.stop_gradient(jnp.where(there > here, -near, near))
    return sign * quaternion


def gibbs_normalization(reference: Attitude, quaternion: Quat, rate: Quat) -> tuple[Quat, Quat]:
    """The same attitude and physical rate, with |λ| and ω0 such that μ0 = 1 and μ̇0 = 0.

    Then μ0 ≡ 1 under scalar gains, and the Gibbs vector of the error, g = μ_v/μ0, obeys g̈ + K1ġ + K2g = 0. For body and
    inertial errors. Half turns have no Gibbs vector: near them |λ| grows without bound.
    """
    mu = error_quaternion(reference, quaternion)
    scaled = mu / mu[0]
    excess = rate[1:] - reference.rate  # only its part along μ_v counts, which is the same in both axes
    omega0 = scaled[1:] @ excess
    return quaternion / mu[0], pure(rate[1:]).at[0].set(omega0)


def place(
    law: AbstractLaw, reference: Attitude, mu: Quat, excess: Vec3, sign: str = "auto", gauge: str = "unit"
) -> tuple[Quat, Quat]:
    """λ (4,) and ω (4,) [rad/s] of a body that starts with the error `mu` (4,), of length 1 and either sign.

    `excess` (3,) [rad/s], body axes: its rate less the program's. `sign` of λ: "near" (μ0 ≥ 0), "far"
    or "auto", the better one for laws whose error is linear (`choose_sign`) and the near one for others. `gauge`:
    "unit" (|λ| = 1, ω0 = 0) or "gibbs" (`gibbs_normalization`, in which μ0 = 1 whatever the sign).

    **Raises:** ValueError for another sign or gauge, and for the Gibbs gauge of the far sign or at a half turn.
    """
    if sign not in SIGNS or gauge not in GAUGES:
        raise ValueError(f"sign must be one of {SIGNS} and gauge one of {GAUGES}, but {sign!r}, {gauge!r} were given")
    if gauge == "gibbs":
        _require_gibbs(mu, sign)
    return _placed(law, reference, mu, excess, sign, gauge)


@eqx.filter_jit
def _placed(law: AbstractLaw, reference: Attitude, mu: Quat, excess: Vec3, sign: str, gauge: str) -> tuple[Quat, Quat]:
    near = jnp.where(mu[0] < 0, -mu, mu)
    quaternion, rate = state_from_error(reference, near, jnp.zeros_like(near))
    rate = pure(rate[1:] + excess)
    if gauge == "gibbs":
        return gibbs_normalization(reference, quaternion, rate)
    if sign == "far":
        return -quaternion, rate
    if sign == "auto" and isinstance(law, AccelerationLaw | RateLaw):
        return choose_sign(law, reference, quaternion, rate), rate
    return quaternion, rate


def _require_gibbs(mu: Quat, sign: str) -> None:
    if sign == "far":
        raise ValueError("the Gibbs gauge has μ0 = 1, on the near sheet: leave out sign = 'far'")
    scalar = concrete(mu[0])
    if scalar is not None and abs(float(scalar)) < HALF_TURN:
        raise ValueError("the Gibbs gauge is not possible at a half turn, which has no Gibbs vector")


def gain_growth(mu: Quat) -> Scalar:
    """1/|μ|²: the factor on the attitude gain of the physical command, 1 for a unit error quaternion."""
    return 1 / norm_squared(mu)


def _time_scale(law: AccelerationLaw | RateLaw) -> Scalar:
    """The slower of the time constants [s], roughly; any error only thins the samples."""
    if isinstance(law, RateLaw):
        return 1 / _least(law.k)
    return jnp.maximum(_most(law.k1) / _least(law.k2), 2 / _least(law.k1))


def _diagonal(k: jax.Array) -> jax.Array:
    return jnp.abs(jnp.diagonal(k) if k.ndim == 2 else jnp.atleast_1d(k))


def _most(k: jax.Array) -> Scalar:
    return jnp.max(_diagonal(k))


def _least(k: jax.Array) -> Scalar:
    return jnp.maximum(jnp.min(_diagonal(k)), jnp.finfo(k.dtype).tiny ** 0.5)
