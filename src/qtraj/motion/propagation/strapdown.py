"""Compute λ(t) from recorded rates, by integrating local polynomials that interpolate the samples.

Every interval has its own polynomial through the surrounding samples, which may be unevenly spaced. Classical coning
algorithms correct the sum of the increments for the rotation of the axis; the polynomials account for this rotation
to high order.
"""

from __future__ import annotations  # so that `help` shows short names

import warnings

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation.argument import require_whole
from qtraj.foundation.arrays import as_float, concrete
from qtraj.foundation.namespace import matmul, needs_jax, on_host, xp
from qtraj.foundation.types import ArrayInput, Quat
from qtraj.motion.checks import at_once, common_dtype, initial_quaternion, output_times, require_axes
from qtraj.motion.propagation.gauss_legendre import GaussLegendre
from qtraj.motion.propagation.increment import (
    AbstractIncrement,
    as_inputs,
    constant,
    propagated,
    require_method,
)
from qtraj.motion.propagation.lagrange import lagrange, lagrange_slopes

GAP = 5.0
"""An interval is a gap if it is longer than this multiple of the median interval."""

KINDS = ("instantaneous", "mean", "increment")

DEGREE = 5
DEGREE_OF_MEANS = 6
"""Default degree of the local polynomial of the rate for means and increments; `DEGREE` is the default for instants.

The window of samples is symmetric for an odd degree with instants, and for an even degree with means. Higher degrees
are more accurate for smooth motion, but less accurate if noisy samples are very close in time.
"""


def propagate_samples(
    times: ArrayInput,
    rates: ArrayInput,
    q0: ArrayInput,
    kind: str = "instantaneous",
    axes: str = "body",
    *,
    degree: int | None = None,
    method: AbstractIncrement | None = None,
    max_gap: float | None = GAP,
) -> Float[Array, "n 4"]:
    """Return the quaternions (n, 4) at `times` (n,) [s] from recorded rates; `q0` (4,) is the quaternion at times[0].

    `rates` (n, 3), in body or inertial `axes`, depend on `kind`:

    - "instantaneous": ω(t_k) [rad/s];
    - "mean": the mean of ω over the preceding interval, t_{k−1} to t_k [rad/s];
    - "increment": the integral of ω over the preceding interval, θ_k [rad], as measured by integrating gyros.

    For "mean" and "increment" the first row refers to the interval before times[0] and is not used. `degree`: the
    degree of the local polynomial of the rate, by default 5, or 6 for means and increments; for short recordings the
    degree is limited by the number of samples. `method`: the integration method for the polynomials,
    `GaussLegendre(stages=6)` for None. Times may be unevenly spaced, and absolute (`datetime64`). An interval longer
    than `max_gap` times the median interval raises an error; with None, no interval does. The motion in a gap is only a
    guess of the polynomial, so each interval longer than 5 times the median that is bridged causes a warning.

    **Raises:** ValueError for arrays of another shape, an unknown `kind` or `axes`, a `degree` that is not a whole
    number or negative, a `max_gap` that is not a number of at least 1, rates that are not finite, times that do not
    increase strictly, a gap, or a `method` of another type. If a sample is invalid, the message gives the index and the
    time of the sample.

    **Warns:** UserWarning for a bridged gap; DeprecationWarning for arguments in the former order rates, q0, times.
    """
    if np.ndim(times) == 2 and np.shape(rates) == (4,):
        times, rates, q0 = _former_order(times, rates, q0)
    require_axes(axes)
    require_method(method)
    if degree is not None:
        require_whole(degree, "the degree of the local polynomial")
    _require_max_gap(max_gap)
    if kind not in KINDS:
        raise ValueError(f"kind must be one of {', '.join(map(repr, KINDS))}, but {kind!r} was given")
    if np.ndim(rates) != 2:
        raise ValueError(
            f"rates must have shape (n, 3), but shape {np.shape(rates)} was given; the arguments are times, rates and "
            "q0, in this order"
        )
    with at_once():
        times, q0 = output_times(times, from_first=True), initial_quaternion(q0)
        rates = _checked_rates(rates, times, kind)
        _check_gaps(times, max_gap)
    if times.shape[0] == 1:
        return q0[None]
    if degree is None:
        degree = DEGREE if kind == "instantaneous" else DEGREE_OF_MEANS
    dtype = common_dtype(times, rates, q0)
    method = GaussLegendre(stages=6) if method is None else method
    arrays = times.astype(dtype), rates.astype(dtype), q0.astype(dtype)
    if needs_jax(arrays):
        return _compiled(method, kind, axes, degree, *arrays)
    return as_inputs(_integrate(method, kind, axes, degree, *map(on_host, arrays)), arrays)


