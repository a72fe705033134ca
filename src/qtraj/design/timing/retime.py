"""`retime`: the fastest timing along a path of given shape."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.lax import stop_gradient
from jaxtyping import Array, Float, Int

from qtraj.design.limits import Limits
from qtraj.design.proof.certificate import BROKEN, PROVED, SAMPLED, UNDECIDED, UNDEFINED, Certificate, require_float64
from qtraj.design.timing.constraints import LARGEST, NAMES
from qtraj.design.timing.directions import directions, straight
from qtraj.design.timing.grid import Shape
from qtraj.design.timing.outcome import Retimed
from qtraj.design.timing.parts import Part, known_segments, known_zero, of_path, standing_ends
from qtraj.design.timing.proof import Source, prove
from qtraj.design.timing.search import Found, Problem, fastest, last_gap, tables
from qtraj.design.timing.timing import RetimedPath, Timing
from qtraj.foundation.arrays import concrete, real_scalar
from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.types import ArrayInput, Scalar
from qtraj.path import pieces
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.moving_basis import MovingPolynomials
from qtraj.path.quantity import QUANTITIES
from qtraj.path.route import Route

KNOTS = 256

MARGIN = 1e-5
"""Fraction by which the search reduces the limits, because it imposes them only at nodes."""

REACHED = 1e-5
"""An end speed counts as reached if it is lower than required by at most this fraction."""


def retime(
    path: AbstractHodograph,
    limits: Limits,
    *,
    start_speed: ArrayInput | None = None,
    end_speed: ArrayInput | None = None,
    knots: int = KNOTS,
    throw: bool = False,
) -> Retimed:
    """The fastest timing along `path` that satisfies `limits`; the shape of the path does not change.

    `limits` may contain only limits that depend on the timing: `speed`, `acceleration`, `lateral_acceleration`,
    `longitudinal_acceleration`, `jerk`, `yaw_rate`, `yaw_acceleration` and `angular_rate`. `start_speed` and
    `end_speed` [m/s]: zero for rest, which must be a plain number inside jit, vmap and grad too, None for a speed that
    is free. The squared path speed u̇², u the path's own parameter, is a cubic spline of u with continuous second
    derivative in `knots` cells, a power of two; more cells come closer to the least time of all. At rest the
    acceleration begins with a jump, so a limit on the jerk is one on the motion after the start and before the end.

    A route is cut at its stops. Each drive between two stops is timed with at least `knots` cells, from rest to rest,
    and the stops keep their durations.

    An interior-point method minimises the duration. The cost of a step is proportional to the number of cells, and all
    iterates satisfy the limits at the nodes. Without a limit on the jerk the problem is convex. Limits are imposed at
    the knots and at one instant inside each cell, and are tightened in cells that exceed them elsewhere. If the path
    has polynomials, they are then proved to be satisfied on every whole cell. `duration` is differentiable with respect
    to the path and the limits, in forward and reverse mode; `jax.vmap` builds batches. A route must have concrete
    values, but its limits may be traced.

    **Raises:** ValueError for limits that do not depend on the timing or do not bound the speed, a negative speed,
    `knots` that is not a power of two or less than 16, float32, a path whose velocity is zero at an instant, and a
    route whose velocity jumps or that stops within a segment. RuntimeError with `throw` if the retiming fails.
    """
    require_float64(path)
    names = _require_limits(limits)
    _require_knots(knots)
    given = limits.given()
    parts, standing = of_path(path, knots, "jerk" in given)
    if not isinstance(path, Route):
        _require_regular(path)
    speeds = tuple(_speed(v, side) for v, side in ((start_speed, "start"), (end_speed, "end")))
    bounds = {name: jnp.asarray(given.get(name, np.inf), path.duration.dtype) for name in NAMES}
    retimed = _retimed(path, parts, standing, bounds, speeds, names)
    return retimed.check() if throw else retimed


class _Timed(NamedTuple):
    """The timing of a part: coefficients of a, usage and statuses of limits on each cell; knots; search result."""

    powers: Float[Array, "cells 4"]
    usage: Float[Array, "limits cells"]
    codes: Int[Array, "limits cells"]
    knots: Float[Array, " cells+1"]
    found: Found | None


def _retimed(
    path: AbstractHodograph,
    parts: list[Part],
    standing: tuple[bool, bool],
    bounds: dict[str, Scalar],
    speeds: tuple[Scalar | None, ...],
    names: tuple[str, ...],
) -> Retimed:
    pace = jnp.where(jnp.asarray(standing), 0.0, _paced(path))
    wanted = jnp.stack([jnp.asarray(np.inf if v is None else v, pace.dtype) for v in speeds])
    bounded = (pace > 0) & (wanted > 0) & jnp.isfinite(wanted)
    ratio = jnp.where(bounded, wanted, 1.0) / jnp.where(pace > 0, pace, 1.0)  # the divisor 1 keeps derivatives finite
    largest = jnp.where(bounded, ratio**2, jnp.inf)
    rest = tuple(known_zero(v) and not s for v, s in zip(speeds, standing, strict=True))
    timed = []
    for k, part in enumerate(parts):
        first, last = k == 0, k == len(parts) - 1
        ends = jnp.stack([largest[0] if first else jnp.inf, largest[1] if last else jnp.inf])
        timed.append(_timed(path, part, bounds, ends, (rest[0] and first, rest[1] and last)))
    knots = jnp.concatenate([timed[0].knots[:1], *(x.knots[1:] for x in timed)])
    timing = Timing(jnp.concatenate([x.powers for x in timed]), knots, (rest[0], rest[1]))
    own = np.array([NAMES.index(name) for name in names])
    usage = jnp.concatenate([x.usage for x in timed], axis=1)[own] * (1 - MARGIN)
    codes = jnp.concatenate([x.codes for x in timed], axis=1)[own]
    if "angular_rate" in names:  # the natural trihedral is undefined on straight parts
        without = straight(path, knots)[None] & np.array([name == "angular_rate" for name in names])[:, None]
        codes = jnp.where(without & ((codes == UNDECIDED) | (codes == SAMPLED)), UNDEFINED, codes)
    searches = [x.found for x in timed if x.found is not None]
    cells = [part.grid.cells for part in parts if part.grid is not None]
    errors = jnp.stack([found.error for found in searches])
    limits = jnp.stack([bounds[name] for name in names])
    facts = _Facts(usage, codes, limits, pace, wanted, errors, np.array([last_gap(n) for n in cells]))
    certificate, ends, code = _judged(timing, facts, path.polynomials(), names)
    time = stop_gradient(timing.duration) + sum(found.sensitivity for found in searches)
    steps = sum((found.steps for found in searches), jnp.zeros((), jnp.int32))
    return Retimed(RetimedPath(path, timing), time, certificate, usage, ends, code, steps)


class _Facts(NamedTuple):
    """The data that decide on the result: usage and statuses of limits in all cells, end speeds, and search errors."""

    usage: Float[Array, "limits cells"]
    codes: Int[Array, "limits cells"]
    limits: Float[Array, " limits"]
    pace: Float[Array, " 2"]
    wanted: Float[Array, " 2"]
    errors: Float[Array, " searches"]
    enough: Float[np.ndarray, " searches"]


def _timed(
    path: AbstractHodograph, part: Part, bounds: dict[str, Scalar], ends: Array, rest: tuple[bool, bool]
) -> _Timed:
    dtype = path.duration.dtype
    start, end = (jnp.asarray(x, dtype) for x in part[:2])
    grid = part.grid
    if grid is None:
        nothing = jnp.zeros((len(NAMES), 1), dtype)
        unit = jnp.zeros((1, 4), dtype).at[0, 0].set(1.0)
        return _Timed(unit, nothing, nothing.astype(jnp.int32) + PROVED, jnp.stack([start, end]), None)
    per_cell = (end - start) / grid.cells
    inner = {name: bound * (1 - MARGIN) for name, bound in bounds.items()}
    found = fastest(Problem(Shape(path, start, per_cell), inner, ends), tables(grid, rest))
    knots = stop_gradient(start + jnp.asarray(grid.knots, dtype) * per_cell)
    codes = jnp.full((len(NAMES), grid.cells), SAMPLED, jnp.int32)
    polynomials = source(path)
    if polynomials is not None:
        timing = found.powers, jnp.asarray(rest)
        codes = prove(stop_gradient(polynomials), grid, timing, stop_gradient(bounds)).codes
    return _Timed(found.powers, found.usage, codes, knots, found)


def source(path: AbstractHodograph) -> Source | None:
    """The polynomials of the segments of a path, with the directions at stops; None for a path without polynomials."""
    if isinstance(path, Route):
        segments = known_segments(path)
        more = pieces.padded_size(segments.durations.size) - segments.durations.size
        durations = jnp.asarray(np.append(segments.durations, np.ones(more)))
        found = directions(segments, standing_ends(segments))
        if found is None:
            return Source(_in_world(segments.coefficients), durations, None)
        ahead = (
            _in_world(found.coefficients),
            np.pad(found.powers, [(0, more), (0, 0)]),
            np.pad(found.roundings, (0, more)),
        )
        return Source(_in_world(segments.coefficients), durations, ahead)
    own = path.polynomials()
    if own is None:
        return None
    x, y, z, angle = jax.tree.map(lambda x: x[..., None], (own.x, own.y, own.z, own.angle))
    return Source(MovingPolynomials(x, y, z, angle), path.duration[None], None)


def _in_world(c: Float[np.ndarray, "segments terms 3"]) -> MovingPolynomials:
    _, padded = pieces.padded(np.zeros(len(c)), c)  # routes of similar length share an executable
    x, y, z = (np.array(padded[..., k].T) for k in range(3))
    x[0], y[0] = (
        0.0,
        0.0,
    )  # only derivatives are needed; a distant start would enlarge the unit of length and so the rounding errors
    return MovingPolynomials(jnp.asarray(x), jnp.asarray(y), jnp.asarray(z), jnp.zeros((1, x.shape[1])))


@eqx.filter_jit
def _paced(path: AbstractHodograph) -> Float[Array, " 2"]:
    """|r'| at both ends."""
    return jnp.stack([jnp.linalg.norm(path.velocity(t)) for t in (jnp.zeros_like(path.duration), path.duration)])


