"""Peaks and integrals over the instants of each path, from blocks: the samples are never all there at once."""

import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, in_lanes
from qtraj.path.quantities import AXES, DESCRIPTIONS, LABELS, framed

REDUCTIONS = ("max", "min", "integral", "mean")

ROUNDING = 8
"""In machine epsilons: samples so near to a peak are equal to it."""


class Reduced(AbstractResult):
    """One number for each component of each output: `reduced["speed"]`.

    Arrays are the components alone, (…) for one path and (b, …) for many, or with `components="first"` (…, b). For
    "max" and "min", `times` holds where on the samples each is attained [s]: the first instant, to rounding.
    """

    values: dict[str, Array]
    times: dict[str, Array] | None
    reduction: str = eqx.field(static=True)
    batched: bool = eqx.field(static=True, default=False)
    components: str = eqx.field(static=True, default="last")
    frame: str = eqx.field(static=True, default="natural")

    def __getitem__(self, name: str) -> Array:
        return self.values[name]

    def record(self) -> Record:
        """The numbers over `path`, where there are many, and over components; `…_time` is where a peak is attained."""
        variables = {}
        for name, values in self.values.items():
            (unit, meaning), axes = DESCRIPTIONS[name], AXES[name]
            lanes = ("path",) if self.batched else ()
            dims = (*lanes, *axes) if self.components == "last" else (*axes, *lanes)
            whole = f"{unit} s" if self.reduction == "integral" else unit
            variables[name] = Quantity(values, whole.removeprefix("1 "), f"{self.reduction} of the {meaning}", dims)
            if self.times is not None:
                variables[f"{name}_time"] = Quantity(self.times[name], "s", f"time of the {self.reduction}", dims)
        first = next(iter(variables.values()))
        paths = (np.shape(first.values)[first.axes.index("path")],) if self.batched else ()
        return Record(
            f"{in_lanes(paths, 'paths')}{self.reduction} over time, {self.frame} frame: {', '.join(self.values)}",
            variables,
            attributes=framed(self.frame) | {"reduction": self.reduction},
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
        value = sign * _largest(sign * x, 1)
        return value, jnp.min(jnp.where(attained(x, value[:, None]), t, jnp.inf), axis=1)

    return peak


def joiner(reduction: str) -> Callable[[Any], Any]:
    """Parts with a leading axis of blocks → the whole."""
    if reduction in ("integral", "mean"):
        return lambda part: (jnp.sum(part[0], axis=0),)
    sign = 1 if reduction == "max" else -1

    def peak(part: tuple[Array, Array]) -> tuple[Array, Array]:
        value = sign * _largest(sign * part[0], 0)
        return value, jnp.min(jnp.where(attained(part[0], value[None]), part[1], jnp.inf), axis=0)

    return peak


@functools.partial(jax.custom_jvp, nondiff_argnums=(1,))
def _largest(x: Array, axis: int) -> Array:
    """The maximum; its derivative is the mean of those where it is attained to rounding."""
    return jnp.max(x, axis=axis)


@_largest.defjvp
def _largest_derivative(axis: int, primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    value = _largest(primals[0], axis)
    here = attained(primals[0], jnp.expand_dims(value, axis)).astype(value.dtype)
    count = jnp.maximum(jnp.sum(here, axis=axis), 1)
    return value, jnp.sum(here * tangents[0], axis=axis) / count


def attained(x: Array, peak: Array) -> Array:
    """Whether `x` is the peak to rounding: a compiler that works `x` out twice may round it twice."""
    return jnp.abs(x - peak) <= ROUNDING * jnp.finfo(x.dtype).eps * jnp.abs(peak)
