"""The motion "hermite", with a cubic angle and arbitrary velocities at both ends."""

from typing import ClassVar

from jaxtyping import Array, Float

from qtraj.design.tuning.motions.motion import VELOCITIES, AbstractMotion
from qtraj.foundation.types import Scalar, Vec3
from qtraj.path.boundary import Cylindrical


class Hermite(AbstractMotion):
    """The motion with cubic ρ, φ and h; all six velocity components at the ends are variables."""

    name: ClassVar[str] = "hermite"
    velocities: ClassVar[tuple[str, ...]] = VELOCITIES
    is_uniform: ClassVar[bool] = False

    def boundary_velocities(
        self, a: Cylindrical, b: Cylindrical, changes: Float[Array, " n"], turn: Scalar, duration: Scalar
    ) -> tuple[Vec3, Vec3]:
        """Return the initial velocities plus the changes."""
        return a.velocity + changes[:3], b.velocity + changes[3:]

    def duration(self, a: Cylindrical, b: Cylindrical, turn: Scalar) -> Scalar:
        """Return the turn divided by the mean of V_φ/ρ at both ends."""
        return 2 * turn / (a.rate + b.rate)
