"""Derivatives of the largest values of a certificate with respect to the paths (envelope theorem)."""

from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from qtraj.path.road_parameters import RoadParameters
from qtraj.path.values import value


@partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def differentiable(names: tuple[str, ...], static: Any, source: Any, times: Array, values: Array) -> Array:
    """Return `values` unchanged, but with derivatives in which each maximum stays at its fraction of the duration.

    `source` is a pair: the arrays of the paths, and an array with the vehicle parameters along its last axis.
    """
    return values


@differentiable.defjvp
def _derivative(names: tuple[str, ...], static: Any, primals: Any, tangents: Any) -> tuple[Array, Array]:
    (source, times, values), (changes, _, _) = primals, tangents
    return values, _change(names, static, source, changes, times)


@eqx.filter_jit
def _change(names: tuple[str, ...], static: Any, source: Any, changes: Any, times: Array) -> Array:
    """Return the change of the values at `times` due to the `changes` of the arrays in `source`."""

    def at_times(source: Any, times: Array) -> Array:
        path, road = eqx.combine(source[0], static), RoadParameters(*source[1]) if source[1].size else None
        moved = times * (path.duration / jax.lax.stop_gradient(path.duration))  # a maximum at the end moves with it
        return jnp.stack([value(path, moved[k], name, road) for k, name in enumerate(names)])

    def at_all_times(source: Any) -> Array:
        one = at_times
        for _ in range(times.ndim - 1):
            one = jax.vmap(one)
        return one(source, times)

    return jax.jvp(at_all_times, (source,), (changes,))[1]
