"""Attitude control of paper C: errors, laws, gains, closed-form responses, and the initial sign and norm of λ."""

import warnings
from typing import Any

from qtraj.motion.control.baselines import GeometricFeedback, LogarithmicFeedback, QuaternionFeedback
from qtraj.motion.control.closed_form import ClosedMotion, closed_motion
from qtraj.motion.control.commands import body_command, body_correction, inertial_command, inertial_correction
from qtraj.motion.control.errors import error_angle, error_quaternion, error_rate, state_from_error
from qtraj.motion.control.feedback_law import feedback_law
from qtraj.motion.control.gains import from_damping, from_settling_time, from_weights, rate_from_settling_time
from qtraj.motion.control.hysteresis import HystereticLaw
from qtraj.motion.control.laws import AbstractLaw, AccelerationLaw, RateLaw
from qtraj.motion.control.quaternion_sign import choose_sign, gibbs_normalization, least_norm, place
from qtraj.motion.control.response import error_response, error_state, spectral_abscissa

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
    "feedback_law",
    "from_damping",
    "from_settling_time",
    "from_weights",
    "gibbs_normalization",
    "inertial_command",
    "inertial_correction",
    "least_norm",
    "place",
    "rate_from_settling_time",
    "spectral_abscissa",
    "state_from_error",
]

_RENAMED = {"gibbs_gauge": "gibbs_normalization", "growth": "spectral_abscissa"}
"""Deprecated public names and their replacements; until version 1.0 the old names emit a warning."""


def __dir__() -> list[str]:
    return __all__


def __getattr__(name: str) -> Any:
    if name not in _RENAMED:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    present = _RENAMED[name]
    warnings.warn(f"qtraj.control.{name} is now called qtraj.control.{present}", DeprecationWarning, stacklevel=2)
    return globals()[present]
