"""The abstract objective: what is asked of a path besides its limits."""

import abc
from typing import Any, ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from qtraj.foundation.types import Scalar


class AbstractObjective(eqx.Module):
    """A number to be least, in units of its own.

    `holds_duration`: the duration is no variable. `needs_time_limit`: only a limit that grows with speed bounds it.
    `is_smooth`: its second derivatives are known to exist, as the search "sqp" needs them.
    """

    name: ClassVar[str]
    holds_duration: ClassVar[bool] = False
    needs_time_limit: ClassVar[bool] = False
    is_smooth: ClassVar[bool] = True

    @abc.abstractmethod
    def value(self, problem: Any, z: Float[Array, " n"]) -> Scalar:
        """The objective at the variables `z` of a `Problem`."""

    @abc.abstractmethod
    def scale(self, problem: Any) -> Scalar:
        """The objective's size, so that the search sees numbers near one."""
