"""Compute the error of a closed loop in closed form, by a matrix exponential that does not depend on the program.

Let x be the error minus its target. Then (x, ẋ)(t) = exp([[0, 1], [−K2, −K1]] t) (x, ẋ)(0) for an `AccelerationLaw`,
and x(t) = exp(−Kt) x(0) for a `RateLaw`. For scalar and diagonal gains, each component has an elementary solution that
is exact to round-off and smooth across critical damping.
"""

from __future__ import annotations  # so that `help` shows short names

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import expm
from jaxtyping import Array, Float

from qtraj.algebra.polynomial import horner
from qtraj.foundation.arrays import as_float, as_seconds, real_vector
from qtraj.foundation.devices import on_one_device
from qtraj.foundation.float_arguments import single_arguments
from qtraj.foundation.types import ArrayInput, Mat4, Quat, ScalarLike
from qtraj.motion.control.errors import target
from qtraj.motion.control.laws import AbstractLaw, AccelerationLaw, RateLaw, apply, require_linear

_COSINE = [1 / math.factorial(2 * k) for k in range(10)]
_SINE = [1 / math.factorial(2 * k + 1) for k in range(10)]
_NEAR_CRITICAL = 0.5
"""Value of |k1²/4 − k2|t² below which the power series of `_waves` and two derivatives are exact to round-off."""


@on_one_device
def error_response(
    law: AccelerationLaw | RateLaw, mu0: ArrayInput, mu_rate0: ArrayInput | None, t: ArrayInput
) -> Float[Array, "... 4"]:
    """Compute the error quaternion (4,) at the time `t` [s], or (n, 4) at n instants.

    `mu0` (4,) and `mu_rate0` (4,) [1/s] are the error of the law (μ, μ* or Δ) and its time derivative at t = 0. For a
    rate law, `mu_rate0` is not used and may be None.

    **Raises:** ValueError for arrays of another shape, or an acceleration law without `mu_rate0`.
    """
    mu0 = real_vector(mu0, "the error", 4)
    mu_rate0 = None if mu_rate0 is None else real_vector(mu_rate0, "the rate of the error", 4)
    t = as_seconds(t)

    if isinstance(law, AccelerationLaw) and mu_rate0 is None:
        raise ValueError(
            "the response of an AccelerationLaw needs mu_rate0, the time derivative of the error at t = 0, but None "
            "was given"
        )
    return _response(law, mu0, mu_rate0, t)


@eqx.filter_jit
def _response(law: AccelerationLaw | RateLaw, mu0: Quat, mu_rate0: Quat | None, t: Array) -> Float[Array, "... 4"]:
    def response(t: Array) -> Quat:
        return error_state(law, mu0, mu_rate0, t)[0]

    return jax.vmap(response)(t) if t.ndim else response(t)


@single_arguments
def error_state(law: AccelerationLaw | RateLaw, mu0: Quat, mu_rate0: Quat | None, t: ScalarLike) -> tuple[Quat, Quat]:
    """Return the error quaternion and its time derivative [1/s] at one instant `t` [s]; see `error_response`.

    For an acceleration law, `mu_rate0=None` means zero; a rate law ignores `mu_rate0`.
    """
    require_linear(law, "the response of a law")
    t = as_float(t).astype(mu0.dtype)
    if isinstance(law, RateLaw):
        x = _decayed(law.k.astype(mu0.dtype), mu0 - target("body", mu0), t)
        return target("body", mu0) + x, -apply(law.k, x)
    goal = target(law.error, mu0)
    k1, k2 = law.k1.astype(mu0.dtype), law.k2.astype(mu0.dtype)
    x, v = mu0 - goal, jnp.zeros_like(mu0) if mu_rate0 is None else mu_rate0.astype(mu0.dtype)
    if k1.ndim < 2 and k2.ndim < 2:
        x, v = _decoupled(k1, k2, x, v, t)
    else:
        x, v = _coupled(_matrix(k1), _matrix(k2), x, v, t)
    return goal + x, v


