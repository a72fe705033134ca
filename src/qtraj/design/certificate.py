"""What is known of a path against its limits, and how it is known.

Statuses: "sampled" (met on a refined grid whose peaks were polished by Newton's method: strong evidence, no proof),
"broken" (exceeded at a known time) and "undefined" (the quantity does not exist at a known time).
"""

import math
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.design.limits import CELLS, Limits, moving_derivatives, peak, quantity
from qtraj.design.peaks import largest
from qtraj.foundation.arrays import as_float
from qtraj.foundation.document import storable
from qtraj.foundation.types import ArrayInput, Scalar
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.invariants import existence

GAP = 1e-9
"""A relative speed or bend below this counts as zero: the quantities that divide by it do not exist there."""

BINDING = 1e-6
"""A limit whose relative margin is smaller than this binds."""

NEEDS = {
    "motion": ("curvature", "lateral_acceleration", "longitudinal_acceleration", "slope"),
    "bend": ("torsion", "angular_rate", "angular_acceleration"),
}
"""What each quantity divides by; a path that stops has no bend either."""


@storable
class Certificate(eqx.Module):
    """The findings on each given limit.

    `names` and `statuses` ("sampled", "broken" or "undefined"), and arrays over them: `times` [s] of the largest
    values, or of the instant where the quantity does not exist; `values`, NaN there; `limits`.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    statuses: tuple[str, ...] = eqx.field(static=True)
    times: Float[Array, " n"]
    values: Float[Array, " n"]
    limits: Float[Array, " n"]

    def __init__(
        self,
        names: Sequence[str],
        statuses: Sequence[str],
        times: ArrayInput,
        values: ArrayInput,
        limits: ArrayInput,
    ):
        self.names, self.statuses = tuple(names), tuple(statuses)
        self.times, self.values, self.limits = as_float(times), as_float(values), as_float(limits)

    @property
    def status(self) -> dict[str, str]:
        """The finding on each limit, by its name."""
        return dict(zip(self.names, self.statuses, strict=True))

    @property
    def worst(self) -> dict[str, tuple[float, float, float]]:
        """(time [s], value, limit) at the largest value of each, by its name; not inside a trace."""
        rows = zip(self.times, self.values, self.limits, strict=True)
        return {name: (float(t), float(v), float(m)) for name, (t, v, m) in zip(self.names, rows, strict=True)}

    @property
    def met(self) -> bool:
        """Whether every limit was found met, be it by proof or by refined sampling."""
        return all(status in ("proved", "sampled") for status in self.statuses)

    @property
    def holds(self) -> bool:
        """Whether every limit is proved on the whole path; refined sampling alone proves nothing."""
        return all(status == "proved" for status in self.statuses)

    def margin(self, name: str) -> float:
        """Limit less the largest value, in the limit's unit; negative where the limit is broken."""
        _, value, limit = self.worst[name]
        return limit - value

    @property
    def binding(self) -> list[str]:
        """Names of the limits that are met with nothing to spare (a relative margin below 1e-6)."""
        return [name for name, (_, value, limit) in self.worst.items() if 0 <= limit - value <= BINDING * limit]

    def describe(self, name: str) -> str:
        """The largest value of one quantity against its limit, in words."""
        time, value, limit = self.worst[name]
        if math.isnan(value):
            return f"it does not exist at t = {time:.4g} s, where the path stops or straightens"
        return f"{value:.6g} of {quantity(name, limit)} at t = {time:.4g} s"

    def __str__(self) -> str:
        return "\n".join(f"{name} {self.describe(name)}: {status}" for name, status in self.status.items())


def sampled_certificate(path: AbstractHodograph, limits: Limits) -> Certificate:
    """Findings of a refined grid: the peaks of 1025 cells of time, polished by Newton's method.

    **Raises:** ValueError in float32, whose rounding exceeds the margins that matter here.
    """
    require_float64(path)
    worst = {name: (float(t), float(value)) for name, (t, value) in _peaks(path, limits).items()}
    gaps = {name: _gap(path, name) for name in ("motion", "bend") if set(NEEDS[name]) & set(worst)}
    rows = []
    for name, limit in limits.given().items():
        time, value = worst[name]
        status = "sampled" if value <= float(limit) else "broken"
        for measure, (at, size) in gaps.items():
            if name in NEEDS[measure] and size < GAP**2:
                status, time, value = "undefined", at, math.nan
        rows.append((name, status, time, value, float(limit)))
    return Certificate(*zip(*rows, strict=True)) if rows else Certificate((), (), (), (), ())


def require_float64(path: AbstractHodograph) -> None:
    """Raise a ValueError for a path in lower precision than float64."""
    if path.duration.dtype != jnp.float64:
        raise ValueError(
            f"limits are judged in float64, but this path is in {path.duration.dtype}. Call "
            "jax.config.update('jax_enable_x64', True) before building it."
        )


@eqx.filter_jit
def _peaks(path: AbstractHodograph, limits: Limits) -> dict[str, tuple[Scalar, Scalar]]:
    return {name: peak(path, name) for name in limits.given()}


def _gap(path: AbstractHodograph, measure: str) -> tuple[float, float]:
    """Time and size where one measure of `existence` is least: where the path is nearest to a stop, or to straight."""
    time, least = _least(path, measure)
    return float(time), float(least)


@eqx.filter_jit
def _least(path: AbstractHodograph, measure: str) -> tuple[Scalar, Scalar]:
    def negative(path: AbstractHodograph, t: Scalar) -> Scalar:
        r, _ = moving_derivatives(path, t, 3)
        return -getattr(existence(r[1], r[2], r[3], path.duration), measure)

    time, value = largest(negative, path, CELLS)
    return time, -value
