"""A command as the program's acceleration plus a correction, in body or inertial axes (paper C, (2.1) and (2.2)).

In body axes, ε_x = ε_z⁰ + δε adds components in different bases, so δε is *not* the difference of the two vectors. In
inertial axes, ε_ξ = ε_ξ⁰ + Δε, the correction is the difference of the two vectors. A law returns ε_x; these functions
split it for analysis or telemetry. Accelerations are (4,) [rad/s²], with the virtual scalar part first.
"""

from qtraj.foundation.types import Quat
from qtraj.motion.attitude import Attitude, require_body_axes
from qtraj.motion.control.errors import pure, to_body, to_inertial


def body_command(reference: Attitude, correction: Quat) -> Quat:
    """ε_x = ε_z⁰ + δε (2.1): components in the program's axes plus components in the body's axes."""
    require_body_axes(reference)
    return pure(reference.acceleration) + correction


def body_correction(reference: Attitude, command: Quat) -> Quat:
    """δε = ε_x − ε_z⁰ of a command in body axes."""
    require_body_axes(reference)
    return command - pure(reference.acceleration)


def inertial_command(reference: Attitude, quaternion: Quat, correction: Quat) -> Quat:
    """ε_x in body axes for ε_ξ = ε_ξ⁰ + Δε (2.2); the correction is in inertial axes."""
    require_body_axes(reference)
    program = to_inertial(reference.quaternion, pure(reference.acceleration))
    return to_body(quaternion, program + correction)


def inertial_correction(reference: Attitude, quaternion: Quat, command: Quat) -> Quat:
    """Δε = ε_ξ − ε_ξ⁰ in inertial axes of a command in body axes: the difference of the two vectors."""
    require_body_axes(reference)
    program = to_inertial(reference.quaternion, pure(reference.acceleration))
    return to_inertial(quaternion, command) - program
