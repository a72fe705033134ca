"""The fastest timing along a path whose shape is given."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.lax import stop_gradient
from jaxtyping import Array, Float

from qtraj.design.limits import Limits
from qtraj.design.proof.certificate import BROKEN, SAMPLED, UNDECIDED, Certificate
from qtraj.design.proof.certify import require_float64
from qtraj.design.timing.constraints import NAMES
from qtraj.design.timing.interior_point import MAX_STEPS
from qtraj.design.timing.outcome import Retimed
from qtraj.design.timing.proof import proved
from qtraj.design.timing.search import LAST, Found, Problem, fastest
from qtraj.design.timing.timing import RetimedPath, Timing
from qtraj.foundation.arrays import concrete, real_scalar
from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.types import ArrayInput, Scalar
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.quantity import QUANTITIES
from qtraj.path.values import value

KNOTS = 256

SAMPLES = 8
"""Instants in each cell at which the largest value of a quantity is sought."""

MARGIN = 1e-6
"""Part of the limits that is not used, for what may happen between the nodes at which they are imposed."""

REACHED = 1e-5
"""Relative difference from a given speed at an end that counts as reached."""


def retime(
    path: AbstractHodograph,
    limits: Limits,
    *,
    start_speed: ArrayInput | None = None,
    end_speed: ArrayInput | None = None,
    knots: int = KNOTS,
    throw: bool = False,
) -> Retimed:
    """The fastest timing along `path`, whose shape stays as it is, within `limits`.

    `limits` are those that depend on the timing: `speed`, `acceleration`, `lateral_acceleration`,
    `longitudinal_acceleration`, `jerk`, `yaw_rate`, `yaw_acceleration` and `angular_rate`. `start_speed` and
    `end_speed` [m/s]: zero for rest, None for a speed that is free. The squared path speed u̇², u the path's own parameter, is a
    cubic spline of u in `knots` cells, a power of two; more cells come closer to the least time of all. At rest the
    acceleration begins with a jump, so a limit on the jerk is one on the motion after the start and before the end.

    The time is minimised by an interior-point method whose steps cost in proportion to the number of cells; without a
    limit on the jerk the problem is convex. Limits are imposed at four places in each cell, and then proved on the
    whole of it where the path has polynomials. `duration` is differentiable in the path and the limits, in forward and
    reverse mode; batches by `jax.vmap`.

    **Raises:** ValueError for limits that do not depend on the timing or leave the speed unbounded, for a negative
    speed, for `knots` that are no power of two from 16 on, in float32, and for a path that stands still in its own
    parameter. RuntimeError with `throw` where the result is no success.
    """
    require_float64(path)
    names = _require_limits(limits)
    _require_knots(knots)
    _require_regular(path)
    speeds = tuple(_speed(v, side) for v, side in ((start_speed, "start"), (end_speed, "end")))
    rest = tuple(v is not None and concrete(v) is not None and float(v) == 0 for v in speeds)
    given = limits.given()
    bounds = {name: jnp.asarray(given.get(name, np.inf), path.duration.dtype) for name in NAMES}
    retimed = _retimed(path, bounds, [None if r else v for v, r in zip(speeds, rest, strict=True)], rest, names, knots)
    return retimed.check() if throw else retimed


@eqx.filter_jit
def _paced(path: AbstractHodograph) -> Float[Array, " 2"]:
    """|r'| at both ends."""
    return jnp.stack([jnp.linalg.norm(path.velocity(t)) for t in (jnp.zeros_like(path.duration), path.duration)])


def _retimed(
    path: AbstractHodograph,
    bounds: dict[str, Scalar],
    speeds: list[Scalar | None],
    rest: tuple[bool, ...],
    names: tuple[str, ...],
    knots: int,
) -> Retimed:
    pace = _paced(path)
    wanted = jnp.stack([jnp.asarray(np.inf if v is None else v, pace.dtype) for v in speeds])
    inner = {name: bound * (1 - MARGIN) for name, bound in bounds.items()}
    found = fastest(Problem(path, inner, (wanted / pace) ** 2), knots, (rest[0], rest[1]))
    timing = Timing(found.powers, path.duration, rest)
    result = RetimedPath(path, timing)
    ends = jnp.sqrt(jnp.maximum(jnp.stack([found.powers[0, 0], jnp.sum(found.powers[-1])]), 0.0)) * pace
    certificate = _certificate(path, result, bounds, names)
    time = stop_gradient(timing.duration) + found.sensitivity
    return Retimed(result, time, certificate, ends, _code(found, certificate, ends, wanted), found.state.steps)


