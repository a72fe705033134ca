"""Create the segments of a route from joint states, splines and other paths."""

import math
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numpy.polynomial import polynomial as power

from qtraj.foundation.arrays import (
    as_float,
    as_seconds,
    concrete,
    is_traced,
    real_scalar,
    require_finite,
    require_positive,
)
from qtraj.foundation.namespace import in_numpy, in_numpy_or_jit, xp
from qtraj.foundation.types import ArrayInput
from qtraj.path import pieces
from qtraj.path.hodograph import require_path
from qtraj.path.moving_basis import MovingPolynomials

NAMES = ("position", "velocity", "acceleration", "jerk")

MAX_SEGMENTS = 65536
"""Maximum number of segments of a converted path."""

ROUNDING_FACTOR = 1 + 1e-9
"""Factor by which bounds are multiplied to cover their own rounding errors."""

Pieces = tuple[Any, Any, Any, Any]
"""Starts, coefficients, duration and origin of a route."""


def from_states(times: ArrayInput, orders: Sequence[ArrayInput]) -> Pieces:
    """Return the padded segments that connect the states at `times` (n,).

    `orders` contains positions, velocities, accelerations and, optionally, jerks, each (n, 3).
    """
    joints: Any = _times(times)
    states = [_states(x, name, joints) for x, name in zip(orders, NAMES, strict=False)]
    starts, c, duration, origin = _joined(joints, states)
    if is_traced(states) and not is_traced(joints):
        starts, duration = _known(np.asarray(joints), starts)
    return starts, c, duration, origin


def _known(joints: np.ndarray, starts: Any) -> tuple[Any, Any]:
    """Return the starts and the duration as concrete arrays: inside jit, the number of segments remains known."""
    elapsed = joints - joints[0]
    padding = np.full(starts.shape[0] - elapsed.size + 1, np.inf)
    with jax.ensure_compile_time_eval():
        return tuple(jnp.asarray(x, starts.dtype) for x in (np.append(elapsed[:-1], padding), elapsed[-1]))  # type: ignore[return-value]


@in_numpy_or_jit
def _joined(joints: Any, states: list[Any]) -> Pieces:
    elapsed, origin = joints - joints[0], states[0][0]
    local = xp.stack([states[0] - origin[None], *states[1:]], axis=1)
    c = pieces.hermite(elapsed[1:] - elapsed[:-1], local)
    starts, c = pieces.padded(elapsed[:-1], c)
    return starts, c, xp.asarray(elapsed[-1]), origin


def from_piecewise(spline: Any) -> Pieces:
    """Return the unpadded segments of a SciPy spline with values (3,)."""
    x, c = _ppoly(spline)
    if c.ndim != 3 or c.shape[2] != 3:
        raise ValueError(
            "a spline of a route must have values of shape (3,), x, y and z in metres, but their shape is "
            f"{c.shape[2:]}"
        )
    if np.iscomplexobj(c):
        raise ValueError("a spline of a route must have real coefficients, but complex ones were given")
    while len(c) > 1 and not c[0].any():
        c = c[1:]
    if len(c) > pieces.TERMS[-1]:
        raise ValueError(
            f"a spline of a route may have at most degree {pieces.TERMS[-1] - 1}, but it has degree {len(c) - 1}. "
            "Interpolate it with a spline of lower degree."
        )
    if not (np.all(np.isfinite(x)) and np.all(np.isfinite(c))):
        raise ValueError("a spline of a route must have finite breakpoints and coefficients")
    kept = np.diff(x) > 0
    if np.any(np.diff(x) < 0) or not kept.any():
        raise ValueError("the breakpoints of a spline of a route must increase")
    x, c = np.append(x[:-1][kept], x[-1]), np.moveaxis(c[::-1][:, kept], 1, 0).astype(float)
    origin = c[0, 0].copy()
    c[:, 0] -= origin
    return x[:-1] - x[0], c, np.asarray(x[-1] - x[0], float), origin