@eqx.filter_jit
def _judged(
    timing: Timing, facts: _Facts, polynomials: MovingPolynomials | None, names: tuple[str, ...]
) -> tuple[Certificate, Array, Array]:
    """The certificate, the speeds at the ends and the result code."""
    certificate = _certificate(timing, facts, polynomials, names)
    powers, wanted = timing.coefficients, facts.wanted
    ends = jnp.sqrt(jnp.maximum(jnp.stack([powers[0, 0], jnp.sum(powers[-1])]), 0.0)) * facts.pace
    missed = jnp.any(jnp.isfinite(wanted) & (ends < wanted * (1 - REACHED)))
    ignored = jnp.any((wanted <= 0) & (ends > 0))  # a traced zero: rest has other cells, which must be chosen before
    unbounded = jnp.max(powers[:, 0]) > 0.5 * LARGEST
    code = jnp.where(missed, int(ResultCode.end_speed_not_reached), certificate.code)
    code = jnp.where(jnp.all(facts.errors < facts.enough), code, int(ResultCode.not_converged))
    code = jnp.where(unbounded, int(ResultCode.speed_unbounded), code)
    code = jnp.where(ignored, int(ResultCode.rest_unknown), code)
    finite = jnp.isfinite(powers).all() & ~jnp.isnan(wanted).any()
    return certificate, ends, jnp.where(finite, code, int(ResultCode.not_finite))


