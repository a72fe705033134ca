"""qtraj: differentiable trajectories and orientation in JAX, for the positions and attitudes of vehicles.

Each public name is imported when it is first used, so that `import qtraj` is fast.
"""

import importlib
import warnings
from typing import TYPE_CHECKING, Any

from qtraj._version import __version__ as __version__
from qtraj.foundation import drawing as _drawing

if TYPE_CHECKING:  # for type checkers and editors; `as` marks a name as public
    from qtraj.algebra import (
        dual_quaternion as dual_quaternion,
        matrices as matrices,
        quaternion as quaternion,
        rotation as rotation,
    )
    from qtraj.batch.evaluate import evaluate as evaluate
    from qtraj.batch.table import Table as Table
    from qtraj.design.fitting.fit import fit as fit
    from qtraj.design.fitting.fit_route import fit_route as fit_route
    from qtraj.design.fitting.fitted import Fitted as Fitted
    from qtraj.design.fitting.fitted_route import FittedRoute as FittedRoute
    from qtraj.design.limits import Limits as Limits
    from qtraj.design.peaks import peak as peak
    from qtraj.design.proof.certificate import Certificate as Certificate
    from qtraj.design.proof.certify import certify as certify
    from qtraj.design.proof.route_certificate import RouteCertificate as RouteCertificate
    from qtraj.design.speed_profile import SpeedProfile as SpeedProfile, speed_profile as speed_profile
    from qtraj.design.timing.outcome import Retimed as Retimed
    from qtraj.design.timing.retime import retime as retime
    from qtraj.design.timing.timing import RetimedPath as RetimedPath, Timing as Timing
    from qtraj.design.tuning.outcome import Tuned as Tuned
    from qtraj.design.tuning.tune import tune as tune
    from qtraj.design.tuning_route.tune_route import tune_route as tune_route
    from qtraj.design.tuning_route.tuned_route import TunedRoute as TunedRoute
    from qtraj.foundation.compilation_cache import enable_compilation_cache as enable_compilation_cache
    from qtraj.foundation.outcome import ResultCode as ResultCode
    from qtraj.foundation.progress import Progress as Progress
    from qtraj.io import exchange as exchange
    from qtraj.io.dataset_file import load_dataset as load_dataset, save_dataset as save_dataset
    from qtraj.io.label import label as label
    from qtraj.io.stored import load as load
    from qtraj.io.track.attitude_angles import AttitudeAngles as AttitudeAngles
    from qtraj.io.track.tangent_plane import TangentPlane as TangentPlane
    from qtraj.io.track.track_file import read_track as read_track
    from qtraj.motion import control as control, dynamics as dynamics
    from qtraj.motion.attitude import AbstractProgram as AbstractProgram, Attitude as Attitude
    from qtraj.motion.attitude_residual import (
        AttitudeResidual as AttitudeResidual,
        compare_attitude as compare_attitude,
    )
    from qtraj.motion.control.baselines import (
        GeometricFeedback as GeometricFeedback,
        LogarithmicFeedback as LogarithmicFeedback,
        QuaternionFeedback as QuaternionFeedback,
    )
    from qtraj.motion.control.feedback_law import feedback_law as feedback_law
    from qtraj.motion.control.hysteresis import HystereticLaw as HystereticLaw
    from qtraj.motion.control.laws import AccelerationLaw as AccelerationLaw, RateLaw as RateLaw
    from qtraj.motion.control.response import error_response as error_response
    from qtraj.motion.manipulator.arm import Arm as Arm, Joint as Joint, stanford_arm as stanford_arm
    from qtraj.motion.manipulator.arm_motion import ArmMotion as ArmMotion
    from qtraj.motion.manipulator.inverse import Damping as Damping
    from qtraj.motion.manipulator.simulate_arm import simulate_arm as simulate_arm
    from qtraj.motion.pose.pose_law import (
        PoseLaw as PoseLaw,
        PoseProgram as PoseProgram,
        closed_pose as closed_pose,
        pose_error as pose_error,
    )
    from qtraj.motion.pose.pose_motion import PoseMotion as PoseMotion
    from qtraj.motion.pose.simulate_pose import simulate_pose as simulate_pose
    from qtraj.motion.profiles.cubic_spline import CubicSpline as CubicSpline
    from qtraj.motion.profiles.s_curve import SCurve as SCurve
    from qtraj.motion.profiles.slew_profile import slew_profile as slew_profile
    from qtraj.motion.profiles.smooth_step import Cubic as Cubic, Quintic as Quintic, Septic as Septic
    from qtraj.motion.profiles.time_optimal import TimeOptimal as TimeOptimal
    from qtraj.motion.programs.euler_turn import EulerTurn as EulerTurn, SlewSequence as SlewSequence
    from qtraj.motion.programs.frame_program import FrameProgram as FrameProgram
    from qtraj.motion.programs.rotation_minimizing import RotationMinimizing as RotationMinimizing
    from qtraj.motion.programs.slew_history import SlewHistory as SlewHistory, slew_history as slew_history
    from qtraj.motion.programs.slew_torque import (
        TorquePeak as TorquePeak,
        peak_torque as peak_torque,
        within_torque as within_torque,
    )
    from qtraj.motion.programs.slew_verdict import SlewVerdict as SlewVerdict, judge_slew as judge_slew
    from qtraj.motion.programs.table_program import TableProgram as TableProgram
    from qtraj.motion.propagation.gauss_legendre import GaussLegendre as GaussLegendre
    from qtraj.motion.propagation.magnus import Magnus as Magnus
    from qtraj.motion.propagation.propagate import (
        Propagation as Propagation,
        propagate as propagate,
        propagate_with_estimate as propagate_with_estimate,
    )
    from qtraj.motion.propagation.strapdown import propagate_samples as propagate_samples
    from qtraj.motion.rate_residual import RateResidual as RateResidual, compare_rates as compare_rates
    from qtraj.motion.simulation.actuator import Actuator as Actuator
    from qtraj.motion.simulation.assess_loop import assess_loop as assess_loop
    from qtraj.motion.simulation.body import ReactionWheels as ReactionWheels, RigidBody as RigidBody
    from qtraj.motion.simulation.body_motion import BodyMotion as BodyMotion
    from qtraj.motion.simulation.disturbance import (
        DisturbanceAcceleration as DisturbanceAcceleration,
        DisturbanceTorque as DisturbanceTorque,
        Sinusoid as Sinusoid,
    )
    from qtraj.motion.simulation.kinematics import integrate as integrate
    from qtraj.motion.simulation.loop_history import LoopHistory as LoopHistory, loop_history as loop_history
    from qtraj.motion.simulation.loop_verdict import LoopVerdict as LoopVerdict, judge_loop as judge_loop
    from qtraj.motion.simulation.open_loop import open_loop as open_loop
    from qtraj.motion.simulation.sensor import Gyros as Gyros, Sensor as Sensor
    from qtraj.motion.simulation.simulate import simulate as simulate
    from qtraj.motion.simulation.solution import Solution as Solution
    from qtraj.path.boundary import BoundaryState as BoundaryState
    from qtraj.path.boundary_problem import axis_between as axis_between
    from qtraj.path.change import PathChange as PathChange, compare_paths as compare_paths
    from qtraj.path.driving import Driving as Driving
    from qtraj.path.hodograph import AbstractHodograph as AbstractHodograph, Curve as Curve
    from qtraj.path.placement import Placement as Placement
    from qtraj.path.residual import Residual as Residual
    from qtraj.path.route import Route as Route
    from qtraj.path.route_nearest import Nearest as Nearest
    from qtraj.path.sample_times import sample_times as sample_times
    from qtraj.path.spiral_helix import SpiralHelix as SpiralHelix
    from qtraj.path.thrust_aligned import ThrustAligned as ThrustAligned
    from qtraj.path.track import Track as Track
    from qtraj.path.trihedral import (
        Natural as Natural,
        Trihedral as Trihedral,
        Upright as Upright,
        trihedral as trihedral,
    )
    from qtraj.path.vehicle import Vehicle as Vehicle

