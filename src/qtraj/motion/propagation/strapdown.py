"""λ(t) from a recorded rate: the samples are joined by local polynomials, which are then integrated exactly.

Every interval has its own polynomial, through the samples around it, at whatever times they were taken. Classical
coning algorithms correct the sum of increments for what turned between them; here the polynomial does, to a high order.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation.arrays import as_float, concrete
from qtraj.foundation.types import ArrayInput, Quat
from qtraj.motion.checks import at_once, common_dtype, initial_quaternion, output_times, require_axes
from qtraj.motion.propagation.gauss_legendre import GaussLegendre
from qtraj.motion.propagation.increment import AbstractIncrement, accumulate, from_body, increments, to_body
from qtraj.motion.propagation.lagrange import lagrange

KINDS = ("instantaneous", "mean", "increment")

DEGREE = 5
DEGREE_OF_MEANS = 6
"""Of the local polynomial of the rate. Odd for instants and even for means: then as many samples stand on either side.
Higher degrees gain in smooth motion, and lose where noisy samples have nearly the same time."""


def propagate_samples(
    times: ArrayInput,
    rates: ArrayInput,
    q0: ArrayInput,
    kind: str = "instantaneous",
    axes: str = "body",
    *,
    degree: int | None = None,
    method: AbstractIncrement | None = None,
    max_gap: float | None = 5.0,
) -> Float[Array, "n 4"]:
    """The quaternions (n, 4) at `times` (n,) [s] of a body whose rate was recorded there; q0 (4,) is that at times[0].

    `rates` (n, 3), in body or inertial `axes`, are by `kind`:

    - "instantaneous": ω(t_k) [rad/s];
    - "mean": the mean of ω over the preceding interval, t_{k−1} to t_k [rad/s];
    - "increment": the integral of ω over it, θ_k [rad], as integrating gyros give it.

    For "mean" and "increment" the first row precedes the propagation and is not used. `degree` of the local polynomial
    of the rate, 5 (6 for means and increments) unless given; short recordings take what they can. `method` integrates
    it: `GaussLegendre(stages=6)` unless given. Times may be uneven; an interval longer than `max_gap` times the median
    is taken for a gap (None: no such check).

    **Raises:** ValueError for other shapes, kinds and axes, rates that are not finite, times that do not increase
    strictly, or a gap; it names the sample and its time.
    """
    require_axes(axes)
    if kind not in KINDS:
        raise ValueError(f"kind must be one of {', '.join(map(repr, KINDS))}, but {kind!r} was given")
    with at_once():
        times, q0 = output_times(times), initial_quaternion(q0)
        rates = _checked_rates(rates, times, kind)
        _require_no_gap(times, max_gap)
    if times.shape[0] == 1:
        return q0[None]
    if degree is None:
        degree = DEGREE if kind == "instantaneous" else DEGREE_OF_MEANS
    if degree < 0:
        raise ValueError(f"the degree of the local polynomial must not be negative, but {degree!r} was given")
    dtype = common_dtype(times, rates, q0)
    method = GaussLegendre(stages=6) if method is None else method
    return _integrate(method, kind, axes, degree, times.astype(dtype), rates.astype(dtype), q0.astype(dtype))


def _checked_rates(rates: ArrayInput, times: Array, kind: str) -> Float[Array, "n 3"]:
    rates = as_float(rates)
    if rates.shape != (times.shape[0], 3):
        raise ValueError(f"{times.shape[0]} times need rates of shape ({times.shape[0]}, 3), not {rates.shape}")
    if kind != "instantaneous":
        rates = rates.at[0].set(0.0)
    known = concrete(rates)
    if known is not None and not np.all(np.isfinite(known)):
        i = int(np.argmin(np.all(np.isfinite(known), axis=1)))
        raise ValueError(f"the rates must be finite, but sample {i}{_at(times, i)} is {known[i].tolist()}")
    return rates


def _at(times: Array, i: int) -> str:
    known = concrete(times)
    return "" if known is None else f" at {known[i]:.9g} s"


def _require_no_gap(times: Array, max_gap: float | None) -> None:
    known = concrete(times)
    if known is None or max_gap is None or known.size < 3:
        return
    steps = np.diff(known)
    i, usual = int(np.argmax(steps)), float(np.median(steps))
    if steps[i] > max_gap * usual:
        raise ValueError(
            f"the recording has a gap of {steps[i]:.9g} s between sample {i} at {known[i]:.9g} s and sample {i + 1} at "
            f"{known[i + 1]:.9g} s, where {usual:.3g} s is usual. Propagate the parts apart, or raise `max_gap`."
        )


@eqx.filter_jit
def _integrate(
    method: AbstractIncrement, kind: str, axes: str, degree: int, times: Array, rates: Array, q0: Quat
) -> Float[Array, "n 4"]:
    h = jnp.diff(times)
    at_nodes = _through_instants if kind == "instantaneous" else _through_increments
    if kind == "mean":
        rates = rates.at[1:].multiply(h[:, None])
    q0, known = to_body(q0, at_nodes(method.nodes, degree, times, rates), axes)
    qs = accumulate(q0, *increments(method, known, h))
    return from_body(jnp.concatenate([q0[None], qs]), axes)


def _through_instants(nodes: np.ndarray, degree: int, times: Array, rates: Array) -> Float[Array, "m s 3"]:
    """Rates at the nodes of each interval, by the polynomial through the nearest instants."""
    window = _windows(times.shape[0], degree + 1)
    knots = _local(times, window)
    x = jnp.asarray(nodes, times.dtype)

    def one(knots, values):
        return jax.vmap(lambda at: lagrange(at, knots) @ values)(x)

    return jax.vmap(one)(knots, rates[window])


def _through_increments(nodes: np.ndarray, degree: int, times: Array, increments: Array) -> Float[Array, "m s 3"]:
    """Rates at the nodes of each interval: the derivative of the polynomial through the nearest sums of increments."""
    window = _windows(times.shape[0], degree + 2)
    knots = _local(times, window)
    sums = jnp.cumsum(increments[window].at[:, 0].set(0.0), axis=1)  # of the window: what was before turns nothing
    x = jnp.asarray(nodes, times.dtype)

    def slope(at, knots, values):
        return jax.jvp(lambda at: lagrange(at, knots) @ values, (at,), (jnp.ones_like(at),))[1]

    slopes = jax.vmap(lambda knots, values: jax.vmap(lambda at: slope(at, knots, values))(x))(knots, sums)
    return slopes / jnp.diff(times)[:, None, None]


def _windows(count: int, size: int) -> np.ndarray:
    """For each interval the indices of the `size` samples around it, or of all; at the ends the nearest."""
    size = min(size, count)
    first = np.clip(np.arange(count - 1) - (size - 2) // 2, 0, count - size)
    return first[:, None] + np.arange(size)


def _local(times: Float[Array, " n"], window: np.ndarray) -> Float[Array, "m w"]:
    """The times of a window on the scale where its interval is [0, 1]."""
    return (times[window] - times[:-1, None]) / jnp.diff(times)[:, None]
