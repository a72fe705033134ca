"""What is known of a path against its limits, and how it is known.

Statuses: "sampled" (met on a refined grid whose peaks were polished by Newton's method: strong evidence, no proof),
"broken" (exceeded at a known time) and "undefined" (the quantity does not exist at a known time).
"""

import math

import equinox as eqx
import jax.numpy as jnp

from qtraj.design.limits import CELLS, Limits, moving_derivatives, peak, quantity
from qtraj.design.peaks import largest
from qtraj.foundation.document import storable
from qtraj.foundation.types import Scalar
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

    `status[name]`: "sampled", "broken" or "undefined". `worst[name]`: (time [s], value, limit) at the largest value,
    or at the instant where the quantity does not exist.
    """

    status: dict[str, str]
    worst: dict[str, tuple[float, float, float]]

    def __init__(self, status: dict[str, str], worst: dict[str, tuple[float, float, float] | list[float]]):
        self.status = dict(status)
        self.worst = {name: (float(w[0]), float(w[1]), float(w[2])) for name, w in worst.items()}

    @property
    def met(self) -> bool:
        """Whether every limit was found met, be it by proof or by refined sampling."""
        return all(status in ("proved", "sampled") for status in self.status.values())

    @property
    def holds(self) -> bool:
        """Whether every limit is proved on the whole path; refined sampling alone proves nothing."""
        return all(status == "proved" for status in self.status.values())

    def margin(self, name: str) -> float:
        """Limit less the largest value, in the limit's unit; negative where the limit is broken."""
        _, value, limit = self.worst[name]
        return limit - value

    @property
    def binding(self) -> list[str]:
        """Names of the limits that are met with nothing to spare (a relative margin below 1e-6)."""
        return [name for name, (_, value, limit) in self.worst.items() if 0 <= limit - value <= BINDING * limit]

    def __str__(self) -> str:
        lines = []
        for name, status in self.status.items():
            time, value, limit = self.worst[name]
            lines.append(f"{name} {finding(name, value, limit, time)}: {status}")
        return "\n".join(lines)


def finding(name: str, value: float, limit: float, time: float) -> str:
    """One value against its limit, in words."""
    return f"{value:.6g} of {quantity(name, limit)} at t = {time:.4g} s"


def sampled_certificate(path: AbstractHodograph, limits: Limits) -> Certificate:
    """Findings of a refined grid: the peaks of 1025 cells of time, polished by Newton's method.

    **Raises:** ValueError in float32, whose rounding exceeds the margins that matter here.
    """
    require_float64(path)
    worst = {name: (float(t), float(value)) for name, (t, value) in _peaks(path, limits).items()}
    gaps = {name: _gap(path, name) for name in ("motion", "bend") if set(NEEDS[name]) & set(worst)}
    status, records = {}, {}
    for name, limit in limits.given().items():
        time, value = worst[name]
        status[name] = "sampled" if value <= float(limit) else "broken"
        for measure, (at, size) in gaps.items():
            if name in NEEDS[measure] and size < GAP**2:
                status[name], time, value = "undefined", at, math.nan
        records[name] = (time, value, float(limit))
    return Certificate(status, records)


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
