"""Limits judged on the whole path: proved where they are polynomial inequalities, sampled where not."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from qtraj.algebra.positivity import NEGATIVE, POSITIVE, Answer, positive
from qtraj.design.certificate import BROKEN, PROVED, SAMPLED, UNDECIDED, UNDEFINED, Certificate
from qtraj.design.inequalities import FORMS, HIGHEST_DEGREE, Parts, divisor, parts, slack
from qtraj.design.limits import Limits, magnitude, moving_derivatives, peak
from qtraj.design.peaks import largest, summit
from qtraj.foundation.types import Flag, Scalar, ScalarLike
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.invariants import existence
from qtraj.path.spiral_helix import SpiralHelix

Finding = tuple[Array, Array, Array]
"""Code, time [s] and value."""

GAP = 1e-9
"""A relative speed or bend below this counts as zero: the quantities that divide by it do not exist there."""

DIVISORS = ("motion", "bend")
"""What magnitudes divide by: the speed squared S, and the bend N = |ṙ×r̈|²."""

SAMPLES = 1025
"""Cells in which the existence of what cannot be proved is sought."""

TOGETHER = 64
"""Paths of a batch that are judged at once, few enough to stay in the cache."""


def certify(path: AbstractHodograph, limits: Limits) -> Certificate:
    """What is known of `path` against `limits`, on the whole of it.

    Of a spiral-helix every limit is a polynomial inequality in t (paper S; see `inequalities`), whose sign is proved in
    Bernstein form with its rounding accounted for: "proved" is a proof for the path and limit as given, without any
    tolerance, and "broken" names an instant. A margin lost in rounding (about 1e-11, relative) is "undecided".
    Quantities that divide by the speed or the bend need a proof that these never vanish, or are "undefined". Slope
    about an axis that is not vertical, angular acceleration of anything but uniform cubics, and all of a `Curve` are
    judged by refined sampling, and called "sampled".

    A batch of paths (stacked, as from `jax.vmap`) gives findings with the lanes in front. Under `jit` and `vmap` the
    certificate's arrays are known, its texts are not; `values` are differentiable in the path (envelope theorem).

    **Raises:** ValueError in float32, whose rounding exceeds the margins that matter here.
    """
    require_float64(path)
    given = limits.given()
    if not given:
        nothing = jnp.zeros((*path.duration.shape, 0), path.duration.dtype)
        return Certificate((), nothing, nothing, nothing, nothing)
    gaps = {which: _over_lanes(path, which) for which in DIVISORS if any(FORMS[n].divisor == which for n in given)}
    found = [
        _judged(_over_lanes(path, name, limit), gaps.get(FORMS[name].divisor or "")) for name, limit in given.items()
    ]
    bounds = jnp.broadcast_to(jnp.stack([*given.values()]), (*path.duration.shape, len(given)))
    codes, times, values = (jnp.stack(column, axis=-1) for column in zip(*found, strict=True))
    return Certificate(tuple(given), codes, times, values, bounds)


def require_float64(path: AbstractHodograph) -> None:
    """Raise a ValueError for a path in lower precision than float64."""
    if path.duration.dtype != jnp.float64:
        raise ValueError(
            f"limits are judged in float64, but this path is in {path.duration.dtype}. Call "
            "jax.config.update('jax_enable_x64', True) before building it."
        )


@eqx.filter_jit
def _over_lanes(path: AbstractHodograph, name: str, limit: Scalar | None = None) -> Any:
    """The finding on one limit, or on one divisor, of one path or lane by lane; compiled once for each."""

    def judge(path: AbstractHodograph) -> Any:
        return _gap(path, name) if limit is None else _finding(path, name, limit.astype(path.duration.dtype))

    if path.duration.ndim == 0:
        return judge(path)
    arrays, static = eqx.partition(path, eqx.is_array)
    return jax.lax.map(lambda lane: judge(eqx.combine(lane, static)), arrays, batch_size=TOGETHER)


def _judged(found: Finding, gap: "_Gap | None") -> Finding:
    """A finding, given whether what it divides by vanishes."""
    if gap is None:
        return found
    code, time, value = found
    code = jnp.where(gap.positive | (code == BROKEN), code, UNDECIDED)
    code = jnp.where(gap.zero, UNDEFINED, code)
    return code, jnp.where(gap.zero, gap.time, time), jnp.where(gap.zero, jnp.nan, value)


def _finding(path: AbstractHodograph, name: str, limit: Scalar) -> Finding:
    """Code, time and value of one limit, as if the quantity existed everywhere."""
    if not isinstance(path, SpiralHelix) or not _low_enough(path, name):
        time, value = peak(path, name)
        return jnp.where(value <= limit, SAMPLED, BROKEN), time, value
    answer = _proof(parts(path, FORMS[name].order), name, limit)
    time, value = summit(lambda path, t: magnitude(path, t, name), path, jax.lax.stop_gradient(answer.at))
    code = jnp.where(answer.code == POSITIVE, PROVED, jnp.where(answer.code == NEGATIVE, BROKEN, UNDECIDED))
    if name == "slope":
        code = jnp.where(_upright(path), code, jnp.where(value <= limit, SAMPLED, BROKEN))
    return code, time, value


def _low_enough(path: SpiralHelix, name: str) -> bool:
    """Whether the inequality of a limit has a degree that is proved."""
    one = jnp.ones((), path.duration.dtype)
    form = jax.eval_shape(lambda: slack(parts(path, FORMS[name].order), one, FORMS[name], 0.0, 1.0))
    return form.degree <= HIGHEST_DEGREE


def _proof(known: Parts, name: str, limit: Scalar) -> Answer:
    def build(known: Parts, low: ScalarLike, high: ScalarLike):
        return slack(known, limit, FORMS[name], low, high)

    return positive(build, jax.lax.stop_gradient(known))


class _Gap(eqx.Module):
    """Whether what magnitudes divide by is proved positive, or is found zero, and when [s]."""

    positive: Flag
    zero: Flag
    time: Scalar


def _gap(path: AbstractHodograph, which: str) -> _Gap:
    def size(path: AbstractHodograph, t: Scalar) -> Scalar:
        r, _ = moving_derivatives(path, t, 3)
        return getattr(existence(r[1], r[2], r[3], path.duration), which)

    if not isinstance(path, SpiralHelix):
        time, least = largest(lambda path, t: -size(path, t), path, SAMPLES)
        return _Gap(-least >= GAP**2, -least < GAP**2, time)
    answer = positive(lambda known, low, high: divisor(known, which, low, high), jax.lax.stop_gradient(parts(path, 2)))
    time, proved = answer.at * path.duration, answer.code == POSITIVE
    return _Gap(proved, ~proved & (size(path, time) < GAP**2), time)


def _upright(path: SpiralHelix) -> Flag:
    """Whether the axis is vertical to the last bit, so that the slope is a ratio of polynomials."""
    if path.placement is None:
        return jnp.asarray(True)
    tilt = path.placement.to_local(jnp.zeros((3,), path.duration.dtype).at[2].set(1.0))
    return (tilt[0] == 0) & (tilt[1] == 0)
