"""Attitude control after paper C: errors, laws, gains, the closed-form response, and the choices at the start."""

from qtraj.motion.control.baselines import GeometricFeedback, LogarithmicFeedback, QuaternionFeedback
from qtraj.motion.control.closed_form import ClosedMotion, closed_motion
from qtraj.motion.control.commands import body_command, body_correction, inertial_command, inertial_correction
from qtraj.motion.control.errors import error_angle, error_quaternion, error_rate, state_from_error
from qtraj.motion.control.gains import from_damping, from_settling_time, from_weights, rate_from_settling_time
from qtraj.motion.control.hysteresis import HystereticLaw
from qtraj.motion.control.laws import AbstractLaw, AccelerationLaw, RateLaw
from qtraj.motion.control.response import error_response, error_state, growth
from qtraj.motion.control.sheet import choose_sign, gibbs_gauge, least_norm, place

__all__ = [
    "AbstractLaw",
    "AccelerationLaw",
    "ClosedMotion",
    "GeometricFeedback",
    "HystereticLaw",
    "LogarithmicFeedback",
    "QuaternionFeedback",
    "RateLaw",
    "body_command",
    "body_correction",
    "choose_sign",
    "closed_motion",
    "error_angle",
    "error_quaternion",
    "error_rate",
    "error_response",
    "error_state",
    "from_damping",
    "from_settling_time",
    "from_weights",
    "gibbs_gauge",
    "growth",
    "inertial_command",
    "inertial_correction",
    "least_norm",
    "place",
    "rate_from_settling_time",
    "state_from_error",
]
