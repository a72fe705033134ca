"""Compute gains from a settling time, a damping ratio, or quadratic weights.

The functions return K1 [1/s] and K2 [1/s²] of the equation ẍ + K1ẋ + K2x = 0 of the error x, as in
`AccelerationLaw(*gains.from_settling_time(10.0))`. Only `rate_from_settling_time` returns K [1/s] of ẋ + Kx = 0. All
gains are differentiable with respect to the arguments.
"""

import jax
import jax.numpy as jnp
import numpy as np

from qtraj.foundation.arrays import as_float, concrete, require_finite, require_positive
from qtraj.foundation.devices import on_one_device
from qtraj.foundation.types import ArrayInput, Scalar
from qtraj.motion.checks import common_dtype

RESIDUAL = 0.02
"""Default fraction of the initial error at the settling time."""
_NEWTON_STEPS = 8  # enough for an error at the level of round-off in float64, for every residual


@on_one_device
def from_settling_time(time: ArrayInput, residual: ArrayInput = RESIDUAL) -> tuple[Scalar, Scalar]:
    """Return critically damped gains K1 = 2k, K2 = k² with which the error decays to `residual` in `time` [s].

    `residual` is a fraction of the initial error; the initial time derivative of the error is assumed to be zero. k
    satisfies (1 + kt)e^(−kt) = residual with t = `time`. For residuals of 5, 2, 1 and 0.1 %, kt is 4.744, 5.834, 6.638
    and 9.233.

    **Raises:** ValueError for a time that is not positive, or a residual outside (0, 1).
    """
    time, residual = _settling(time, residual)
    k = _critical_time(residual) / time
    return 2 * k, k * k


def rate_from_settling_time(time: ArrayInput, residual: ArrayInput = RESIDUAL) -> Scalar:
    """Return the gain K = −ln(residual)/time [1/s] of a `RateLaw`.

    With this gain, the error decays to the fraction `residual` of its initial value in `time` [s].

    **Raises:** ValueError for a time that is not positive, or a residual outside (0, 1).
    """
    time, residual = _settling(time, residual)
    return -jnp.log(residual) / time


@on_one_device
def from_damping(ratio: ArrayInput, frequency: ArrayInput) -> tuple[Scalar, Scalar]:
    """Return K1 = 2ζω_n and K2 = ω_n² for the damping `ratio` ζ and the undamped natural `frequency` ω_n [rad/s].

    **Raises:** ValueError for arguments that are not positive.
    """
    ratio, frequency = _common_dtype(ratio, frequency)
    require_positive(ratio, "the damping ratio", "1")
    require_positive(frequency, "the natural frequency", "rad/s")
    return 2 * ratio * frequency, frequency * frequency


@on_one_device
def from_weights(error: ArrayInput, rate: ArrayInput = 0.0, command: ArrayInput = 1.0) -> tuple[Scalar, Scalar]:
    """Return the gains that minimise ∫(q1 x² + q2 ẋ² + r ẍ²)dt: K2 = √(q1/r) and K1 = √(q2/r + 2√(q1/r)).

    The weights are q1 = `error` [1/s⁴], q2 = `rate` [1/s²] and r = `command`; only their ratios matter. The
    result is the linear-quadratic regulator for ẍ = u with the error x and the command u.

    **Raises:** ValueError if q1 or r is not positive, or q2 is negative.
    """
    q1, q2, r = _common_dtype(error, rate, command)
    require_positive(q1, "the weight of the error", "1/s⁴")
    require_positive(r, "the weight of the command", "1")
    require_finite(q2, "the weight of the rate")
    value = concrete(q2)
    if value is not None and np.any(value < 0):
        raise ValueError(f"the weight of the rate must not be negative, but {value.tolist()} was given")
    k2 = jnp.sqrt(q1 / r)
    return jnp.sqrt(q2 / r + 2 * k2), k2


def _settling(time: ArrayInput, residual: ArrayInput) -> list[Scalar]:
    """Return time and residual as scalars of one dtype, after checking their ranges."""
    time, residual = _common_dtype(time, residual)
    require_positive(time, "the settling time", "s")
    value = concrete(residual)
    if value is not None and not np.all((value > 0) & (value < 1)):
        raise ValueError(
            "the residual, the fraction of the initial error at the settling time, must be between 0 and 1, but "
            f"{value.tolist()} was given"
        )
    return [time, residual]


def _common_dtype(*values: ArrayInput) -> list[Scalar]:
    numbers = [as_float(x) for x in values]
    dtype = common_dtype(*numbers)
    return [x.astype(dtype) for x in numbers]


def _critical_time(residual: Scalar) -> Scalar:
    """Solve ln(1 + x) − x = ln(residual) for x > 0 by Newton's method; x is the gain k times the settling time."""
    goal = -jnp.log(residual)

    def step(x: Scalar) -> Scalar:
        return x + (goal + jnp.log1p(x) - x) * (1 + x) / x

    x = goal + jnp.sqrt(2 * goal)  # asymptotically exact for residual → 1 and residual → 0
    for _ in range(_NEWTON_STEPS):
        x = step(x)
    return step(jax.lax.stop_gradient(x))  # at the solution, the derivative of one step is the exact derivative
