"""The abstract objective: a number to minimise."""

import abc
from typing import Any, ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from qtraj.foundation.types import Scalar


class AbstractObjective(eqx.Module):
    """A number to minimise, in its own units.

    `fixes_duration`: the duration is not a variable. `needs_time_limit`: the problem needs a limit that bounds the
    speed. `is_smooth`: the second derivatives exist; the search "sqp" needs them.
    """

    name: ClassVar[str]
    fixes_duration: ClassVar[bool] = False
    needs_time_limit: ClassVar[bool] = False
    is_smooth: ClassVar[bool] = True

    @abc.abstractmethod
    def value(self, problem: Any, z: Float[Array, " n"]) -> Scalar:
        """The objective at the variables `z` of a `Problem`."""

    @abc.abstractmethod
    def scale(self, problem: Any) -> Scalar:
        """The magnitude of the objective, by which the search divides it."""
