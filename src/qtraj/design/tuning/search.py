"""The abstract search method, which solves a batch of tuning problems."""

import abc
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from qtraj.design.tuning.task import LimitSlots, Task


class SearchResult(NamedTuple):
    """The result of a search for one problem, or the results for a batch; NumPy arrays unless traced.

    `multipliers`, `times` and `values` belong to the peaks of each limited quantity, and to the ends of the path.
    `violation` is the largest constraint value, or zero if all limits are satisfied. `stationary` is true if the search
    ended at a stationary point.
    """

    z: Float[Array, "*batch n"]
    multipliers: Float[Array, "*batch slots k"]
    times: Float[Array, "*batch slots k"]
    values: Float[Array, "*batch slots k"]
    violation: Float[Array, "*batch"]
    stationary: Bool[Array, "*batch"]
    steps: Int[Array, "*batch"]


class AbstractSearch(eqx.Module):
    """A search method, which runs a batch of searches, each from its own start.

    The state of the searches is a pytree of arrays with the fields `steps`, `done` and `effort` (the computational cost
    of the last step). After each number of steps in `stages`, the unfinished searches of a large batch are regrouped
    into fewer blocks. A search stops after at most `step_limit` steps.
    """

    stages: ClassVar[tuple[int, ...]]

    @property
    @abc.abstractmethod
    def step_limit(self) -> Int[Array | np.ndarray, ""]:
        """Maximum number of steps of a search."""

    @abc.abstractmethod
    def init(self, tasks: Task, z: Any) -> Any:
        """Return the state before the first step of searches from `z`, as NumPy arrays if `z` is a NumPy array."""

    @abc.abstractmethod
    def run(self, tasks: Task, slots: LimitSlots, states: Any, max_steps: Int[Array | np.ndarray, ""]) -> Any:
        """Advance the searches until each is done or has reached `max_steps` steps, and return their state."""

    @abc.abstractmethod
    def result(self, tasks: Task, states: Any, xp: Any) -> tuple[SearchResult, Any]:
        """Return the results and the costs of the searches; `xp` is the module of the states' arrays."""


def step_count(number: Any) -> np.ndarray:
    """Convert a number of steps to an array, so that a different number does not cause a recompilation."""
    return np.asarray(number, np.int32)