def _code(found: Found, certificate: Certificate, ends: Array, wanted: Array) -> Array:
    missed = jnp.any(jnp.isfinite(wanted) & (ends < wanted * (1 - REACHED)))
    unfinished = ~(found.state.error < LAST) & (found.state.steps >= MAX_STEPS)
    code = jnp.where(missed, int(ResultCode.end_speed_not_reached), certificate.code)
    code = jnp.where(unfinished, int(ResultCode.not_converged), code)
    return jnp.where(jnp.isfinite(found.powers).all(), code, int(ResultCode.not_finite))


def _certificate(
    path: AbstractHodograph, retimed: RetimedPath, bounds: dict[str, Scalar], names: tuple[str, ...]
) -> Certificate:
    limits = jnp.stack([bounds[name] for name in names])
    times, values = _largest(stop_gradient(retimed), names)
    polynomials = path.polynomials()
    sampled = jnp.where(values <= limits, SAMPLED, BROKEN)
    if polynomials is None:
        return Certificate(names, sampled, times, values, limits)
    codes = proved(stop_gradient(polynomials), stop_gradient(path.duration), stop_gradient(retimed.timing), bounds)
    found = jnp.stack([codes[name] for name in names])
    if polynomials.placement is not None:
        x, y = polynomials.placement.orientation[1:3]
        tilted = (x != 0) | (y != 0)
        vertical = np.array([QUANTITIES[name].upright for name in names])
        found = jnp.where(vertical & tilted, sampled, found)
    return Certificate(names, jnp.where((values > limits) & (found == UNDECIDED), BROKEN, found), times, values, limits)


@eqx.filter_jit
def _largest(path: RetimedPath, names: tuple[str, ...]) -> tuple[Array, Array]:
    """The largest sampled value of each quantity and its time [s]."""
    cells = path.timing.coefficients.shape[0]
    instants = (jnp.arange(cells * SAMPLES) + 0.5) / (cells * SAMPLES) * path.path.duration
    times = jax.vmap(path.timing.time)(instants)
    found = jnp.stack([jax.vmap(lambda t, name=name: value(path, t, name))(times) for name in names])
    worst = jnp.argmax(found, axis=1)
    return times[worst], jnp.take_along_axis(found, worst[:, None], axis=1)[:, 0]


def _require_limits(limits: Limits) -> tuple[str, ...]:
    names = tuple(limits.given())
    if unknown := [name for name in names if name not in NAMES]:
        raise ValueError(
            f"a timing cannot change {unknown[0]} in the way that retime needs: it takes limits on {', '.join(NAMES)}. "
            "Whether the shape of a path satisfies the others is told by qtraj.certify."
        )
    if not any(QUANTITIES[name].bounds_speed for name in names):
        raise ValueError(
            f"without a limit on the speed or an acceleration there is no fastest timing, but {limits!r} was given"
        )
    return names


def _require_knots(knots: int) -> None:
    if not isinstance(knots, int) or knots < 16 or knots & (knots - 1):
        raise ValueError(f"knots must be a power of two from 16 on, such as 256, but {knots!r} was given")


def _require_regular(path: AbstractHodograph) -> None:
    slowest = concrete(_slowest(path))
    if slowest is not None and not (np.asarray(slowest) > 1e-9).all():
        raise ValueError(
            "this path stands still somewhere in its own parameter, where a timing along it is not defined: take the "
            "parts between its stops, or describe it by another parameter, such as its arc length"
        )


@eqx.filter_jit
def _slowest(path: AbstractHodograph) -> Scalar:
    """The least speed of the path in its own parameter, relative to the largest."""
    times = path.duration * jnp.linspace(0.0, 1.0, 257, dtype=path.duration.dtype)
    speeds = jax.vmap(lambda t: jnp.linalg.norm(path.velocity(t)))(times)
    return jnp.min(speeds) / jnp.max(speeds)


def _speed(v: ArrayInput | None, side: str) -> Scalar | None:
    if v is None:
        return None
    speed = real_scalar(v, f"the speed at the {side}")
    known = concrete(speed)
    if known is not None and not (np.isfinite(known) and known >= 0):
        raise ValueError(f"the speed at the {side} must be at least 0 and finite [m/s], but {v!r} was given")
    return speed
