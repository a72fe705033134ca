"""The abstract search method: it solves many tuning problems side by side."""

import abc
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from qtraj.design.tuning.task import LimitSlots, Task


class SearchResult(NamedTuple):
    """The results of searches, of one problem or a batch; NumPy arrays outside a trace.

    `multipliers`, `times` and `values` belong to the peaks and ends of each limit. `violation` is the largest
    constraint value, or zero where all limits are met. `stationary` is true where the search ended at a stationary
    point.
    """

    z: Float[Array, "*batch n"]
    multipliers: Float[Array, "*batch slots k"]
    times: Float[Array, "*batch slots k"]
    values: Float[Array, "*batch slots k"]
    violation: Float[Array, "*batch"]
    stationary: Bool[Array, "*batch"]
    steps: Int[Array, "*batch"]


class AbstractSearch(eqx.Module):
    """A search method. It runs a batch of searches, each from its own start.

    The state of the searches is a pytree of arrays with the fields `steps`, `done` and `effort` (the cost of the last
    step). After each number of steps in `stages`, the unfinished searches of a large batch are gathered into fewer
    blocks. A search stops after `step_limit` steps at the latest.
    """

    stages: ClassVar[tuple[int, ...]]

    @property
    @abc.abstractmethod
    def step_limit(self) -> Int[Array | np.ndarray, ""]:
        """Number of steps after which a search stops."""

    @abc.abstractmethod
    def init(self, tasks: Task, z: Any) -> Any:
        """The state of searches from `z` before their first step; NumPy arrays in, NumPy arrays out."""

    @abc.abstractmethod
    def run(self, tasks: Task, slots: LimitSlots, states: Any, max_steps: Int[Array | np.ndarray, ""]) -> Any:
        """The state after further steps, until each search is done or has taken `max_steps`."""

    @abc.abstractmethod
    def result(self, tasks: Task, states: Any, xp: Any) -> tuple[SearchResult, Any]:
        """The results of the searches and their costs. `xp` is NumPy or JAX's NumPy, as the states are."""


def step_count(number: Any) -> np.ndarray:
    """A number of steps as an array, so that changing it does not recompile."""
    return np.asarray(number, np.int32)
