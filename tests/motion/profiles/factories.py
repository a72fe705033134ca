"""Motion profiles from (V, A, J) and from (V, A, J, T), shared by the tests of profiles."""

from qtraj.motion.profiles.s_curve import SCurve
from qtraj.motion.profiles.smooth_step import Cubic, Quintic, Septic
from qtraj.motion.profiles.time_optimal import TimeOptimal

FROM_LIMITS = {
    "time-optimal": lambda v, a, j: TimeOptimal(v, a),
    "bang-bang": lambda v, a, j: TimeOptimal(None, a),
    "s-curve": SCurve,
    "cubic": lambda v, a, j: Cubic(max_rate=v, max_acceleration=a),
    "quintic": lambda v, a, j: Quintic(max_rate=v, max_acceleration=a, max_jerk=j),
    "septic": lambda v, a, j: Septic(max_rate=v, max_acceleration=a, max_jerk=j),
}
IN_TIME = {
    "time-optimal": lambda v, a, j, T: TimeOptimal(v, a, duration=T),
    "s-curve": lambda v, a, j, T: SCurve(v, a, j, duration=T),
    "quintic": lambda v, a, j, T: Quintic(T, v, a, j),
}
