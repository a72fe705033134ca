"""Define the scenario tables of disturbances: accelerations, torques, and the torques of a satellite's surroundings."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from qtraj.motion.simulation.disturbance import (
    AbstractDisturbance,
    DisturbanceAcceleration,
    DisturbanceTorque,
    Sinusoid,
)
from qtraj.motion.simulation.signals import SignalInput
from qtraj.motion.torques.aerodynamic import AerodynamicTorque
from qtraj.motion.torques.circular_orbit import EARTH, CircularOrbit
from qtraj.motion.torques.gravity_gradient import GravityGradient
from qtraj.motion.torques.magnetic import MagneticDipole
from qtraj.motion.torques.torque_sum import TorqueSum
from qtraj.scenario import keys
from qtraj.scenario.keys import Part, key

SURROUNDINGS = ("gravity_gradient", "magnetic", "aerodynamic")
"""The tables of torques that depend on the attitude."""
ON_ORBIT = {"gravity_gradient": "position", "aerodynamic": "velocity"}
"""The key of each table that an orbit determines."""
TORQUES = ("torque", *SURROUNDINGS)


class OrbitPart(Part):
    """A circular orbit, which determines the position of the body and its velocity relative to the air.

    The air is at rest in inertial axes.
    """

    radius: keys.Metres = key("radius, from the centre of the planet")
    start: keys.Vector = key("direction of the position at t = 0, inertial axes, of any length", [1.0, 0.0, 0.0])
    normal: keys.Vector = key("normal of the orbit, inertial axes; the motion is counter-clockwise", [0.0, 0.0, 1.0])
    mu: keys.Positive = key("gravitational parameter of the planet; default: that of the Earth", EARTH, unit="m³/s²")

    def _faults(self) -> Iterator[str]:
        self.orbit()  # raises for vectors without an orbit
        yield from ()

    def orbit(self) -> CircularOrbit:
        """Return the orbit."""
        return CircularOrbit(self.radius, self.start, self.normal, self.mu)


class GravityPart(Part):
    """The gravity-gradient torque of a spherical planet."""

    position: keys.Vector | None = key(
        "constant position from the centre of the planet, inertial axes; default: that of [disturbance.orbit]",
        None,
        unit="m",
    )
    mu: keys.Positive | None = key(
        "gravitational parameter; default: that of [disturbance.orbit], otherwise that of the Earth",
        None,
        unit="m³/s²",
    )

    def _faults(self) -> Iterator[str]:
        if self.position is not None and not any(self.position):
            yield "position must not be zero, because the torque of the planet is then not defined"

    def torque(self, inertia: Any, orbit: OrbitPart | None) -> GravityGradient:
        """Return the torque on a body with this inertia [kg m²]; `orbit` is used if there is no position."""
        mu = self.mu or (orbit.mu if orbit is not None else EARTH)
        return GravityGradient(inertia, _at(self.position, orbit and orbit.orbit()), mu)


class MagneticPart(Part):
    """The torque of a magnetic field on the dipole of the body."""

    dipole: keys.Vector = key("the magnetic dipole, in body axes", unit="A m²")
    field: keys.Vector = key("the magnetic field, constant in inertial axes", unit="T")

    def torque(self) -> MagneticDipole:
        """Return the torque."""
        return MagneticDipole(self.dipole, self.field)


class AirPart(Part):
    """The torque of the air drag, which acts at the centre of pressure."""

    centre: keys.Vector = key("the centre of pressure relative to the centre of mass, in body axes", unit="m")
    area: keys.Positive = key("the area across the flow", unit="m²")
    density: keys.Positive = key("the density of the air", unit="kg/m³")
    drag: keys.Positive = key("the drag coefficient", 2.2)
    velocity: keys.Vector | None = key(
        "constant velocity relative to the air, inertial axes; default: that of [disturbance.orbit]", None, unit="m/s"
    )

    def torque(self, orbit: OrbitPart | None) -> AerodynamicTorque:
        """Return the torque; the velocity on the `orbit` is used if there is no velocity."""
        velocity = _at(self.velocity, orbit and orbit.orbit().velocity)
        return AerodynamicTorque(self.centre, self.area, self.density, velocity, self.drag)


class DisturbancePart(Part):
    """An angular acceleration, or the sum of torques on the body.

    The keys acceleration and torque are constant, or multiplied by sin(2πt/period + phase). The torques of a
    satellite's surroundings depend on its attitude and are added to 'torque'. Torques require an inertia.
    """

    acceleration: keys.Vector | None = key("angular acceleration, in body axes", None, unit="angle/s²")
    torque: keys.Vector | None = key("torque, in body axes", None, unit="N m")
    inertia: keys.Inertia | None = key("inertia of the body, for torques without a table [body]", None)
    period: keys.Seconds | None = key("period of a sinusoidal acceleration or torque; default: a constant one", None)
    phase: keys.Number = key("phase of a sinusoidal acceleration or torque", 0.0, unit="angle")
    orbit: OrbitPart | None = key(
        "the orbit, for the gravity gradient and the air drag", None, values="a table [disturbance.orbit]"
    )
    gravity_gradient: GravityPart | None = key(
        "the gravity-gradient torque", None, values="a table [disturbance.gravity_gradient], which may be empty"
    )
    magnetic: MagneticPart | None = key("the torque of a magnetic field", None, values="a table [disturbance.magnetic]")
    aerodynamic: AirPart | None = key("the torque of the air", None, values="a table [disturbance.aerodynamic]")

    @property
    def has_torques(self) -> bool:
        """Whether the disturbance is a torque."""
        return bool(self.given(*TORQUES))

    def _faults(self) -> Iterator[str]:
        if self.has_torques == (self.acceleration is not None):
            yield f"specify either acceleration, or torques ({', '.join(TORQUES)}) and an inertia"
        if self.inertia is not None and not self.has_torques:
            yield "the key 'inertia' requires a torque, which is missing"
        if self.period is None and "phase" in self.model_fields_set:
            yield "the key 'phase' requires 'period', which is missing"
        if self.period is not None and not self.given("acceleration", "torque"):
            yield "the key 'period' requires 'acceleration' or 'torque'"
        yield from self._orbit_faults()

    def _orbit_faults(self) -> Iterator[str]:
        needs = {name: known for name, known in ON_ORBIT.items() if getattr(self, name) is not None}
        open_ones = [name for name, known in needs.items() if getattr(getattr(self, name), known) is None]
        if self.orbit is None and open_ones:
            name = open_ones[0]
            yield f"[disturbance.{name}] needs [disturbance.orbit], or a constant {ON_ORBIT[name]}"
        if self.orbit is not None and not open_ones:
            yield "[disturbance.orbit] has no effect: remove it, or add gravity_gradient or aerodynamic"

    def disturbance(self, scale: float, body_inertia: Any = None) -> AbstractDisturbance:
        """Return the disturbance; `scale` converts angles to radians, `body_inertia` [kg m²] is that of [body]."""
        if self.acceleration is not None:
            return DisturbanceAcceleration(self._signal([scale * x for x in self.acceleration], scale))
        inertia = np.asarray(self.inertia if body_inertia is None else body_inertia, float)
        torques: list[SignalInput] = []
        if self.torque is not None:
            torques.append(self._signal(self.torque, scale))
        if self.gravity_gradient is not None:
            torques.append(self.gravity_gradient.torque(inertia, self.orbit))
        if self.magnetic is not None:
            torques.append(self.magnetic.torque())
        if self.aerodynamic is not None:
            torques.append(self.aerodynamic.torque(self.orbit))
        return DisturbanceTorque(torques[0] if len(torques) == 1 else TorqueSum(torques), inertia)

    def _signal(self, amplitude: list[float], scale: float) -> SignalInput:
        constant = np.asarray(amplitude, float)
        return constant if self.period is None else Sinusoid(constant, self.period, scale * self.phase)


def _at(constant: list[float] | None, orbit: SignalInput | None) -> SignalInput:
    """Return a constant vector if it is specified, and otherwise the function of time on an orbit."""
    return orbit if constant is None and orbit is not None else np.asarray(constant, float)
