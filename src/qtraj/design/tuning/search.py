"""The abstract search method, which solves a batch of tuning problems, and the results of searches."""

import abc
import enum
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int

from qtraj.design.tuning.searches import Searches

Callback = Callable[[int], None]
"""A function that is called with the number of finished searches."""


class Penalty(enum.Enum):
    """The penalty of violations in a search.

    A `LARGE` one, for starts that satisfy the limits, keeps most searches near the feasible paths. With a `FIXED` one,
    which is as large at first and never lowered, none leaves them, but steps along a curved constraint are short.
    """

    USUAL = enum.auto()
    LARGE = enum.auto()
    FIXED = enum.auto()


TIE = 1e-9
"""A result that is not stationary is worse than a stationary one if their costs differ by less than `TIE` units."""


class Ends(NamedTuple):
    """The final points of a batch of searches.

    `largest` is the largest constraint value, and `unit` the difference of costs that is a large one.
    """

    z: Float[Any, "n batch"]
    cost: Float[Any, " batch"]
    largest: Float[Any, " batch"]
    stationary: Bool[Any, " batch"]  # ended at a stationary point
    steps: Int[Any, " batch"]
    unit: Float[Any, " batch"]

    def take(self, index: Any) -> "Ends":
        """Return the final points of some searches."""
        return Ends(*(x[..., index] for x in self))

    def put(self, index: np.ndarray, other: "Ends") -> None:
        """Replace the final points of some searches."""
        for own, new in zip(self, other, strict=True):
            own[..., index] = new


class SearchResult(NamedTuple):
    """The best results of problems: NumPy arrays, or JAX arrays inside a trace.

    `limit`, `time` and `multiplier` describe the active peaks; unused elements have the multiplier 0. `violation` is
    the largest constraint value, or zero if all limits are satisfied. The multipliers belong to the objective divided
    by `scale`. `starts` is the number of starts of all searches for the problem.
    """

    z: Float[Any, "*batch n"]
    limit: Int[Any, "*batch k"]
    time: Float[Any, "*batch k"]
    multiplier: Float[Any, "*batch k"]
    violation: Float[Any, "*batch"]
    stationary: Bool[Any, "*batch"]
    steps: Int[Any, "*batch"]
    scale: Float[Any, "*batch"]
    starts: Int[Any, "*batch"]

    def among(self, index: Int[np.ndarray, " batch"], count: int) -> "SearchResult":
        """Return the results of `count` problems, of which these are at `index`, and all others are NaN or zero."""

        def widened(x: np.ndarray) -> np.ndarray:
            wide = np.full((count, *x.shape[1:]), np.nan if np.issubdtype(x.dtype, np.floating) else 0, x.dtype)
            wide[index] = x
            return wide

        return SearchResult(*(widened(np.asarray(x)) for x in self))


class AbstractSearch(eqx.Module):
    """A search method, which runs a batch of searches, each from its own start."""

    @property
    def refined_by(self) -> "AbstractSearch | None":
        """The method that continues from the final points; None if these are solutions."""
        return None

    @property
    @abc.abstractmethod
    def total_steps(self) -> int:
        """The maximum number of steps of one search."""

    @abc.abstractmethod
    def search(
        self,
        searches: Searches,
        z: Float[np.ndarray, "n batch"],
        callback: Callback | None = None,
        penalty: Penalty = Penalty.USUAL,
    ) -> Ends:
        """Return the final points of a batch of searches, each from its own `z`."""
