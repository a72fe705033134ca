"""Define the scenario tables of a rigid body with thrusters or reaction wheels."""

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from qtraj.foundation.naming import naming
from qtraj.motion.simulation.body import ReactionWheels, RigidBody
from qtraj.scenario import keys
from qtraj.scenario.keys import Part, key

EACH = "a positive finite number, or one of each wheel"
Axes = Annotated[
    list[keys.Vector], Field(min_length=3, description="three or more vectors [x, y, z], which span three dimensions")
]


class WheelsPart(Part):
    """Reaction wheels, whose motors exert the control torque on the body; without wheels it is that of thrusters."""

    axes: Axes = key("the spin axes, in body axes, of any length")
    max_torque: keys.Positive | list[keys.Positive] | None = key(
        "limit on the torque of each motor; all torques are scaled by the same factor", None, values=EACH, unit="N m"
    )
    max_momentum: keys.Positive | list[keys.Positive] | None = key(
        "limit on the momentum of each wheel; there a wheel can only be slowed down", None, values=EACH, unit="N m s"
    )
    momentum: list[keys.Number] | None = key(
        "momenta at the start; default: 0", None, values="one finite number for each wheel", unit="N m s"
    )

    def _faults(self) -> Iterator[str]:
        self.wheels()  # raises for axes or numbers that do not fit
        yield from ()

    def wheels(self) -> ReactionWheels:
        """Return the wheels."""
        return ReactionWheels(self.axes, self.max_torque, self.max_momentum, self.momentum)


class RigidBodyPart(Part):
    """A rigid body under Euler's equations; the law commands torques that are calculated with an assumed inertia.

    Without this table, the acceleration of the body is exactly the command, apart from the disturbance.
    """

    inertia: keys.Inertia = key("moment of inertia of a spherical body, principal moments, or the tensor, in body axes")
    assumed: keys.Inertia | None = key("inertia for which the torques are calculated; default: the exact inertia", None)
    max_torque: keys.Positive | None = key(
        "limit on the magnitude of the torque of thrusters; not with [body.wheels]", None, unit="N m"
    )
    wheels: WheelsPart | None = key("reaction wheels; default: thrusters", None, values="a table [body.wheels]")

    def _faults(self) -> Iterator[str]:
        if self.wheels is not None and self.max_torque is not None:
            yield "'max_torque' limits thrusters, but there are wheels: use 'max_torque' of [body.wheels]"

    def body(self) -> RigidBody:
        """Return the body without external torques, which are disturbances."""
        with naming("[body]: "):
            wheels = self.wheels and self.wheels.wheels()
            return RigidBody(self.inertia, self.assumed, None, wheels, self.max_torque)
