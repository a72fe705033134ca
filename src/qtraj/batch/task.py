"""The request of a batched evaluation, and the shapes and layout of its results."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.experimental.layout import Layout
from jax.sharding import PartitionSpec
from jaxtyping import Array

from qtraj.path.channel import CHANNELS
from qtraj.path.rate_axes import BODY


@dataclass(frozen=True)
class Task:
    """The part of a request that determines the executable."""

    names: tuple[str, ...]
    components: str
    batched: bool
    continuous: bool
    reduce: str | None
    axes: str = BODY

    def shaped(self, name: str, flat: Array) -> Array:
        """The result from an array (components, paths, …)."""
        flat = flat if self.batched else flat[:, 0]
        return self.ordered(name, flat.reshape(*CHANNELS[name].shape, *flat.shape[1:]))

    def raw_shape(self, name: str, count: int, instants: int) -> tuple[int, ...]:
        """The shape of a result with its components first."""
        return CHANNELS[name].shape + ((count, instants) if self.batched else (instants,))

    def write(self, name: str, k: int, raw: Array, values: Array, p: Array, c: Array) -> Array:
        """`raw`, components first, with `values` (paths, instants) of component k, starting at path p, instant c."""
        inner = CHANNELS[name].shape
        indices = [jnp.asarray(i, c.dtype) for i in np.unravel_index(k, inner)] if inner else []
        lead = values.shape if self.batched else values.shape[1:]
        block = values.reshape((1,) * len(inner) + lead)
        return lax.dynamic_update_slice(raw, block, (*indices, p, c) if self.batched else (*indices, c))

    def ordered(self, name: str, raw: Array) -> Array:
        """The result, with its component axes as requested, from one with components first."""
        inner = len(CHANNELS[name].axes)
        if self.components == "first" or not inner:
            return raw
        return jnp.moveaxis(raw, range(inner), range(raw.ndim - inner, raw.ndim))

    def spec(self, name: str, lead: tuple[str | None, str | None], components: str) -> PartitionSpec:
        """The partition of a result; `lead` are the mesh axes of (paths, instants), `components` "last" or "first"."""
        inner, over = (None,) * len(CHANNELS[name].axes), lead if self.batched else lead[1:]
        return PartitionSpec(*(inner + over if components == "first" else over + inner))

    def layout(self, name: str) -> Layout:
        """The memory layout: each component contiguous, independent of the order of the axes."""
        inner, lead = len(CHANNELS[name].axes), 2 if self.batched else 1
        if self.components == "first":
            return Layout(tuple(range(inner + lead)))
        return Layout((*range(lead, lead + inner), *range(lead)))
