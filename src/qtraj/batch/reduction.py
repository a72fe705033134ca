"""Peaks, integrals and means over the instants of each path: the result class, and how blocks are combined."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, batch_prefix
from qtraj.foundation.units import integrated
from qtraj.path.channel import CHANNELS
from qtraj.path.frame_axes import framed, labels_of
from qtraj.path.rate_axes import BODY, in_axes

REDUCTIONS = ("max", "min", "integral", "mean")

LINEAR = ("integral", "mean")
"""Reductions that sum samples; the others select one sample."""

ROUNDING = 8
"""In machine epsilons: samples within this relative distance of a peak count as equal to it."""

QUATERNIONS = (
    "scalar first, Hamilton product, body to world; each component is reduced separately, so the norm is not 1"
)


class Reduced(AbstractResult):
    """One number for each component of each output: `reduced["speed"]`.

    Arrays have the component axes, (…) for one path and (b, …) for many, or with `components="first"` (…, b). For
    "max" and "min", `times` are the first instants [s] at which each is attained to rounding. The derivatives of a peak
    are those at that instant, even if other instants have the same value.
    """

    values: dict[str, Array]
    times: dict[str, Array] | None
    reduction: str = eqx.field(static=True)
    batched: bool = eqx.field(static=True)
    components: str = eqx.field(static=True)
    frame: str = eqx.field(static=True)
    axes: str = eqx.field(static=True, default=BODY)

    def __getitem__(self, name: str) -> Array:
        return self.values[name]

    def record(self) -> Record:
        """The numbers over `path`, if there are many, and over components; `…_time` is the time of a peak."""
        variables = {}
        for name, values in self.values.items():
            entry, paths = in_axes(CHANNELS[name], self.axes), ("path",) if self.batched else ()
            dims = (*paths, *entry.axes) if self.components == "last" else (*entry.axes, *paths)
            unit = integrated(entry.unit) if self.reduction == "integral" else entry.unit
            meaning = f"{self.reduction} of {'each component of ' if entry.axes else ''}the {entry.meaning}"
            variables[name] = Quantity(values, unit, meaning, dims)
            if self.times is not None:
                variables[f"{name}_time"] = Quantity(self.times[name], "s", f"time of the {self.reduction}", dims)
        first = next(iter(variables.values()))
        count = (np.shape(first.values)[first.axes.index("path")],) if self.batched else ()
        return Record(
            f"{batch_prefix(count, 'paths')}{self.reduction} over time, {self.frame} frame: {', '.join(self.values)}",
            variables,
            attributes=framed(self.frame) | {"reduction": self.reduction, "quaternion_convention": QUATERNIONS},
            labels=labels_of(self.frame),
        )


def block_peak(reduction: str) -> Callable[[Array, Array], tuple[Array, Array]]:
    """A function (component (paths, instants), times) → peak and its time for each path, as input of `joiner`."""
    sign = 1 if reduction == "max" else -1

    def peak(x: Array, t: Array) -> tuple[Array, Array]:
        value = sign * jnp.max(sign * x, axis=1)
        return value, jnp.min(jnp.where(attained(x, value[:, None]), t, jnp.inf), axis=1)

    return peak


def joiner(reduction: str) -> Callable[[Any], Any]:
    """A function that combines the reductions of blocks, which are on the leading axis."""
    if reduction in LINEAR:
        return lambda part: (jnp.sum(part[0], axis=0),)
    sign = 1 if reduction == "max" else -1

    def peak(part: tuple[Array, Array]) -> tuple[Array, Array]:
        value = sign * jnp.max(sign * part[0], axis=0)
        return value, jnp.min(jnp.where(attained(part[0], value[None]), part[1], jnp.inf), axis=0)

    return peak


def attained(x: Array, peak: Array) -> Array:
    """Whether `x` equals the peak to rounding, since a compiler that computes `x` twice may round it differently."""
    return (x == peak) | (jnp.abs(x - peak) <= ROUNDING * jnp.finfo(x.dtype).eps * jnp.abs(peak))
