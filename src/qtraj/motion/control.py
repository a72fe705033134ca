"""Attitude control after paper C: errors, laws, gains, the closed-form response, and the choices at the start."""

from qtraj.motion.baselines import GeometricFeedback, LogarithmicFeedback, QuaternionFeedback
from qtraj.motion.commands import body_command, body_correction, inertial_command, inertial_correction
from qtraj.motion.errors import error_quaternion, error_rate, state_from_error
from qtraj.motion.gains import from_damping, from_settling_time, from_weights
from qtraj.motion.laws import AbstractLaw, AccelerationLaw, RateLaw
from qtraj.motion.response import error_response, error_state
from qtraj.motion.sheet import choose_sign, gibbs_gauge, least_norm

__all__ = [
    "AbstractLaw",
    "AccelerationLaw",
    "GeometricFeedback",
    "LogarithmicFeedback",
    "QuaternionFeedback",
    "RateLaw",
    "body_command",
    "body_correction",
    "choose_sign",
    "error_quaternion",
    "error_rate",
    "error_response",
    "error_state",
    "from_damping",
    "from_settling_time",
    "from_weights",
    "gibbs_gauge",
    "inertial_command",
    "inertial_correction",
    "least_norm",
    "state_from_error",
]
