"""Choose the free values of the initial state: the sign of λ, its norm |λ| and the virtual rate ω0.

λ and −λ represent the same attitude but have opposite errors μ and −μ, and a law drives the error to 1. Let μ0 be the
scalar part of μ. For scalar gains with critical damping or overdamping, μ(t) is never zero if |μ(0)| = 1, ω0(0) = 0 and
μ0(0) ≥ 0. With the other sign of λ, μ may pass near zero, where the command has a pole. The body error and the inertial
error have a closed form that does not depend on the program, so the minimum of |μ| can be computed in advance.
"""

import equinox as eqx
import jax
import jax.numpy as jnp

from qtraj.algebra.vector import norm
from qtraj.foundation.arrays import as_float, concrete, real_vector
from qtraj.foundation.devices import on_one_device
from qtraj.foundation.float_arguments import single_arguments
from qtraj.foundation.renamed import renamed_arguments
from qtraj.foundation.types import ArrayInput, Quat, Scalar, ScalarLike, Vec3
from qtraj.motion.attitude import Attitude
from qtraj.motion.control.baselines import BASELINES
from qtraj.motion.control.errors import error_quaternion, error_rate, pure, state_from_error
from qtraj.motion.control.hysteresis import without_hysteresis
from qtraj.motion.control.laws import AbstractLaw, AccelerationLaw, RateLaw, require_linear
from qtraj.motion.control.response import error_state

SIGNS, NORMALIZATIONS = ("auto", "near", "far"), ("unit", "gibbs")
HALF_TURN = 1e-6
"""Minimum scalar part of the unit error quaternion for the Gibbs normalization."""

_SAMPLES = 128
_REFINEMENTS = 40


