"""Torques of the surroundings on a body: gravity gradient, magnetic field and air, as functions of its state.

Each is a function (t, quaternion, rate) → (3,) [N m] in body axes, for `RigidBody(torque=...)` and `DisturbanceTorque`.
`TorqueSum` adds several of them.
"""

from qtraj.motion.torques.aerodynamic import AerodynamicTorque
from qtraj.motion.torques.circular_orbit import CircularOrbit
from qtraj.motion.torques.gravity_gradient import GravityGradient
from qtraj.motion.torques.magnetic import MagneticDipole
from qtraj.motion.torques.torque_sum import TorqueSum

__all__ = ["AerodynamicTorque", "CircularOrbit", "GravityGradient", "MagneticDipole", "TorqueSum"]