def spectral_abscissa(law: AbstractLaw) -> float:
    """Return the largest real part [1/s] of the closed-loop eigenvalues; errors decay if the result is negative.

    For the baseline laws, the loop is linearised about zero error. The gains must be concrete: call this function
    outside jit, grad and vmap.

    **Raises:** ValueError for a law that has neither the gains `k1` and `k2` nor a gain `k`.
    """
    if isinstance(law, RateLaw):
        return float(-np.linalg.eigvals(_full(law.k, 4)).real.min())
    k1, k2 = getattr(law, "k1", None), getattr(law, "k2", None)
    if k1 is None or k2 is None:
        raise ValueError(f"a law with gains k1 and k2, or k, was expected, but {law!r} was given")
    size = 4 if isinstance(law, AccelerationLaw) else 3
    zero, identity = np.zeros((size, size)), np.eye(size)
    block = np.block([[zero, identity], [-_full(k2, size), -_full(k1, size)]])
    eigenvalues = np.linalg.eigvals(block)
    largest = float(eigenvalues.real.max())
    rounding = len(block) * np.finfo(float).eps * float(np.abs(eigenvalues).max())
    return 0.0 if abs(largest) <= rounding else largest


def _full(k: Array, size: int) -> np.ndarray:
    gains = np.asarray(k, float)
    return gains if gains.ndim == 2 else np.diag(np.broadcast_to(gains, (size,)))


def _decoupled(k1: Array, k2: Array, x: Quat, v: Quat, t: Array) -> tuple[Quat, Quat]:
    """Return x and v = ẋ at `t` for ẍ + k1ẋ + k2x = 0 with scalar or diagonal gains, from the initial `x` and `v`."""
    k1, k2 = jnp.broadcast_to(k1, (4,)), jnp.broadcast_to(k2, (4,))
    half = 0.5 * k1
    cosine, sine = _waves(half, half * half - k2, t)
    return (cosine + half * sine) * x + sine * v, (cosine - half * sine) * v - k2 * sine * x


def _waves(half: Quat, d: Quat, t: Array) -> tuple[Quat, Quat]:
    """Return e^(−st) cosh(√d t) and e^(−st) sinh(√d t)/√d with s = `half`, for any sign of d, without overflow."""
    z = d * (t * t)
    small = jnp.abs(z) < _NEAR_CRITICAL
    real, imaginary = (z > 0) & ~small, (z < 0) & ~small
    decay = jnp.exp(-half * t)
    near = jnp.where(small, z, 0.0)
    cosine, sine = decay * horner(_COSINE, near), decay * t * horner(_SINE, near)
    root = jnp.sqrt(jnp.where(real, d, 1.0))
    slow, fast = (jnp.exp(jnp.where(real, (sign * root - half) * t, 0.0)) for sign in (1, -1))
    cosine = jnp.where(real, 0.5 * (slow + fast), cosine)
    sine = jnp.where(real, 0.5 * (slow - fast) / root, sine)
    frequency = jnp.sqrt(jnp.where(imaginary, -d, 1.0))
    cosine = jnp.where(imaginary, decay * jnp.cos(frequency * t), cosine)
    return cosine, jnp.where(imaginary, decay * jnp.sin(frequency * t) / frequency, sine)


def _coupled(k1: Mat4, k2: Mat4, x: Quat, v: Quat, t: Array) -> tuple[Quat, Quat]:
    """Return x and v = ẋ at `t` from the initial `x` and `v`, by the exponential of the 8 × 8 block matrix."""
    zero, identity = jnp.zeros_like(k1), jnp.eye(4, dtype=k1.dtype)
    block = jnp.block([[zero, identity], [-k2, -k1]])
    state = jnp.matmul(expm(block * t), jnp.concatenate([x, v]), precision="highest")
    return state[:4], state[4:]


def _decayed(k: Array, x: Quat, t: Array) -> Quat:
    return jnp.matmul(expm(-k * t), x, precision="highest") if k.ndim == 2 else jnp.exp(-k * t) * x


def _matrix(k: Array) -> Mat4:
    return k if k.ndim == 2 else jnp.diag(jnp.broadcast_to(k, (4,)))
