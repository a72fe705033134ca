"""Peaks and integrals over the instants of each path, from blocks: the samples are never all there at once."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, in_lanes
from qtraj.path.quantities import AXES, DESCRIPTIONS, INTEGRATED, LABELS, framed

REDUCTIONS = ("max", "min", "integral", "mean")

ROUNDING = 8
"""In machine epsilons: samples so near to a peak are equal to it."""


QUATERNIONS = "scalar first, Hamilton product, body to world; each component reduced by itself, so of any norm"


class Reduced(AbstractResult):
    """One number for each component of each output: `reduced["speed"]`.

    Arrays are the components alone, (…) for one path and (b, …) for many, or with `components="first"` (…, b). For
    "max" and "min", `times` holds where on the samples each is attained [s]: the first instant, to rounding. The
    derivatives of a peak are those at that instant, also where others share the peak.
    """

    values: dict[str, Array]
    times: dict[str, Array] | None
    reduction: str = eqx.field(static=True)
    batched: bool = eqx.field(static=True)
    components: str = eqx.field(static=True)
    frame: str = eqx.field(static=True)

    def __getitem__(self, name: str) -> Array:
        return self.values[name]

    def record(self) -> Record:
        """The numbers over `path`, where there are many, and over components; `…_time` is where a peak is attained."""
        variables = {}
        for name, values in self.values.items():
            (unit, meaning), axes = DESCRIPTIONS[name], AXES[name]
            lanes = ("path",) if self.batched else ()
            dims = (*lanes, *axes) if self.components == "last" else (*axes, *lanes)
            whole = INTEGRATED[unit] if self.reduction == "integral" else unit
            what = f"{self.reduction} of {'each component of ' if axes else ''}the {meaning}"
            variables[name] = Quantity(values, whole, what, dims)
            if self.times is not None:
                variables[f"{name}_time"] = Quantity(self.times[name], "s", f"time of the {self.reduction}", dims)
        first = next(iter(variables.values()))
        paths = (np.shape(first.values)[first.axes.index("path")],) if self.batched else ()
        return Record(
            f"{in_lanes(paths, 'paths')}{self.reduction} over time, {self.frame} frame: {', '.join(self.values)}",
            variables,
            attributes=framed(self.frame) | {"reduction": self.reduction, "quaternion_convention": QUATERNIONS},
            labels=LABELS,
        )


def weights(times: Float[Array, "rows n"], reduction: str) -> Float[Array, "rows n"]:
    """What each sample counts: the trapezoidal rule [s], over the whole time for a mean; of one sample, its value."""
    if times.shape[1] == 1:
        return jnp.zeros_like(times) if reduction == "integral" else jnp.ones_like(times)
    half = 0.5 * jnp.diff(times, axis=1)
    edge = jnp.zeros_like(times[:, :1])
    rule = jnp.concatenate([half, edge], axis=1) + jnp.concatenate([edge, half], axis=1)
    return rule if reduction == "integral" else rule / (times[:, -1:] - times[:, :1])


def block_reducer(reduction: str) -> Callable[[Any, Array, Array], Any]:
    """(a component (paths, instants), times, weights) → for each path its part, as `joiner` takes it."""
    if reduction in ("integral", "mean"):
        return lambda x, t, w: (jnp.sum(x * w, axis=1),)
    sign = 1 if reduction == "max" else -1

    def peak(x: Array, t: Array, w: Array) -> tuple[Array, Array]:
        value = sign * jnp.max(sign * x, axis=1)
        return value, jnp.min(jnp.where(attained(x, value[:, None]), t, jnp.inf), axis=1)

    return peak


def joiner(reduction: str) -> Callable[[Any], Any]:
    """Parts with a leading axis of blocks → the whole."""
    if reduction in ("integral", "mean"):
        return lambda part: (jnp.sum(part[0], axis=0),)
    sign = 1 if reduction == "max" else -1

    def peak(part: tuple[Array, Array]) -> tuple[Array, Array]:
        value = sign * jnp.max(sign * part[0], axis=0)
        return value, jnp.min(jnp.where(attained(part[0], value[None]), part[1], jnp.inf), axis=0)

    return peak


def attained(x: Array, peak: Array) -> Array:
    """Whether `x` is the peak to rounding: a compiler that works `x` out twice may round it twice."""
    return (x == peak) | (jnp.abs(x - peak) <= ROUNDING * jnp.finfo(x.dtype).eps * jnp.abs(peak))
