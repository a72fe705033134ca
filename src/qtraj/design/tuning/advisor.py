"""Advice on problems of a batch, computed on demand."""

import itertools
from collections.abc import Collection, Sequence

import jax
import numpy as np

from qtraj.design.tuning.advice import SearchOptions, advice
from qtraj.design.tuning.box import default_bound_warning
from qtraj.design.tuning.problem import Problem
from qtraj.design.tuning.search import SearchResult
from qtraj.design.tuning.searches import Searches
from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.progress import Report
from qtraj.path.quantity import quantity
from qtraj.path.vehicle import Vehicle

ZONES = "Raise the limits that are violated where they are, or pass more starts."
"""Advice if limits change along the way."""


class Advisor:
    """Advice on the problems of a batch, computed on demand and cached.

    All advisors compare equal, so they affect neither the compilation nor the tree structure of a batch. Each element
    of a batch stores its index and the `number` of its advisor, because JAX may substitute another advisor.
    """

    _numbers = itertools.count(1)

    def __init__(
        self,
        searches: Searches,
        result: SearchResult,
        starts: int,
        max_steps: int,
        user_bounds: Collection[str],
        vehicle: Vehicle | None = None,
    ):
        self.number = next(self._numbers)
        self._data = searches, result
        self._search = starts, max_steps
        self._user_bounds, self._vehicle = user_bounds, vehicle
        self._cache: dict[int, str] = {}

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Advisor)

    def __hash__(self) -> int:
        return hash(Advisor)

    def __call__(self, place: int, code: ResultCode, report: Report | None = None) -> str:
        """Return advice on the problem with index `place`, whose result code is `code`."""
        if place not in self._cache:
            self._cache[place] = " ".join(filter(None, self._sentences(place, code, report)))
        return self._cache[place]

    def _sentences(self, place: int, code: ResultCode, report: Report | None) -> list[str]:
        searches, result = self._data
        element = slice(place, place + 1)
        one, at = searches.take(element), jax.tree.map(lambda x: x[element], result)
        problem, names = one.problem, (*searches.limits, *(zone.name for zone in searches.zones))
        vehicle = self._vehicle
        if vehicle is not None and vehicle.mass.ndim:
            vehicle = jax.tree.map(lambda x: x[place], vehicle)
        options = SearchOptions(*self._search, report, vehicle)
        sentences = [default_bound_warning(problem.names, np.asarray(at.z[0]), self._user_bounds)]
        if code != ResultCode.successful:
            sentences = [standstill_warning(problem, names), *sentences]
        if code == ResultCode.infeasible:
            if one.zones:
                return [ZONES, *sentences]
            return [advice(one, at, options), *sentences]
        if code == ResultCode.not_converged and not sentences[0]:
            more = "a larger max_steps, " if int(at.steps[0]) >= options.max_steps else ""
            sentences.append(f"Try {more}more starts, other boundary velocities, or wider limits.")
        return sentences


def standstill_warning(problem: Problem, names: Sequence[str]) -> str:
    """Return a message if a limited quantity is singular because a boundary velocity is zero, else an empty string."""
    singular = [name for name in names if quantity(name).divisor is not None]
    ends = [x for x in ("start", "end") if not np.any(np.asarray(getattr(problem, x).velocity))]
    if not (singular and ends):
        return ""
    return (
        f"The velocity at the {' and the '.join(ends)} is zero: {', '.join(singular)} may grow without bound there, "
        "or limits may be impossible to prove. Pass a small velocity instead of zero, or limit speed, "
        "acceleration or jerk instead."
    )
