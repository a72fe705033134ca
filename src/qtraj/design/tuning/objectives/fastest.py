"""The objective "fastest", which is the duration."""

from typing import Any, ClassVar

from jaxtyping import Array, Float

from qtraj.design.tuning.objectives.objective import AbstractObjective
from qtraj.foundation.types import Scalar


class Fastest(AbstractObjective):
    """The duration [s] as the objective."""

    name: ClassVar[str] = "fastest"
    needs_time_limit: ClassVar[bool] = True

    def value(self, problem: Any, z: Float[Array, " n"]) -> Scalar:
        """Return the duration [s]."""
        return problem.time(z)

    def scale(self, problem: Any) -> Scalar:
        """Return the initial duration [s]."""
        return problem.duration
