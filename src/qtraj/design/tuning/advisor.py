"""Advice on any problem of a batch, when it is asked for."""

import itertools
from collections.abc import Collection, Sequence

import numpy as np

from qtraj.design.tuning.advice import Search, advice
from qtraj.design.tuning.box import at_the_wall
from qtraj.design.tuning.multistart import take
from qtraj.design.tuning.problem import Problem
from qtraj.design.tuning.search import Found
from qtraj.design.tuning.task import Present, Task
from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.progress import Report
from qtraj.path.quantity import quantity


class Advisor:
    """Advice on the problems of a batch, worked out once for each that is asked about.

    All advisors are equal: they are no part of what is compiled for a batch, nor of its structure. A batch keeps the
    `number` of its own beside the place of each element, since JAX may hand on another one.
    """

    _numbers = itertools.count(1)

    def __init__(
        self,
        tasks: Task,
        which: Present,
        names: Sequence[str],
        found: Found,
        starts: int,
        most_steps: int,
        bounded: Collection[str],
    ):
        self.number = next(self._numbers)
        self._given = tasks, names, found
        self._search = which, starts, most_steps
        self._bounded = bounded
        self._known: dict[int, str] = {}

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Advisor)

    def __hash__(self) -> int:
        return hash(Advisor)

    def __call__(self, place: int, code: ResultCode, tell: Report | None = None) -> str:
        """What to do about one problem that ended so: what would help, and which variable went too far."""
        if place not in self._known:
            self._known[place] = " ".join(filter(None, self._words(place, code, tell)))
        return self._known[place]

    def _words(self, place: int, code: ResultCode, tell: Report | None) -> list[str]:
        tasks, names, found = self._given
        one, at = take(tasks, slice(place, place + 1)), take(found, slice(place, place + 1))
        search = Search(*self._search, tell)
        words = [at_the_wall(tasks.problem.names, np.asarray(at.z[0]), self._bounded)]
        if code != ResultCode.successful:
            words = [at_a_stop(take(one.problem, 0), names), *words]
        if code == ResultCode.infeasible:
            return [advice(one, names, at, search), *words]
        if code == ResultCode.not_converged and not words[0]:
            more = "a larger max_steps, " if int(at.steps[0]) >= search.most_steps else ""
            words.append(f"Try {more}more starts, other starting velocities, or wider limits.")
        return words


def at_a_stop(problem: Problem, names: Sequence[str]) -> str:
    """What to say where a given state stands still, of limits that divide by the speed."""
    divided = [name for name in names if quantity(name).divisor not in (None, "level")]
    ends = [x for x in ("start", "end") if not np.any(np.asarray(getattr(problem, x).velocity))]
    if not (divided and ends):
        return ""
    return (
        f"The given {' and '.join(ends)} stands still, where {', '.join(divided)} may grow without bound. Give a small "
        "velocity there, or limit speed, acceleration or jerk instead."
    )
