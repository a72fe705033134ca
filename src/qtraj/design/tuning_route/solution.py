"""The data of the derivatives of a tuned route: what it depends on, and the search behind it."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Array, Float

from qtraj.design.limits import Limits
from qtraj.design.solve.iterate import Iterate
from qtraj.design.tuning_route.curves import Curves
from qtraj.design.tuning_route.problem import RouteProblem
from qtraj.design.tuning_route.tuned_route import TunedRoute
from qtraj.path.route import Route


class Data(NamedTuple):
    """The data θ: the segments of the route as it stores them, its origin, the limits, and the half-widths.

    A half-width is one number, or an array with one number for each joint.
    """

    starts: Float[Array, " rows"]
    coefficients: Float[Array, "rows terms 3"]
    duration: Float[Array, ""]
    bounds: Float[Array, " limits"]
    tube: tuple[Array, Array]
    progress: Float[Array, "rows 4"] | None
    origin: Float[Array, " 3"] | None = None


class Structure:
    """What must be known about a problem inside `jit`: no values of arrays, but which of them belong together.

    `curves` are those of the route. If the number of segments is unknown (`padded`), each row of the route, padding
    included, is a curve. `parameters` is the number of parameters of the vehicle and its road on which a limit depends.
    Structures are compared by their values.
    """

    def __init__(
        self,
        names: tuple[str, ...],
        kind: str,
        curves: Curves,
        closed: bool,
        parameters: int = 0,
        padded: bool = False,
    ):
        """Store the names of the limits, the objective, the curves, and whether the route is closed."""
        self.names, self.kind, self.curves, self.closed, self.padded = names, kind, curves, closed, padded
        self.parameters = parameters
        self._key = (names, kind, closed, parameters, padded, *((x.shape, x.dtype.str, x.tobytes()) for x in curves))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Structure) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    @property
    def composed(self) -> np.ndarray | None:
        """Which curves have a progress; None if none has."""
        return self.curves.composed if self.curves.composed.any() else None

    def problem(self, fields: dict[str, Any]) -> RouteProblem:
        """Return a problem with these arrays; it has no finer nodes."""
        seam = len(self.curves.first) if self.closed else None
        own = dict.fromkeys(("fine_offset", "fine_tube")) | fields
        return RouteProblem(names=self.names, seam=seam, composed=self.composed, sense=self.curves.reversing, **own)  # type: ignore[arg-type]


class Solution(NamedTuple):
    """The result of a search, its problem, variables, and last iterate (None if the route did not change).

    `curves` relates the segments of the problem to those of the route.
    """

    result: TunedRoute
    problem: RouteProblem
    z: Any
    at: Iterate | None
    curves: Curves


Solve = Callable[[Route, Limits, tuple[np.ndarray, np.ndarray]], Solution]


CHANGED, UNCHANGED, CONTRADICTED = range(3)
"""Whether the search changed the route, did not change it, or found that the limits contradict each other."""


class Searched(NamedTuple):
    """A search as arrays: the `fields` of its problem, its variables `z` (joints, 10), and its `state`.

    `slacks`, `multipliers` and `margins` are those of its constraints at the nodes, and of the bounds on durations.
    """

    fields: dict[str, Any]
    z: Any
    slacks: tuple[Any, Any]
    multipliers: tuple[Any, Any]
    margins: tuple[Any, Any]
    state: Any
