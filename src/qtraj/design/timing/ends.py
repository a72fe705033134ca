"""Speeds at both ends of a path, and the bounds on the squared speed u̇² that they imply."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from qtraj.design.timing.grid import path_derivatives
from qtraj.foundation.arrays import is_traced
from qtraj.foundation.types import Scalar
from qtraj.path.frenet import safe_root
from qtraj.path.hodograph import AbstractHodograph


class Begun(NamedTuple):
    """Speeds and bounds on a = u̇² at the ends of a path with the parameter u.

    `pace` are the speeds |r'(u)| at both ends, and `wanted` the prescribed speeds. `largest` contains the bounds on a
    at both ends of a part, by (is first part, is last part); `free` are the infinite bounds for all other parts.
    `slowest` is the lowest speed |r'(u)| divided by the highest one, and `highest` the highest one.
    """

    pace: Float[Any, " 2"]
    wanted: Float[Any, " 2"]
    largest: dict[tuple[bool, bool], Float[Any, " 2"]]
    free: Float[Any, " 2"]
    slowest: Scalar
    highest: Scalar


def begun(path: AbstractHodograph, wanted: tuple[Any, Any], standing: Any) -> Begun:
    """Return the speeds and bounds at the ends of a path.

    `wanted` are the prescribed speeds, infinite if free, and `standing` indicates a velocity of zero at each end.
    """
    xp: Any = jnp if is_traced(path, wanted) else np
    times = xp.asarray(path.duration) * np.linspace(0.0, 1.0, 257)
    with np.errstate(over="ignore"):  # the caller reports an infinite speed
        speeds = safe_root(xp.sum(xp.asarray(path_derivatives(path, times)[0]) ** 2, axis=0))
    pace = xp.where(standing, 0.0, speeds[np.array([0, -1])])
    goal = xp.stack([xp.asarray(v) for v in wanted])
    bounded = (pace > 0) & (goal > 0) & xp.isfinite(goal)
    ratio = xp.where(bounded, goal, 1.0) / xp.where(pace > 0, pace, 1.0)  # the divisor 1 keeps derivatives finite
    largest, free = xp.where(bounded, ratio**2, np.inf), np.full(2, np.inf)
    sides = [(True, False), (False, True), (True, True)]
    of_parts = {side: xp.where(np.array(side), largest, free) for side in sides}
    most = xp.max(speeds)
    return Begun(pace, goal, of_parts, free, xp.min(speeds) / most, most)


def known_speeds(speeds: tuple[Any, Any]) -> Any:
    """Return the prescribed speeds at both ends [m/s], NaN where free."""
    xp: Any = jnp if is_traced(speeds) else np
    return xp.stack([xp.asarray(np.nan if v is None else v) for v in speeds])
