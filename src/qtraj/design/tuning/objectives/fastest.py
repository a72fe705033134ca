"""The objective "fastest", which is the duration."""

from typing import Any, ClassVar

from qtraj.design.tuning.objectives.objective import AbstractObjective


class Fastest(AbstractObjective):
    """The duration [s] as the objective."""

    name: ClassVar[str] = "fastest"
    needs_time_limit: ClassVar[bool] = True

    def value(self, problem: Any, z: Any) -> Any:
        """Return the duration [s]."""
        return problem.time(z)

    def scale(self, problem: Any) -> Any:
        """Return the initial duration [s]."""
        return problem.duration