def _former_order(rates: ArrayInput, q0: ArrayInput, times: ArrayInput) -> tuple[ArrayInput, ArrayInput, ArrayInput]:
    """Return the arguments of a call in the former order, in the present order, with a warning."""
    warnings.warn(
        "the arguments of propagate_samples are now times, rates, q0, in this order, but the first one is of two "
        "dimensions, as the rates that were the first argument before",
        DeprecationWarning,
        stacklevel=3,
    )
    return times, rates, q0


def _checked_rates(rates: ArrayInput, times: Array, kind: str) -> Float[Array, "n 3"]:
    rates = as_float(rates)
    if rates.shape != (times.shape[0], 3):
        raise ValueError(
            f"rates must have shape ({times.shape[0]}, 3), one row for each time, but shape {rates.shape} was given"
        )
    values = concrete(rates)
    used = 0 if kind == "instantaneous" else 1
    if values is not None and not np.all(np.isfinite(values[used:])):
        i = used + int(np.argmin(np.all(np.isfinite(values[used:]), axis=1)))
        raise ValueError(f"the rates must be finite, but sample {i}{_at(times, i)} is {values[i].tolist()}")
    return rates


def _at(times: Array, i: int) -> str:
    values = concrete(times)
    return "" if values is None else f" at {values[i]:.9g} s"


def _require_max_gap(max_gap: float | None) -> None:
    number = isinstance(max_gap, int | float | np.number) and not isinstance(max_gap, bool)
    if max_gap is not None and not (number and max_gap >= 1):
        raise ValueError(
            f"max_gap must be None or a number of at least 1, a multiple of the median interval, but {max_gap!r} was "
            "given"
        )


def _check_gaps(times: Array, max_gap: float | None) -> None:
    """Raise a ValueError for an interval longer than `max_gap` median intervals; warn of other gaps."""
    values = concrete(times)
    if values is None or values.size < 3:
        return
    steps = np.diff(values)
    i, median = int(np.argmax(steps)), float(np.median(steps))
    where = (
        f"{steps[i]:.9g} s between sample {i} at {values[i]:.9g} s and sample {i + 1} at {values[i + 1]:.9g} s; the "
        f"median interval is {median:.3g} s"
    )
    if max_gap is not None and steps[i] > max_gap * median:
        raise ValueError(
            f"the recording has a gap of {where}. Propagate the samples before and after the gap separately, or "
            "increase max_gap (a multiple of the median interval)."
        )
    if count := int(np.sum(steps > GAP * median)):
        gaps = "a gap" if count == 1 else f"{count} gaps, the longest one"
        warnings.warn(
            f"the recording has {gaps} of {where}. The attitude after a gap can have any error, because the motion in "
            "it was not recorded.",
            stacklevel=3,
        )


def _integrate(
    method: AbstractIncrement, kind: str, axes: str, degree: int, times: Array, rates: Array, q0: Quat
) -> Float[Array, "n 4"]:
    h = xp.diff(times)
    if kind == "instantaneous":
        node_rates = _through_instants(method.nodes, degree, times, rates)
    else:
        increments = rates[1:] * (h[:, None] if kind == "mean" else 1.0)
        node_rates = _through_increments(method.nodes, degree, times, increments)
    return xp.concatenate([q0[None], propagated(method, axes, q0, node_rates, h)])


_compiled = eqx.filter_jit(_integrate)


def _through_instants(nodes: np.ndarray, degree: int, times: Array, rates: Array) -> Float[Array, "m s 3"]:
    """Return the rates at the nodes of each interval, from the polynomial through the rates at the nearest instants."""
    window = _windows(times.shape[0], degree + 1)
    values = lagrange(constant(nodes, times)[None], _local(times, window)[:, None])
    return matmul(values, rates[window])


def _through_increments(nodes: np.ndarray, degree: int, times: Array, increments: Array) -> Float[Array, "m s 3"]:
    """Return the rates at the nodes of each interval.

    The rates are the derivative of the polynomial through the cumulative sums of the `increments` (m, 3) of the
    intervals.
    """
    window = _windows(times.shape[0], degree + 2)
    slopes = lagrange_slopes(constant(nodes, times)[None], _local(times, window)[:, None])
    sums = xp.cumsum(increments[window[:, 1:] - 1], axis=1)  # of each window, without the zero at its start
    return matmul(slopes[..., 1:], sums) / xp.diff(times)[:, None, None]


def _windows(count: int, size: int) -> np.ndarray:
    """Return the indices (m, size) of the `size` samples nearest to each interval, or of all samples if fewer exist."""
    size = min(size, count)
    first = np.clip(np.arange(count - 1) - (size - 2) // 2, 0, count - size)
    return first[:, None] + np.arange(size)


def _local(times: Float[Array, " n"], window: np.ndarray) -> Float[Array, "m w"]:
    """Return the times of each window, shifted and scaled so that the interval of the window is [0, 1]."""
    return (times[window] - times[:-1, None]) / xp.diff(times)[:, None]
