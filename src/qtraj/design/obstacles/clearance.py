"""The public function for the clearance of a body along a path."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.design.limits import Limits, require_limits
from qtraj.design.obstacles.keep_out import checked, clearances_at
from qtraj.foundation.arrays import as_seconds, is_traced, require_inside
from qtraj.foundation.namespace import in_numpy
from qtraj.foundation.types import ArrayInput
from qtraj.path.hodograph import AbstractHodograph, require_path


def clearance(path: AbstractHodograph, times: ArrayInput, limits: Limits) -> dict[str, Float[Array, " n"]]:
    """Return how far the body of `limits` is from each of its obstacles along a path.

    Args:
        path: one path.
        times: (n,) or one instant [s].
        limits: with obstacles in `keep_out`, and perhaps a `body`.

    Returns:
        The distances (n,) [m] by the names "keep_out[0]", "keep_out[1]" and so on; negative if the body enters an
        obstacle. They are differentiable with respect to path, times and obstacles.

    Raises:
        ValueError: For limits without obstacles, a batch of paths, and times outside the path.

    Example:
        >>> path = SpiralHelix([20.0], [0.0, 0.3], [0.0, 0.5], 10.0)
        >>> limits = Limits(keep_out=[Ball([0.0, 0.0, 0.0], 5.0)], body=[(0.0, 1.0)])
        >>> clearance(path, [0.0], limits)["keep_out[0]"]
        array([14.])
    """
    require_path(path)
    require_limits(limits)
    if limits.keep_out is None:
        raise ValueError("these limits have no obstacles: pass Limits(keep_out=[...])")
    if path.duration.ndim:
        raise ValueError("clearance accepts one path: use jax.vmap for a batch")
    t = as_seconds(times)
    if t.ndim > 1:
        raise ValueError(f"times must be one instant, or have shape (n,), but their shape is {t.shape}")
    require_inside(t, path.duration, "path")
    checked(limits)
    obstacles: Any = limits.keep_out
    if is_traced(path, t, limits) or not path.supports_numpy:
        given = is_traced(path, t) or not path.supports_numpy
        return clearances_at(obstacles, limits.body, path, jnp.asarray(t) if given else np.asarray(t, float))
    return in_numpy(clearances_at)(obstacles, limits.body, path, t)
