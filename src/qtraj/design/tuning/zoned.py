"""Run searches with limits that change along the way, also inside areas."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from qtraj.design.limits import Limits
from qtraj.design.regions import Regions
from qtraj.design.tuning.outcome import Tuned
from qtraj.design.tuning.search import AbstractSearch, SearchResult
from qtraj.design.tuning.searches import Curves, Searches
from qtraj.design.tuning.sqp import SequentialQuadratic
from qtraj.design.tuning.task import one
from qtraj.design.tuning.travelled import Travelled
from qtraj.design.tuning.zones import zones_of
from qtraj.path.quantity import quantity

ROUNDS = 8
"""Maximum number of tunings to limits inside areas, each with the distances at which the last path crosses edges."""

Solve = Callable[[Searches], tuple[SearchResult, Tuned]]


def solve_in_zones(searches: Searches, limits: Limits, corridor: Any, solve: Solve) -> tuple[Searches, Any, Any]:
    """Solve problems with limits that may change along the way; return the searches, their results and the outcome.

    The limits inside areas become limits along the initial path. If the solution violates them, they become limits
    along the solution, and so on.
    """
    problem = searches.problem
    z = np.stack([np.broadcast_to(x, searches.count) for x in problem.zero])
    length = Travelled(Curves(searches, z), searches.count).length
    in_areas = any(isinstance(bound, Regions) for bound in limits.given().values())
    own = limits.on(one(problem.path(z))) if in_areas else limits
    rounds = 0
    while True:
        zoned = dataclasses.replace(searches, zones=zones_of(own, corridor, searches.count, length))
        result, outcome = solve(zoned)
        rounds += 1
        if not in_areas or outcome.converged or rounds == ROUNDS:
            return zoned, result, outcome
        own = limits.on(outcome.path)


def require_supported(limits: Limits, method: AbstractSearch, batch: tuple[int, ...], traced: bool) -> None:
    """Raise a ValueError for limits that change along the way in a tuning that does not support them."""
    areas = [name for name, bound in limits.given().items() if isinstance(bound, Regions)]
    if batch and areas:
        raise ValueError(f"the limit {areas[0]} is inside areas, which tune supports for one path: tune one by one")
    if traced:
        limits.require_constant("tune inside grad, jit or vmap", "omit the derivatives, or tune the paths one by one")
    for name in limits.varying:
        if quantity(name).tangent_of and getattr(limits.given()[name], "kind", "step") == "linear":
            raise ValueError(
                f"the limit {name} is an angle that changes linearly along the way, which tune does not support: use "
                "steps, Along(distance, values)"
            )
    if not isinstance(method, SequentialQuadratic):
        limits.require_constant("this method of tune", "pass method='sqp'")
