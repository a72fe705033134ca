"""Define reductions over the instants of each path (peaks, integrals and means), and their results."""

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
"""Reductions that sum samples; the other reductions select one sample."""

ROUNDING = 8
"""Relative distance, in units of machine epsilon, within which a sample counts as equal to the peak."""

QUATERNIONS = (
    "scalar first, Hamilton product, body to world; each component is reduced separately, so the norm is not 1"
)


class Reduced(AbstractResult):
    """One reduced value for each component of each output, accessed as `reduced["speed"]`.

    The arrays have only component axes, (…), for one path; for b paths they are (b, …), or (…, b) with
    `components="first"`. For "max" and "min", `times` are the first instants [s] at which the values are attained,
    to within rounding error. The derivatives of a peak are evaluated at its first instant, even if other instants have
    the same value.
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
        """Return the values over `path` (for a batch) and over components.

        The times of the peaks of an output such as `speed` have the name `speed_time`.
        """
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
    """Return a function that computes the peak and its time for each path from the samples of a component.

    The arguments of the function are the samples (paths, instants) and their times. `joiner` combines the results.
    """
    sign = 1 if reduction == "max" else -1

    def peak(x: Array, t: Array) -> tuple[Array, Array]:
        value = sign * jnp.max(sign * x, axis=1)
        return value, jnp.min(jnp.where(attained(x, value[:, None]), t, jnp.inf), axis=1)

    return peak


def joiner(reduction: str) -> Callable[[Any], Any]:
    """Return a function that combines the reductions of several blocks, stacked along the leading axis."""
    if reduction in LINEAR:
        return lambda part: (jnp.sum(part[0], axis=0),)
    sign = 1 if reduction == "max" else -1

    def peak(part: tuple[Array, Array]) -> tuple[Array, Array]:
        value = sign * jnp.max(sign * part[0], axis=0)
        return value, jnp.min(jnp.where(attained(part[0], value[None]), part[1], jnp.inf), axis=0)

    return peak


def attained(x: Array, peak: Array) -> Array:
    """Return whether each element of `x` equals `peak` to within rounding.

    Exact equality can fail, because compilers may compute `x` twice and round differently.
    """
    return (x == peak) | (jnp.abs(x - peak) <= ROUNDING * jnp.finfo(x.dtype).eps * jnp.abs(peak))
