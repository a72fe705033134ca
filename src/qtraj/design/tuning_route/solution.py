"""The data of the derivatives of a tuned route: what it depends on, and the search behind it."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float

from qtraj.design.ellipse import OfSpeed
from qtraj.design.limits import Limits
from qtraj.design.obstacles.clear import Clear, clears
from qtraj.design.solve.iterate import Iterate
from qtraj.design.timing.speed_ratio import all_with_speed
from qtraj.design.tuning.clearances import Clearances
from qtraj.design.tuning_route import along
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
    `obstacles` and the limits `by_speed` have concrete values. Structures are compared by their values.
    """

    def __init__(
        self,
        names: tuple[str, ...],
        kind: str,
        curves: Curves,
        closed: bool,
        parameters: int = 0,
        padded: bool = False,
        obstacles: Clearances | None = None,
        by_speed: Mapping[str, OfSpeed] | None = None,
    ):
        """Store the names of the limits, the objective, the curves, and whether the route is closed."""
        self.names, self.kind, self.curves, self.closed, self.padded = names, kind, curves, closed, padded
        self.parameters, self.obstacles, self.by_speed = parameters, obstacles, dict(by_speed or {})
        self._key = (
            names,
            kind,
            closed,
            parameters,
            padded,
            obstacles,
            _numbers(self.by_speed),
            *((x.shape, x.dtype.str, x.tobytes()) for x in curves),
        )

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Structure) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    @property
    def clear(self) -> tuple[Clear, ...]:
        """The constraints of balls of the body and obstacles."""
        return () if self.obstacles is None else clears(self.obstacles.keep_out, self.obstacles.body)

    @property
    def constraints(self) -> tuple[str, ...]:
        """The names of the constraints, except for those of the tube."""
        return (*self.names, *(x.name for x in self.clear))

    @property
    def certified(self) -> tuple[str, ...]:
        """The names in certificates."""
        return tuple(dict.fromkeys(self.constraints))

    @property
    def composed(self) -> np.ndarray | None:
        """Which curves have a progress; None if none has."""
        return self.curves.composed if self.curves.composed.any() else None

    def problem(self, fields: dict[str, Any]) -> RouteProblem:
        """Return a problem with these arrays; it has no finer nodes."""
        seam = len(self.curves.first) if self.closed else None
        own: dict[str, Any] = dict.fromkeys(("fine_offset", "fine_tube")) | fields
        own |= {"names": self.constraints, "clear": self.clear, "seam": seam}
        limits = [self.by_speed.get(name) for name in self.names]
        sizes = [1.0 if x is None else along.typical_of(name, x) for name, x in zip(self.names, limits, strict=True)]
        own["by_speed"] = all_with_speed(dict(zip(self.names, limits, strict=True)), sizes)
        return RouteProblem(composed=self.composed, sense=self.curves.reversing, **own)  # type: ignore[arg-type]


def _numbers(limits: Mapping[str, OfSpeed]) -> str:
    """Return the names and all numbers of limits by speed, as a text."""
    numbers = jax.tree.map(lambda x: np.asarray(x, float).tolist(), [*limits.values()])
    return repr([*limits, str(jax.tree.structure(numbers)), jax.tree.leaves(numbers)])


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
