"""What the problems of one call of `tune_route` have in common, and the problems themselves."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from qtraj.design.limits import Limits
from qtraj.design.obstacles.clear import Clear, clears
from qtraj.design.timing.speed_ratio import all_with_speed
from qtraj.design.tuning_route import along, around, circuit, roads, rounds
from qtraj.design.tuning_route.arguments import fixed_states, half_widths
from qtraj.design.tuning_route.problem import RouteProblem
from qtraj.design.tuning_route.remedy import Change
from qtraj.design.tuning_route.scales import scales
from qtraj.design.tuning_route.setup import Parts, parts, problem_of
from qtraj.path.route import Route


class Posed(NamedTuple):
    """A route to tune, its parts and its limits.

    `names` are those of the limits and of the constraints `clear` on obstacles, `bounds` the typical values of the
    limits, `widths` (joints, 2) the half-widths of the tube [m], and `held` (joints, rows) the states that are fixed.
    `road` are the parameters of the road at the fine nodes.
    """

    route: Route
    given: Parts
    limits: Limits
    names: tuple[str, ...]
    bounds: Float[np.ndarray, " limits"]
    widths: Float[np.ndarray, "joints 2"]
    held: Bool[np.ndarray, "joints rows"]
    closed: bool
    clear: tuple[Clear, ...]
    road: Any

    @classmethod
    def of(cls, route: Route, limits: Limits, names: tuple[str, ...], tube: Any, fixed: Any, closed: bool) -> Posed:
        """Return what belongs to the arguments of `tune_route`.

        **Raises:** ValueError for a `closed` route that does not end as it starts, a wrong tube or wrong fixed states,
        and if the body starts or ends in an obstacle.
        """
        if closed:
            circuit.require_closed(route)
        given = parts(route, closed)
        joints, rows = len(given.segments.starts) + 1, given.curves.joint_rows()
        widths = half_widths(tube, joints, closed)[[own.start for own in rows]]
        every = fixed_states(fixed, joints, closed)
        held = np.stack([every[own].any(axis=0) for own in rows])
        clear = clears(limits.keep_out, limits.body)
        around.require_possible(route, limits, held)
        names = (*names, *(x.name for x in clear))
        road = roads.at_fine_nodes(route, limits, given)
        return cls(route, given, limits, names, along.typical(limits), widths, held, closed, clear, road)

    @property
    def numbers(self) -> dict[str, float]:
        """The typical values of the limits, by name."""
        return dict(zip(self.names[: len(self.bounds)], self.bounds.tolist(), strict=True))

    @property
    def times(self) -> Float[np.ndarray, " joints"]:
        """The times of the joints [s], from the first one."""
        return np.append(0.0, np.cumsum(self.given.stretch * self.given.h))

    def problem(self, objective: str) -> RouteProblem:
        """Return the problem of the given limits."""
        problem = self._problem(objective, self.bounds, self.held)
        if not along.changes(self.limits):
            return problem
        every = np.append(self.bounds, np.ones(len(self.clear)))
        return self.with_local_limits(problem._replace(**scales(self.names, every)))

    def changed(self, change: Change) -> RouteProblem:
        """Return the problem after a change, in which no limit changes along the way."""
        held = self.held.copy()
        held[[0, -1]] &= not change.free_ends
        return self._problem(change.objective, np.array([*change.limits.values()]), held)

    def with_local_limits(self, problem: RouteProblem, whole: bool = False) -> RouteProblem:
        """Return the problem with the limits at the fine nodes; see `along.local_squares`."""
        own = along.local_squares(self.route, self.limits, self.given.curves, self.closed, len(self.clear), whole)
        return problem._replace(local=own)

    def task(self, problem: RouteProblem, most: int) -> rounds.Task:
        """Return the searches for a problem, with at most `most` steps each."""
        return rounds.Task(self.route, self.given, self.limits, self.widths, problem, most)

    def _problem(self, objective: str, bounds: np.ndarray, held: np.ndarray) -> RouteProblem:
        every, kept = np.append(bounds, np.ones(len(self.clear))), objective == "smoothest"
        origin = np.asarray(self.route.origin, float)
        own = self.names, every, self.widths, held, objective, kept, self.closed, self.road, origin
        problem = problem_of(self.given, *own)
        problem = problem._replace(by_speed=all_with_speed(self.limits.given(), bounds))
        return around.with_obstacles(problem, self.clear, self.given.h)
