"""The objective "nearest": the change of the boundary velocities and, except in uniform motion, of the duration."""

from typing import Any, ClassVar

from qtraj.design.tuning.objectives.objective import AbstractObjective


class Nearest(AbstractObjective):
    """The weighted sum of squared changes of the velocities and, except in uniform motion, of the duration [m² s⁻²]."""

    name: ClassVar[str] = "nearest"

    def value(self, problem: Any, z: Any) -> Any:
        """Return the weighted sum [m² s⁻²]; the relative change of the duration is scaled by the reference speed."""
        duration = problem.time(z)
        tuned, total = problem.velocities(z, duration), 0.0
        for k, state in enumerate((problem.start, problem.end)):
            for j in range(3):
                change = tuned[k][j] - state.velocity[..., j]
                total = total + (change * change) * problem.weights[..., 3 * k + j]
        if problem.motion.is_uniform:
            return total
        change = (duration - problem.duration) * (problem.speed / problem.duration)
        return total + (change * change) * problem.weights[..., 6]

    def scale(self, problem: Any) -> Any:
        """Return the squared reference speed times the largest weight."""
        max_weight = problem.weights.max(axis=-1)
        return problem.speed**2 * (max_weight + (max_weight == 0))