_HOMES = {
    "qtraj.batch.evaluate": ("evaluate",),
    "qtraj.batch.table": ("Table",),
    "qtraj.design.fitting.fit": ("fit",),
    "qtraj.design.fitting.fit_route": ("fit_route",),
    "qtraj.design.fitting.fitted": ("Fitted",),
    "qtraj.design.fitting.fitted_route": ("FittedRoute",),
    "qtraj.design.limits": ("Limits",),
    "qtraj.design.peaks": ("peak",),
    "qtraj.design.proof.certificate": ("Certificate",),
    "qtraj.design.proof.certify": ("certify",),
    "qtraj.design.proof.route_certificate": ("RouteCertificate",),
    "qtraj.design.speed_profile": ("SpeedProfile", "speed_profile"),
    "qtraj.design.timing.outcome": ("Retimed",),
    "qtraj.design.timing.retime": ("retime",),
    "qtraj.design.timing.timing": ("RetimedPath", "Timing"),
    "qtraj.design.tuning.outcome": ("Tuned",),
    "qtraj.design.tuning.tune": ("tune",),
    "qtraj.design.tuning_route.tune_route": ("tune_route",),
    "qtraj.design.tuning_route.tuned_route": ("TunedRoute",),
    "qtraj.foundation.compilation_cache": ("enable_compilation_cache",),
    "qtraj.foundation.outcome": ("ResultCode",),
    "qtraj.foundation.progress": ("Progress",),
    "qtraj.io.track.attitude_angles": ("AttitudeAngles",),
    "qtraj.io.dataset_file": ("load_dataset", "save_dataset"),
    "qtraj.io.label": ("label",),
    "qtraj.io.stored": ("load",),
    "qtraj.io.track.tangent_plane": ("TangentPlane",),
    "qtraj.io.track.track_file": ("read_track",),
    "qtraj.motion.attitude": ("AbstractProgram", "Attitude"),
    "qtraj.motion.attitude_residual": ("AttitudeResidual", "compare_attitude"),
    "qtraj.motion.control.baselines": ("GeometricFeedback", "LogarithmicFeedback", "QuaternionFeedback"),
    "qtraj.motion.control.feedback_law": ("feedback_law",),
    "qtraj.motion.control.hysteresis": ("HystereticLaw",),
    "qtraj.motion.control.laws": ("AccelerationLaw", "RateLaw"),
    "qtraj.motion.control.response": ("error_response",),
    "qtraj.motion.manipulator.arm": ("Arm", "Joint", "stanford_arm"),
    "qtraj.motion.manipulator.arm_motion": ("ArmMotion",),
    "qtraj.motion.manipulator.inverse": ("Damping",),
    "qtraj.motion.manipulator.simulate_arm": ("simulate_arm",),
    "qtraj.motion.pose.pose_law": ("PoseLaw", "PoseProgram", "closed_pose", "pose_error"),
    "qtraj.motion.pose.pose_motion": ("PoseMotion",),
    "qtraj.motion.pose.simulate_pose": ("simulate_pose",),
    "qtraj.motion.profiles.cubic_spline": ("CubicSpline",),
    "qtraj.motion.profiles.s_curve": ("SCurve",),
    "qtraj.motion.profiles.slew_profile": ("slew_profile",),
    "qtraj.motion.profiles.smooth_step": ("Cubic", "Quintic", "Septic"),
    "qtraj.motion.profiles.time_optimal": ("TimeOptimal",),
    "qtraj.motion.programs.euler_turn": ("EulerTurn", "SlewSequence"),
    "qtraj.motion.programs.frame_program": ("FrameProgram",),
    "qtraj.motion.programs.rotation_minimizing": ("RotationMinimizing",),
    "qtraj.motion.programs.slew_history": ("SlewHistory", "slew_history"),
    "qtraj.motion.programs.slew_torque": ("TorquePeak", "peak_torque", "within_torque"),
    "qtraj.motion.programs.slew_verdict": ("SlewVerdict", "judge_slew"),
    "qtraj.motion.programs.table_program": ("TableProgram",),
    "qtraj.motion.rate_residual": ("RateResidual", "compare_rates"),
    "qtraj.motion.propagation.gauss_legendre": ("GaussLegendre",),
    "qtraj.motion.propagation.magnus": ("Magnus",),
    "qtraj.motion.propagation.propagate": ("Propagation", "propagate", "propagate_with_estimate"),
    "qtraj.motion.propagation.strapdown": ("propagate_samples",),
    "qtraj.motion.simulation.actuator": ("Actuator",),
    "qtraj.motion.simulation.assess_loop": ("assess_loop",),
    "qtraj.motion.simulation.body": ("ReactionWheels", "RigidBody"),
    "qtraj.motion.simulation.body_motion": ("BodyMotion",),
    "qtraj.motion.simulation.disturbance": ("DisturbanceAcceleration", "DisturbanceTorque", "Sinusoid"),
    "qtraj.motion.simulation.kinematics": ("integrate",),
    "qtraj.motion.simulation.loop_history": ("LoopHistory", "loop_history"),
    "qtraj.motion.simulation.loop_verdict": ("LoopVerdict", "judge_loop"),
    "qtraj.motion.simulation.open_loop": ("open_loop",),
    "qtraj.motion.simulation.sensor": ("Gyros", "Sensor"),
    "qtraj.motion.simulation.simulate": ("simulate",),
    "qtraj.motion.simulation.solution": ("Solution",),
    "qtraj.path.boundary": ("BoundaryState",),
    "qtraj.path.boundary_problem": ("axis_between",),
    "qtraj.path.change": ("PathChange", "compare_paths"),
    "qtraj.path.driving": ("Driving",),
    "qtraj.path.hodograph": ("AbstractHodograph", "Curve"),
    "qtraj.path.placement": ("Placement",),
    "qtraj.path.residual": ("Residual",),
    "qtraj.path.route": ("Route",),
    "qtraj.path.route_nearest": ("Nearest",),
    "qtraj.path.sample_times": ("sample_times",),
    "qtraj.path.spiral_helix": ("SpiralHelix",),
    "qtraj.path.thrust_aligned": ("ThrustAligned",),
    "qtraj.path.track": ("Track",),
    "qtraj.path.trihedral": ("Natural", "Trihedral", "Upright", "trihedral"),
    "qtraj.path.vehicle": ("Vehicle",),
}
"""The module of each public name; the same as in the imports above, for use at run time."""

