"""Limits judged on the whole path: proved where they are polynomial inequalities, sampled where not."""

import math
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array

from qtraj.algebra.positivity import NEGATIVE, POSITIVE, positive
from qtraj.design.limits import Limits
from qtraj.design.magnitudes import magnitude, moving_derivatives, peak
from qtraj.design.peaks import largest, summit
from qtraj.design.proof.certificate import BROKEN, PROVED, SAMPLED, UNDECIDED, UNDEFINED, Certificate
from qtraj.design.proof.inequalities import FORMS, HIGHEST_DEGREE, divisor, parts, slack
from qtraj.foundation import cores
from qtraj.foundation.exported.kept import kept
from qtraj.foundation.types import Flag, Scalar
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.invariants import existence
from qtraj.path.placement import Placement
from qtraj.path.spiral_helix import SpiralHelix

GAP = 1e-9
"""A relative speed or bend that is not proved positive, and below this at its least, cannot be told from zero."""

DIVISORS = ("motion", "bend")
"""What magnitudes divide by: the speed squared S, and the bend N = |ṙ×r̈|²."""

SAMPLES = 1025
"""Cells in which the existence of what cannot be proved is sought."""

TOGETHER = 64
"""Paths of a batch that are judged at once, few enough to stay in the cache."""

Findings = tuple[Array, Array, Array, Array]
"""Codes, times [s], values and what they are held against, with the limits behind the lanes."""


def certify(path: AbstractHodograph, limits: Limits) -> Certificate:
    """What is known of `path` against `limits`, on the whole of it.

    Of a spiral-helix every limit is a polynomial inequality in t (paper S; see `inequalities`), whose sign is proved in
    Bernstein form with its rounding accounted for: "proved" is a proof for the path and limit as given, without any
    tolerance, and "broken" names an instant. "undecided" is what no proof reached, mostly for a margin lost in rounding
    (relative, about 1e-11). Quantities that divide by the speed or the bend need a proof that these never vanish; where
    they cannot be told from zero they are "undefined". Inequalities beyond degree 72 (see docs/tuning.md), the slope
    about an axis that is not vertical and all of a `Curve` are judged by refined sampling, and called "sampled".

    A batch of paths (stacked, as from `jax.vmap`) gives findings with the lanes in front; limits are shared, or have
    the same lanes. Under `jit` and `vmap` the certificate's arrays are known, its texts are not; `values` are
    differentiable in the path (envelope theorem). They are the largest values found: of a limit with room to spare a
    needle between the samples may be missed, its proof is not.

    **Raises:** ValueError in float32, whose rounding exceeds the margins that matter here, and for a batch in which not
    every array has the lanes in front.
    """
    require_float64(path)
    given = limits.given()
    if not given:
        nothing = jnp.zeros((*path.duration.shape, 0), path.duration.dtype)
        return Certificate((), nothing, nothing, nothing, nothing)
    limits = jax.tree.map(lambda limit: jnp.broadcast_to(limit, path.duration.shape), limits)
    return Certificate(tuple(given), *_over_lanes(path, limits))


def require_float64(path: AbstractHodograph) -> None:
    """Raise a ValueError for a path in lower precision than float64."""
    if path.duration.dtype != jnp.float64:
        raise ValueError(
            f"limits are judged in float64, but this path is in {path.duration.dtype}. Call "
            "jax.config.update('jax_enable_x64', True) before building it."
        )


def _over_lanes(path: AbstractHodograph, limits: Limits) -> Findings:
    """`_judged`, lane by lane where the path has lanes."""
    lanes = path.duration.shape
    if not lanes:
        return _judged(path, limits)
    arrays, static = eqx.partition((path, limits), eqx.is_array)
    leaves = jax.tree.leaves(arrays)
    if any(x.shape[: len(lanes)] != lanes for x in leaves):
        raise ValueError(f"a batch of paths has {lanes} in front of every array of it: stack the paths by jax.vmap")
    flat = jax.tree.map(lambda x: x.reshape(-1, *x.shape[len(lanes) :]), arrays)
    if math.prod(lanes) == 0 or any(isinstance(x, Tracer) for x in leaves) or not _on_one_cpu(leaves):
        found = _judged_lanes(flat, static)
    else:
        found = _by_all_cores(flat, static, math.prod(lanes))
    return jax.tree.map(lambda x: x.reshape(*lanes, *x.shape[1:]), found)


def _on_one_cpu(leaves: list[Array]) -> bool:
    devices = set().union(*(x.devices() for x in leaves))
    return len(devices) == 1 and devices.pop().platform == "cpu"


