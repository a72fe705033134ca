"""The abstract search: what one method does to many tuning problems side by side."""

import abc
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from qtraj.design.tuning.task import Present, Task


class Found(NamedTuple):
    """Where the searches of one problem, or of many, ended; outside a trace in NumPy arrays.

    `multipliers`, `times` and `values` are those of peaks and ends; `violation` is the largest, zero where the limits
    are met; `settled` tells of a stationary point.
    """

    z: Float[Array, "*batch n"]
    multipliers: Float[Array, "*batch slots k"]
    times: Float[Array, "*batch slots k"]
    values: Float[Array, "*batch slots k"]
    violation: Float[Array, "*batch"]
    settled: Bool[Array, "*batch"]
    steps: Int[Array, "*batch"]


class AbstractSearch(eqx.Module):
    """A method that searches from one start; many searches, a batch in front, run side by side.

    A search is a state, a pytree of arrays with the fields `steps`, `done` and `effort` (of the last step). `stages`
    are numbers of steps after which the unfinished searches of a large batch are gathered, and after `most_steps` a
    search ends in any case.
    """

    stages: ClassVar[tuple[int, ...]]

    @property
    @abc.abstractmethod
    def most_steps(self) -> Int[Array | np.ndarray, ""]:
        """Steps after which a search ends in any case."""

    @abc.abstractmethod
    def unstarted(self, tasks: Task, z: Any) -> Any:
        """Searches from `z` before their first step; in NumPy arrays for NumPy arrays."""

    @abc.abstractmethod
    def proceed(self, tasks: Task, which: Present, states: Any, most_steps: Int[Array | np.ndarray, ""]) -> Any:
        """The searches after further steps, until each is done or has taken `most_steps`."""

    @abc.abstractmethod
    def ended(self, tasks: Task, states: Any, xp: Any) -> tuple[Found, Any]:
        """Where the searches stand, and their costs; `xp` is NumPy or JAX's NumPy, as the states are."""


def whole(number: Any) -> np.ndarray:
    """A number of steps as an array: another number is then no other executable."""
    return np.asarray(number, np.int32)