_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}

_PACKAGES = ("algebra", "batch", "cli", "design", "foundation", "io", "motion", "path", "scenario", "viz")

_MODULES = {
    "control": "qtraj.motion.control",
    "dynamics": "qtraj.motion.dynamics",
    "dual_quaternion": "qtraj.algebra.dual_quaternion",
    "exchange": "qtraj.io.exchange",
    "matrices": "qtraj.algebra.matrices",
    "quaternion": "qtraj.algebra.quaternion",
    "rotation": "qtraj.algebra.rotation",
    **{name: f"qtraj.{name}" for name in _PACKAGES},
}
"""Public names that are modules; packages are also available as attributes, for example `qtraj.path.hodograph`."""

if not TYPE_CHECKING:  # type checkers take the names from the imports above
    __all__ = sorted(["__version__", *_HOME_OF, *_MODULES.keys() - {*_PACKAGES}])


_RENAMED = {"TurnChain": "SlewSequence"}
"""Former public names and the present ones; the former names issue a warning until version 1.0."""


def __getattr__(name: str) -> Any:
    if name in _RENAMED:
        now = _RENAMED[name]
        warnings.warn(f"qtraj.{name} is now called qtraj.{now}", DeprecationWarning, stacklevel=2)
        return __getattr__(now)
    if name in _HOME_OF:
        value = getattr(importlib.import_module(_HOME_OF[name]), name)
    elif name in _MODULES:
        value = importlib.import_module(_MODULES[name])
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value  # later accesses do not call this function
    return value


def __dir__() -> list[str]:
    return sorted({"__version__", *_HOME_OF, *_MODULES.keys() - {*_PACKAGES}})


# Registered here because `plot()` of results in lower layers needs this module, and those layers must not import it.
_drawing.set_plot_module("qtraj.viz.plots")