def _by_all_cores(flat: Any, static: Any, lanes: int) -> Findings:
    leaves = jax.tree.leaves(flat)
    device = next(iter(leaves[0].devices()))
    given, size = jax.tree.map(np.asarray, flat), cores.size_for(lanes)
    pieces = cores.split(np.arange(lanes), size)
    calls = [(cores.take(given, piece, size), static) for piece in pieces]
    found: Any = None
    for piece, answers in zip(pieces, cores.each(_judged_lanes, calls, device), strict=True):
        found = cores.room(lanes, answers) if found is None else found
        cores.put(found, piece, answers)
    return jax.device_put(found, device if any(x.committed for x in leaves) else None)


@eqx.filter_jit
def _judged_lanes(flat: Any, static: Any) -> Findings:
    return jax.lax.map(lambda lane: _judged(*eqx.combine(lane, static)), flat, batch_size=TOGETHER)


def _judged(path: AbstractHodograph, limits: Limits) -> Findings:
    """The findings on all limits of one path, each compiled once for whatever limits come together."""
    given = limits.given()
    needed = {FORMS[name].divisor for name in given}
    gaps = {which: _gap(path, which) for which in DIVISORS if which in needed}
    found = [_finding(path, gaps.get(FORMS[name].divisor or "none"), limit, name) for name, limit in given.items()]
    return _in_columns([(*finding, limit) for finding, limit in zip(found, given.values(), strict=True)])


@kept()
def _in_columns(findings: list[Findings]) -> Findings:
    codes, times, values, limits = (jnp.stack(column) for column in zip(*findings, strict=True))
    return codes.astype(jnp.int32), times, values, limits


class _Gap(NamedTuple):
    """Whether what magnitudes divide by is proved positive, or cannot be told from zero, and when it is least [s]."""

    positive: Flag
    zero: Flag
    time: Scalar


@kept(_Gap)
def _gap(path: AbstractHodograph, which: str) -> _Gap:
    def size(path: AbstractHodograph, t: Scalar) -> Scalar:
        r = moving_derivatives(path, t, 3)
        return getattr(existence(r[1], r[2], r[3], path.duration), which)

    if not isinstance(path, SpiralHelix):
        time, least = largest(lambda path, t: -size(path, t), path, SAMPLES)
        return _Gap(-least >= GAP**2, -least < GAP**2, time)
    answer = positive(lambda known, low, high: divisor(known, which, low, high), jax.lax.stop_gradient(parts(path, 2)))
    time, proved = answer.at * path.duration, answer.code == POSITIVE
    return _Gap(proved, ~proved & (size(path, time) < GAP**2), time)


@kept()
def _finding(path: AbstractHodograph, gap: _Gap | None, limit: Scalar, name: str) -> tuple[Array, Scalar, Scalar]:
    """Code, time [s] and value of one limit, given whether what it divides by vanishes."""
    code, time, value = _as_if_defined(path, gap, name, limit.astype(path.duration.dtype))
    if gap is None:
        return code, time, value
    code = jnp.where(gap.positive | (code == BROKEN), code, UNDECIDED)
    code = jnp.where(gap.zero, UNDEFINED, code)
    return code, jnp.where(gap.zero, gap.time, time), jnp.where(gap.zero, jnp.nan, value)


def _as_if_defined(path: AbstractHodograph, gap: _Gap | None, name: str, limit: Scalar) -> tuple[Array, Scalar, Scalar]:
    if not isinstance(path, SpiralHelix) or not _low_enough(path, name):
        return _sampled(path, name, limit)
    known = jax.lax.stop_gradient(parts(path, FORMS[name].order))
    answer = positive(lambda known, low, high: slack(known, limit, FORMS[name], low, high), known)
    code = jnp.where(answer.code == POSITIVE, PROVED, jnp.where(answer.code == NEGATIVE, BROKEN, UNDECIDED))
    hints = [answer.at] if gap is None else [answer.at, gap.time / path.duration]
    summits = summit(lambda path, t: magnitude(path, t, name), path, jax.lax.stop_gradient(jnp.stack(hints)))
    if name != "slope" or path.placement is None:
        return code, *summits
    upright, samples = _upright(path.placement), _sampled(path, name, limit)
    code, time, value = (jnp.where(upright, a, b) for a, b in zip((code, *summits), samples, strict=True))
    return code, time, value


def _sampled(path: AbstractHodograph, name: str, limit: Scalar) -> tuple[Array, Scalar, Scalar]:
    time, value = peak(path, name)
    return jnp.where(value <= limit, SAMPLED, jnp.where(value > limit, BROKEN, UNDECIDED)), time, value


def _low_enough(path: SpiralHelix, name: str) -> bool:
    """Whether the inequality of a limit has a degree that is proved."""
    one = jnp.ones((), path.duration.dtype)
    form = jax.eval_shape(lambda: slack(parts(path, FORMS[name].order), one, FORMS[name], 0.0, 1.0))
    return form.degree <= HIGHEST_DEGREE


def _upright(placement: Placement) -> Flag:
    """Whether the axis is vertical to the last bit, so that the slope is a ratio of polynomials."""
    w, x, y, z = placement.orientation
    return ((x == 0) & (y == 0)) | ((w == 0) & (z == 0))
