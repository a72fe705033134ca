"""The motion "hermite", with a cubic angle and arbitrary velocities at both ends."""

from collections.abc import Sequence
from typing import Any, ClassVar

from qtraj.design.tuning.motions.motion import VELOCITIES, AbstractMotion, Velocities
from qtraj.path.boundary import Cylindrical


class Hermite(AbstractMotion):
    """The motion with cubic ρ, φ and h; all six velocity components at the ends are variables."""

    name: ClassVar[str] = "hermite"
    velocities: ClassVar[tuple[str, ...]] = VELOCITIES
    is_uniform: ClassVar[bool] = False

    def boundary_velocities(
        self, a: Cylindrical, b: Cylindrical, changes: Sequence[Any], turn: Any, duration: Any
    ) -> Velocities:
        """Return the initial velocities plus the changes."""
        first, last = ([state.velocity[..., k] for k in range(3)] for state in (a, b))
        return (
            (changes[0] + first[0], changes[1] + first[1], changes[2] + first[2]),
            (changes[3] + last[0], changes[4] + last[1], changes[5] + last[2]),
        )

    def duration(self, a: Cylindrical, b: Cylindrical, turn: Any) -> Any:
        """Return the turn divided by the mean of V_φ/ρ at both ends."""
        return 2 * turn / (a.velocity[..., 1] / a.radius + b.velocity[..., 1] / b.radius)