def _ppoly(spline: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the breakpoints of a spline and its coefficients, with the highest power first.

    The axes of the coefficients are the power, the interval, and the axes of the values.
    """
    from scipy.interpolate import BPoly, BSpline, PPoly

    if isinstance(spline, BPoly):
        spline = PPoly.from_bernstein_basis(spline)
    if isinstance(spline, BSpline):
        t, k, rest = np.asarray(spline.t, float), spline.k, spline.c.shape[1:]
        columns = np.asarray(spline.c, float).reshape(len(spline.c), -1).T
        c = np.stack([PPoly.from_spline((t, column, k)).c for column in columns], axis=-1)
        return t[k : len(t) - k], c[:, k : len(t) - k - 1].reshape(k + 1, -1, *rest)
    if not isinstance(spline, PPoly):
        raise ValueError(
            "a PPoly, CubicSpline, BSpline or BPoly of scipy.interpolate was expected, "
            f"but a {type(spline).__name__} was given"
        )
    return np.asarray(spline.x, float), np.asarray(spline.c)


def from_path(path: Any, tolerance: ArrayInput) -> Pieces:
    """Return the unpadded segments of a route within `tolerance` [m] of a polynomial path."""
    require_path(path)
    tolerance = real_scalar(tolerance, "the tolerance of a route")
    require_positive(tolerance, "the tolerance of a route", "m")
    polynomials = path.polynomials()
    if polynomials is None:
        raise ValueError(
            f"a polynomial path, such as a SpiralHelix, was expected, but a {type(path).__name__} was given"
        )
    duration = np.asarray(concrete(path.duration), float)
    if duration.ndim:
        raise ValueError("one path was expected, but a batch was given: convert its paths one by one")
    moving = [np.atleast_1d(np.asarray(x, float)) for x in _moving(polynomials)]
    max_distance, count = float(np.asarray(tolerance)), 1
    while True:
        edges = duration * np.linspace(0.0, 1.0, count + 1)
        states = _states_at(path, edges)
        rounding = 2.0**-44 * float(np.max(np.abs(states[:, 0])) + np.max(np.abs(states[:, 1])) * duration / count)
        bound = float(np.max(_deviations(moving, edges))) + rounding
        if bound <= max_distance:
            break
        if rounding > max_distance or count == MAX_SEGMENTS:
            raise ValueError(
                f"a route of {count} segments approximates this path only to within {bound:.3g} m, more than the "
                f"tolerance of {max_distance:.3g} m: pass a larger tolerance"
            )
        count = min(2 * count, MAX_SEGMENTS)
    origin = states[0, 0].copy()
    states[:, 0] -= origin
    return edges[:-1], pieces.hermite(np.diff(edges), states), duration, origin


def _states_at(path: Any, times: np.ndarray) -> np.ndarray:
    """Return position, velocity, acceleration and jerk at `times` (n,), as (n, 4, 3)."""
    compute = in_numpy(_sampled) if path.supports_numpy else eqx.filter_jit(_sampled)
    return np.array(compute(path, times), float)


def _sampled(path: Any, times: Any) -> Any:
    return xp.stack(path.sampled(times, 3), axis=1)


def _moving(polynomials: MovingPolynomials) -> tuple[Any, Any, Any, Any]:
    """Return the coefficients of x, y and z in the moving basis, and of the angle of the basis."""
    y = np.zeros(1) if polynomials.y is None else polynomials.y
    return polynomials.x, y, polynomials.z, polynomials.angle


def _deviations(moving: list[np.ndarray], edges: np.ndarray) -> np.ndarray:
    """Return a bound on the deviation [m] of septic interpolants between `edges`, for each segment.

    `moving` contains the coefficients of x, y, z and the angle, as returned by `_moving`. A septic has the derivatives
    of r of orders 0 to 3 at both ends of a segment. On a segment of duration h, its error is at most h⁸/(2⁸·8!)·max
    |r⁽⁸⁾|. The components of r⁽⁸⁾ in the moving basis are polynomials. On a segment, each component is bounded by its
    Taylor expansion about the midpoint.
    """
    x, y, z, angle = moving
    rate = power.polyder(angle)
    for _ in range(8):
        x, y = (
            power.polysub(power.polyder(x), power.polymul(rate, y)),
            power.polyadd(power.polyder(y), power.polymul(rate, x)),
        )
        z = power.polyder(z)
    middle, half = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
    bounds = [_bound(c, middle, half) for c in (x, y, z)]
    eighth = np.sqrt(sum(bound**2 for bound in bounds))
    return ROUNDING_FACTOR * (2 * half) ** 8 / (2.0**8 * math.factorial(8)) * eighth


def _bound(c: np.ndarray, middle: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Return a bound on the magnitude of the polynomial with ascending coefficients `c` on each of the intervals.

    The intervals are `middle` ± `half`.
    """
    bound, derivative = np.zeros_like(middle), c
    for k in range(len(c)):
        bound = bound + np.abs(power.polyval(middle, derivative)) * half**k / math.factorial(k)
        derivative = power.polyder(derivative)
    rounding = 64 * np.finfo(float).eps * power.polyval(np.abs(middle) + half, np.abs(c))
    return bound + rounding


def _times(values: ArrayInput) -> Any:
    times = as_seconds(values, from_first=True)
    if times.ndim != 1 or times.shape[0] < 2:
        raise ValueError(
            f"the times of a route must be a vector of two or more times, but an array of shape {times.shape} was given"
        )
    require_finite(times, "the times of a route")
    numbers = concrete(times)
    if numbers is not None and not np.all(np.diff(numbers) > 0):
        k = int(np.argmin(np.diff(numbers) > 0)) + 1
        raise ValueError(
            f"the times of a route must increase strictly, but times[{k}] = {numbers[k]:.17g} s follows "
            f"times[{k - 1}] = {numbers[k - 1]:.17g} s"
        )
    return times


def _states(values: ArrayInput, name: str, times: Any) -> Any:
    states = as_float(values)
    if states.shape != (times.shape[0], 3):
        raise ValueError(
            f"the {name} of a route must have shape ({times.shape[0]}, 3), one row for each time, "
            f"but an array of shape {states.shape} was given"
        )
    require_finite(states, f"the {name} of a route")
    return states.astype(times.dtype)
