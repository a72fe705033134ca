"""Describe the request for a batched evaluation, and the shapes and memory layout of the results."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.experimental.layout import Layout
from jax.sharding import PartitionSpec
from jaxtyping import Array

from qtraj.foundation.namespace import xp
from qtraj.path.channel import CHANNELS
from qtraj.path.rate_axes import BODY


@dataclass(frozen=True)
class Task:
    """The properties of a request that determine the executable; `kernel` is the choice of `kernel_choice`."""

    names: tuple[str, ...]
    components: str
    batched: bool
    continuous: bool
    reduce: str | None
    axes: str = BODY
    kernel: str = "off"

    def shaped(self, name: str, flat: Array) -> Array:
        """Return a result with its axes as requested, from an array (components, paths, …)."""
        flat = flat if self.batched else flat[:, 0]
        return self.ordered(name, flat.reshape(*CHANNELS[name].shape, *flat.shape[1:]))

    def raw_shape(self, name: str, count: int, instants: int) -> tuple[int, ...]:
        """Return the shape of a result if its component axes come first."""
        return CHANNELS[name].shape + ((count, instants) if self.batched else (instants,))

    def write(self, name: str, k: int, raw: Array, values: Array, p: Array, c: Array) -> Array:
        """Return `raw` after writing `values` (paths, instants) of component `k` at path `p` and instant `c`.

        The component axes of `raw` are its first axes. `p` and `c` are the position of the first element of `values`.
        """
        inner = CHANNELS[name].shape
        indices = [jnp.asarray(i, c.dtype) for i in np.unravel_index(k, inner)] if inner else []
        lead = values.shape if self.batched else values.shape[1:]
        block = values.reshape((1,) * len(inner) + lead)
        return lax.dynamic_update_slice(raw, block, (*indices, p, c) if self.batched else (*indices, c))

    def ordered(self, name: str, raw: Array) -> Array:
        """Return a result with its component axes first or last, as requested, from an array with components first."""
        inner = len(CHANNELS[name].axes)
        if self.components == "first" or not inner:
            return raw
        return xp.moveaxis(raw, range(inner), range(raw.ndim - inner, raw.ndim))

    def spec(self, name: str, lead: tuple[str | None, str | None], components: str) -> PartitionSpec:
        """Return the partition of a result over devices; `components`, "last" or "first", is the order of its axes.

        `lead` contains the mesh axis that divides the paths, and the mesh axis that divides the instants, or None.
        """
        inner, over = (None,) * len(CHANNELS[name].axes), lead if self.batched else lead[1:]
        return PartitionSpec(*(inner + over if components == "first" else over + inner))

    def layout(self, name: str) -> Layout:
        """Return the memory layout, in which each component is contiguous, whatever the order of the axes."""
        inner, lead = len(CHANNELS[name].axes), 2 if self.batched else 1
        if self.components == "first":
            return Layout(tuple(range(inner + lead)))
        return Layout((*range(lead, lead + inner), *range(lead)))