@single_arguments
@eqx.filter_jit
def least_norm(law: AccelerationLaw | RateLaw, mu0: Quat, mu_rate0: Quat | None = None) -> Scalar:
    """Return the minimum of |μ(t)| over t ≥ 0 of the closed-form response.

    `mu0` and `mu_rate0` [1/s] are the error and its time derivative at t = 0. The command grows without bound as
    |μ| → 0, so a small minimum means a large peak command.

    **Raises:** ValueError for the additive error, for which |μ| depends on the program.
    """
    require_linear(law, "the minimum of |μ|")
    if isinstance(law, AccelerationLaw) and law.error == "additive":
        raise ValueError(
            "the minimum of |μ| cannot be computed in advance for error='additive', because it depends on the program: "
            "use error='body' or error='inertial'"
        )

    def size(t: Scalar) -> Scalar:
        return norm(error_state(law, mu0, mu_rate0, t)[0])

    tau = _time_scale(law).astype(mu0.dtype)
    u = jnp.arange(_SAMPLES, dtype=mu0.dtype) / _SAMPLES
    times = tau * u / (1 - u)  # from 0 to many time constants of the slowest mode
    k = jnp.argmin(jax.vmap(size)(times))
    low, high = times[jnp.maximum(k - 1, 0)], times[jnp.minimum(k + 1, _SAMPLES - 1)]

    def narrow(_: ScalarLike, bounds: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
        low, high = bounds
        a, b = low + (high - low) / 3, high - (high - low) / 3
        left = size(a) <= size(b)
        return jnp.where(left, low, a), jnp.where(left, b, high)

    low, high = jax.lax.stop_gradient(jax.lax.fori_loop(0, _REFINEMENTS, narrow, (low, high)))
    # At an interior minimum, the time has no first-order effect on the value, so the derivative of the value is exact.
    return jnp.minimum(size(0.5 * (low + high)), norm(mu0))


@single_arguments
def choose_sign(law: AccelerationLaw | RateLaw, reference: Attitude, quaternion: Quat, rate: Quat) -> Quat:
    """Return λ or −λ, whichever has the larger minimum of |μ| in the closed-form response.

    If both minima are equal, for example if body and program have the same rate, the quaternion with μ0 ≥ 0 is
    returned. For the additive error, the quaternion with μ0 ≥ 0 is always returned. `rate` (4,) [rad/s] is in body
    axes.
    """
    mu = error_quaternion(reference, quaternion)
    scalar = mu[0]
    if isinstance(law, AccelerationLaw) and law.error == "additive":
        return jnp.where(scalar < 0, -quaternion, quaternion)
    kind = law.error if isinstance(law, AccelerationLaw) else "body"
    x, v = error_quaternion(reference, quaternion, kind), error_rate(reference, quaternion, rate, kind)
    near = jnp.where(scalar < 0, -jnp.ones_like(scalar), 1.0)
    min_near, min_far = (least_norm(law, sign * near * x, sign * near * v) for sign in (1.0, -1.0))
    sign = jax.lax.stop_gradient(jnp.where(min_far > min_near, -near, near))
    return sign * quaternion


@single_arguments
def gibbs_normalization(reference: Attitude, quaternion: Quat, rate: Quat) -> tuple[Quat, Quat]:
    """Return λ and ω of the same attitude and physical rate, with |λ| and ω0 such that μ0 = 1 and μ̇0 = 0.

    For scalar gains and the body or the inertial error, μ0 then remains 1, and the Gibbs vector of the error,
    g = μ_v/μ0, satisfies g̈ + K1ġ + K2g = 0, or ġ + Kg = 0 under a rate law. A half turn has no Gibbs vector: |λ| grows
    without bound as the error approaches a half turn.
    """
    mu = error_quaternion(reference, quaternion)
    scaled = mu / mu[0]
    rate_error = rate[1:] - reference.rate  # only used along μ_v, which is the same in body and program axes
    omega0 = scaled[1:] @ rate_error
    return quaternion / mu[0], pure(rate[1:]).at[0].set(omega0)


@renamed_arguments(excess="rate_error", gauge="normalization")
@on_one_device
def place(
    law: AbstractLaw,
    reference: Attitude,
    mu: ArrayInput | None,
    rate_error: ArrayInput,
    sign: str = "auto",
    normalization: str = "unit",
) -> tuple[Quat, Quat]:
    """Return λ (4,) and ω (4,) [rad/s] of a body with the initial error `mu` (4,), a unit quaternion of either sign.

    With None for `mu`, the attitude error is zero. `rate_error` (3,) [rad/s], body axes: the rate of the body minus the
    rate of the program. `sign` of λ: "near" (μ0 ≥ 0), "far" (μ0 ≤ 0), or "auto", which uses `choose_sign` for laws with
    a linear error equation and "near" for other laws. `normalization`: "unit" (|λ| = 1, ω0 = 0) or "gibbs" (μ0 = 1, see
    `gibbs_normalization`).

    **Raises:** ValueError for an unknown `sign` or `normalization`, and for the Gibbs normalization with sign="far",
    at a half turn, or with a law whose Gibbs vector does not satisfy a linear equation.
    """
    if sign not in SIGNS:
        raise ValueError(f"sign must be one of {', '.join(map(repr, SIGNS))}, but {sign!r} was given")
    if normalization not in NORMALIZATIONS:
        raise ValueError(
            f"normalization must be one of {', '.join(map(repr, NORMALIZATIONS))}, but {normalization!r} was given"
        )
    reference = jax.tree.map(as_float, reference, is_leaf=lambda x: isinstance(x, list | tuple) and x is not reference)
    rate_error = real_vector(rate_error, "rate_error", 3)
    mu = jnp.zeros_like(reference.quaternion).at[0].set(1.0) if mu is None else real_vector(mu, "mu", 4)
    if normalization == "gibbs":
        _require_gibbs(law, mu, sign)
    return _place(law, reference, mu, rate_error, sign, normalization)


@eqx.filter_jit
def _place(
    law: AbstractLaw, reference: Attitude, mu: Quat, rate_error: Vec3, sign: str, normalization: str
) -> tuple[Quat, Quat]:
    near = jnp.where(mu[0] < 0, -mu, mu)
    quaternion, rate = state_from_error(reference, near, jnp.zeros_like(near))
    rate = pure(rate[1:] + rate_error)
    if normalization == "gibbs":
        return gibbs_normalization(reference, quaternion, rate)
    if sign == "far":
        return -quaternion, rate
    if sign == "auto" and isinstance(law, AccelerationLaw | RateLaw):
        return choose_sign(law, reference, quaternion, rate), rate
    return quaternion, rate


def _require_gibbs(law: AbstractLaw, mu: Quat, sign: str) -> None:
    law = without_hysteresis(law)
    if getattr(law, "error", None) == "additive" or isinstance(law, tuple(BASELINES.values())):
        raise ValueError(
            "the normalization 'gibbs' is possible only for a law with the body or the inertial error, whose Gibbs "
            "vector satisfies a linear equation: use the normalization 'unit'"
        )
    if sign == "far":
        raise ValueError("the normalization 'gibbs' means μ0 = 1, which contradicts the sign 'far': use another sign")
    scalar = concrete(mu[0])
    if scalar is not None and abs(float(scalar)) < HALF_TURN:
        raise ValueError(
            "the normalization 'gibbs' is not possible for an error of a half turn, which has no Gibbs vector: use the "
            "normalization 'unit'"
        )


def _time_scale(law: AccelerationLaw | RateLaw) -> Scalar:
    """Estimate the slowest time constant [s]; an error of the estimate only affects the spacing of the samples."""
    if isinstance(law, RateLaw):
        return 1 / _min_gain(law.k)
    return jnp.maximum(_max_gain(law.k1) / _min_gain(law.k2), 2 / _min_gain(law.k1))


def _diagonal(k: jax.Array) -> jax.Array:
    return jnp.abs(jnp.diagonal(k) if k.ndim == 2 else jnp.atleast_1d(k))


def _max_gain(k: jax.Array) -> Scalar:
    return jnp.max(_diagonal(k))


def _min_gain(k: jax.Array) -> Scalar:
    return jnp.maximum(jnp.min(_diagonal(k)), jnp.finfo(k.dtype).tiny ** 0.5)
