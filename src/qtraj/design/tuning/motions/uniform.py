"""The motion "uniform", with rotation at a constant rate, as in paper S."""

from collections.abc import Sequence
from typing import Any, ClassVar

from qtraj.design.tuning.motions.motion import VELOCITIES, AbstractMotion, Velocities
from qtraj.path.boundary import Cylindrical


class Uniform(AbstractMotion):
    """The motion with constant angular rate ω; V_ρ and V_h at both ends are variables, and V_φ = ωρ."""

    name: ClassVar[str] = "uniform"
    velocities: ClassVar[tuple[str, ...]] = tuple(v for v in VELOCITIES if not v.endswith("V_phi"))
    is_uniform: ClassVar[bool] = True

    def boundary_velocities(
        self, a: Cylindrical, b: Cylindrical, changes: Sequence[Any], turn: Any, duration: Any
    ) -> Velocities:
        """Return the initial V_ρ and V_h plus the changes, and V_φ for the constant rate."""
        rate = turn / duration
        return (
            (changes[0] + a.velocity[..., 0], rate * a.radius, changes[1] + a.velocity[..., 2]),
            (changes[2] + b.velocity[..., 0], rate * b.radius, changes[3] + b.velocity[..., 2]),
        )

    def duration(self, a: Cylindrical, b: Cylindrical, turn: Any) -> Any:
        """Return the turn divided by the angular rate that fits V_φ at both ends in the least-squares sense."""
        return turn * (a.radius**2 + b.radius**2) / (a.radius * a.velocity[..., 1] + b.radius * b.velocity[..., 1])
