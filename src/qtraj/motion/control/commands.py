"""Split a command into the program's acceleration and a correction, in body or inertial axes (paper C, (2.1), (2.2)).

The commanded acceleration is ε_x in body axes and ε_ξ in inertial axes. The acceleration of the program is ε_z⁰ in
program axes and ε_ξ⁰ in inertial axes. The sum ε_x = ε_z⁰ + δε adds components in different axes, so δε is *not* the
difference between the two vectors. In inertial axes, ε_ξ = ε_ξ⁰ + Δε, and Δε is this difference. A law returns ε_x. The
functions of this module split ε_x for analysis or telemetry, or compute ε_x from a correction.
Accelerations are (4,) [rad/s²], with the virtual scalar part first.
"""

from qtraj.foundation.float_arguments import float_arguments
from qtraj.foundation.types import Quat
from qtraj.motion.attitude import Attitude, require_body_axes
from qtraj.motion.control.errors import pure, to_body, to_inertial


@float_arguments
def body_command(reference: Attitude, correction: Quat) -> Quat:
    """Return ε_x = ε_z⁰ + δε (2.1), the sum of components in program axes and a `correction` δε in body axes."""
    require_body_axes(reference)
    return pure(reference.acceleration) + correction


@float_arguments
def body_correction(reference: Attitude, command: Quat) -> Quat:
    """Return the correction δε = ε_x − ε_z⁰ from a command ε_x in body axes."""
    require_body_axes(reference)
    return command - pure(reference.acceleration)


@float_arguments
def inertial_command(reference: Attitude, quaternion: Quat, correction: Quat) -> Quat:
    """Return ε_x in body axes for ε_ξ = ε_ξ⁰ + Δε (2.2), where the `correction` Δε is in inertial axes."""
    require_body_axes(reference)
    program = to_inertial(reference.quaternion, pure(reference.acceleration))
    return to_body(quaternion, program + correction)


@float_arguments
def inertial_correction(reference: Attitude, quaternion: Quat, command: Quat) -> Quat:
    """Return the correction Δε = ε_ξ − ε_ξ⁰, in inertial axes, from a command ε_x in body axes."""
    require_body_axes(reference)
    program = to_inertial(reference.quaternion, pure(reference.acceleration))
    return to_inertial(quaternion, command) - program
