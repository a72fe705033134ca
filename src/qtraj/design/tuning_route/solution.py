"""The data of the derivatives of a tuned route: what it depends on, and the search behind it."""

from typing import Any, NamedTuple

import jax
from jaxtyping import Array, Float

from qtraj.design.tuning_route.curves import Curves
from qtraj.design.tuning_route.iterate import Iterate
from qtraj.design.tuning_route.problem import RouteProblem
from qtraj.design.tuning_route.tuned_route import TunedRoute


class Data(NamedTuple):
    """The data θ: the segments of the route as it stores them, its origin, the limits, and the half-widths."""

    starts: Float[Array, " rows"]
    coefficients: Float[Array, "rows terms 3"]
    duration: Float[Array, ""]
    bounds: Float[Array, " limits"]
    tube: tuple[Array, Array]
    progress: Float[Array, "rows 4"] | None
    origin: Float[Array, " 3"] | None = None


class Known:
    """NumPy arrays that stay concrete inside `jit`: they are compared by their values."""

    def __init__(self, arrays: Any):
        """Store arrays, or tuples of arrays."""
        self.arrays = arrays
        self._key = tuple((x.shape, x.dtype.str, x.tobytes()) for x in jax.tree.leaves(arrays))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Known) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


class Solution(NamedTuple):
    """The result of a search, its problem, variables, and last iterate (None if the route did not change).

    `curves` relates the segments of the problem to those of the route.
    """

    result: TunedRoute
    problem: RouteProblem
    z: Any
    at: Iterate | None
    curves: Curves