def _certificate(
    timing: Timing, facts: _Facts, polynomials: MovingPolynomials | None, names: tuple[str, ...]
) -> Certificate:
    nowhere = (facts.codes == UNDEFINED) & ~jnp.any(facts.codes == BROKEN, axis=1, keepdims=True)
    cell = jnp.argmax(jnp.where(nowhere, jnp.inf, facts.usage), axis=1)
    values = jnp.take_along_axis(facts.usage, cell[:, None], axis=1)[:, 0] * facts.limits
    times = 0.5 * (timing.times[cell] + timing.times[cell + 1])
    rank = jnp.asarray([0, 1, 4, 2, 3])[facts.codes]  # proved, sampled, undecided, undefined, broken
    whole = jnp.asarray([PROVED, SAMPLED, UNDECIDED, UNDEFINED, BROKEN])[jnp.max(rank, axis=1)]
    if polynomials is not None and polynomials.placement is not None:
        x, y = polynomials.placement.orientation[1:3]
        vertical = np.array([QUANTITIES[name].upright for name in names])
        whole = jnp.where(vertical & ((x != 0) | (y != 0)), SAMPLED, whole)
    over = values > facts.limits
    whole = jnp.where(over & ((whole == SAMPLED) | (whole == UNDECIDED)), BROKEN, whole)
    values = jnp.where(jnp.any(nowhere, axis=1), jnp.nan, values)
    return Certificate(names, whole, times, values, facts.limits)


def _require_limits(limits: Limits) -> tuple[str, ...]:
    names = tuple(limits.given())
    if unknown := [name for name in names if name not in NAMES]:
        raise ValueError(
            f"retime does not support a limit on {', '.join(unknown)}; it takes limits on {', '.join(NAMES)}. Remove "
            "the others, and check them on the path of the result by qtraj.certify: those that depend on the shape "
            "alone, such as the curvature, are the same for every timing."
        )
    bounding = [name for name in NAMES if QUANTITIES[name].bounds_speed]
    if not set(bounding) & set(names):
        raise ValueError(
            f"retime needs a limit that bounds the speed, but {limits!r} was given. Add one of {', '.join(bounding)}; "
            "on straight parts of a path only a limit on speed does so."
        )
    return names


def _require_knots(knots: int) -> None:
    if not isinstance(knots, int) or knots < 16 or knots & (knots - 1):
        raise ValueError(f"knots must be a power of two and at least 16, such as 256, but {knots!r} was given")


def _require_regular(path: AbstractHodograph) -> None:
    slowest = concrete(_slowest(path))
    if slowest is not None and not (np.asarray(slowest) > 1e-9).all():
        raise ValueError(
            "the velocity of the path is zero at some instant, so it cannot be retimed there: retime the parts between "
            "the stops, or parametrise the path differently, for example by arc length"
        )


@eqx.filter_jit
def _slowest(path: AbstractHodograph) -> Scalar:
    """The lowest speed |r'(u)| of the path relative to the highest."""
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
