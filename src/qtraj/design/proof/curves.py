"""Sources for paths that are not polynomial: their derivatives are computed by JAX, and no limit is proved."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from qtraj.design.proof.sources import Columns, Derivatives, Instants, Source
from qtraj.foundation.arrays import is_traced
from qtraj.path.hodograph import AbstractHodograph

SIZES = (64, 1153)
"""Numbers of instants for which the derivatives are compiled; other numbers are padded."""


class CurveSource(Source):
    """A batch of paths along the first axis of all their arrays, concrete or traced.

    With `in_numpy`, the derivatives of concrete paths are computed in NumPy, which the paths must support.
    """

    def __init__(self, paths: AbstractHodograph, in_numpy: bool = False):
        self.paths, self.traced = paths, is_traced(paths)
        self.in_numpy = in_numpy and not self.traced
        self.duration: Columns = paths.duration if self.traced else np.asarray(paths.duration)  # type: ignore[assignment]
        self.length = np.ones(len(self.duration))

    def provable(self, upright: bool) -> Bool[np.ndarray, " n"]:
        """Return no path: the limits are sampled."""
        return np.zeros(self.count, bool)

    def at(self, u: Instants, order: int) -> Derivatives:
        """Return the derivatives in world axes."""
        t = u * self.duration
        if self.traced:
            found = _derivatives(self.paths, t, order)
        elif self.in_numpy:
            each = [jax.tree.map(lambda x, k=k: x[k], self.paths) for k in range(self.count)]
            rows = [np.stack(path.sampled(t[:, k], order), axis=1) for k, path in enumerate(each)]
            found = np.stack([np.asarray(x) for x in rows], axis=1)
        else:
            size = next((n for n in SIZES if n >= len(t)), -(-len(t) // SIZES[-1]) * SIZES[-1])
            padded = np.concatenate([t, np.repeat(t[-1:], size - len(t), axis=0)])
            found = np.asarray(_compiled(self.paths, padded, order))[: len(t)]
        rows = [found[..., k, :] * (self.duration**k)[:, None] for k in range(order + 1)]
        return Derivatives([(r[..., 0], r[..., 1], r[..., 2]) for r in rows])


def _derivatives(paths: AbstractHodograph, t: Any, order: int) -> Array:
    """Return the derivatives (k, n, order + 1, 3) of n paths at the times (k, n)."""
    arrays, static = eqx.partition(paths, eqx.is_array)

    def of_path(arrays: Any, t: Array) -> Array:
        path = eqx.combine(arrays, static)
        return jax.vmap(lambda t: path.derivatives(t, order))(t)

    return jax.vmap(of_path, (0, 1), 1)(arrays, jnp.asarray(t))


_compiled = eqx.filter_jit(_derivatives)
