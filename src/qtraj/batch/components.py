"""Derivatives of paths without polynomials, and of constant components, as triples of arrays (paths, instants)."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.path.components import Triple
from qtraj.path.hodograph import AbstractHodograph

Times = Float[Array, "rows instants"]


def world_derivatives(paths: AbstractHodograph, t: Times, order: int) -> list[Triple]:
    """The derivatives, world axes, of paths without polynomials."""
    along = lambda path, t: jax.vmap(lambda t: path.derivatives(t, order))(t)  # noqa: E731
    each = jnp.broadcast_to(t, (paths.duration.shape[0], t.shape[1]))
    r = eqx.filter_vmap(along, in_axes=(eqx.if_array(0), 0))(paths, each)
    return [triple(r[..., k, :]) for k in range(order + 1)]


def triple(v: Array) -> Triple:
    """The components of vectors on the last axis."""
    return v[..., 0], v[..., 1], v[..., 2]


def filled(row: Triple, zero: Array) -> Triple:
    """The row with `zero` in place of the integer 0."""
    return tuple(zero if isinstance(x, int) else x for x in row)  # type: ignore[return-value]
