"""The public names and their modules; read at run time, too, by `__init__.py`."""

from . import sweeps as sweeps
from .algebra import (
    dual_quaternion as dual_quaternion,
    matrices as matrices,
    quaternion as quaternion,
    rotation as rotation,
)
from .batch.evaluate import evaluate as evaluate
from .batch.table import Table as Table
from .design.along import Along as Along
from .design.by_speed import BySpeed as BySpeed
from .design.ellipse import Ellipse as Ellipse
from .design.fitting.fit import fit as fit
from .design.fitting.fit_route import fit_route as fit_route
from .design.fitting.fitted import Fitted as Fitted
from .design.fitting.fitted_route import FittedRoute as FittedRoute
from .design.limits import Limits as Limits
from .design.obstacles.ball import Ball as Ball
from .design.obstacles.clearance import clearance as clearance
from .design.obstacles.convex_polygon import ConvexPolygon as ConvexPolygon
from .design.obstacles.cylinder import Cylinder as Cylinder
from .design.obstacles.ellipsoid import Ellipsoid as Ellipsoid
from .design.obstacles.half_space import HalfSpace as HalfSpace
from .design.peaks import peak as peak
from .design.proof.certificate import Certificate as Certificate
from .design.proof.certify import certify as certify
from .design.proof.route_certificate import RouteCertificate as RouteCertificate
from .design.regions import Regions as Regions
from .design.robust.box import Box as Box
from .design.robust.box_certificate import BoxCertificate as BoxCertificate
from .design.robust.box_outcome import BoxTuned as BoxTuned
from .design.robust.certify_box import certify_box as certify_box
from .design.robust.outcome import RobustTuned as RobustTuned
from .design.robust.robust_tune import robust_tune as robust_tune
from .design.robust.robust_tune_route import robust_tune_route as robust_tune_route
from .design.robust.spread import Spread as Spread
from .design.speed_profile import SpeedProfile as SpeedProfile, speed_profile as speed_profile
from .design.timing.outcome import Retimed as Retimed
from .design.timing.retime import retime as retime
from .design.timing.timing import RetimedPath as RetimedPath, Timing as Timing
from .design.timing.together import retime_together as retime_together
from .design.tuning.outcome import Tuned as Tuned
from .design.tuning.tune import tune as tune
from .design.tuning_route.tune_route import tune_route as tune_route
from .design.tuning_route.tuned_route import TunedRoute as TunedRoute
from .design.uncertainty.margin_uncertainty import (
    MarginUncertainty as MarginUncertainty,
    margin_uncertainty as margin_uncertainty,
)
from .design.uncertainty.uncertainty import Uncertainty as Uncertainty, uncertainty as uncertainty
from .foundation.compilation_cache import enable_compilation_cache as enable_compilation_cache
from .foundation.document import storable as storable
from .foundation.in_blocks import in_blocks as in_blocks
from .foundation.outcome import ResultCode as ResultCode
from .foundation.progress import Progress as Progress
from .io import exchange as exchange
from .io.dataset_file import load_dataset as load_dataset, save_dataset as save_dataset
from .io.label import label as label
from .io.road_file import read_road as read_road
from .io.shape.shape_file import read_shape as read_shape
from .io.stored import load as load
from .io.track.attitude_angles import AttitudeAngles as AttitudeAngles
from .io.track.tangent_plane import TangentPlane as TangentPlane
from .io.track.track_file import read_track as read_track
from .motion import control as control, dynamics as dynamics, torques as torques
from .motion.attitude import AbstractProgram as AbstractProgram, Attitude as Attitude
from .motion.attitude_residual import (
    AttitudeResidual as AttitudeResidual,
    compare_attitude as compare_attitude,
)
from .motion.control.baselines import (
    GeometricFeedback as GeometricFeedback,
    LogarithmicFeedback as LogarithmicFeedback,
    QuaternionFeedback as QuaternionFeedback,
)
from .motion.control.feedback_law import feedback_law as feedback_law
from .motion.control.hysteresis import HystereticLaw as HystereticLaw
from .motion.control.laws import AccelerationLaw as AccelerationLaw, RateLaw as RateLaw
from .motion.control.response import error_response as error_response
from .motion.manipulator.arm import Arm as Arm, Joint as Joint, stanford_arm as stanford_arm
from .motion.manipulator.arm_motion import ArmMotion as ArmMotion
from .motion.manipulator.inverse import Damping as Damping
from .motion.manipulator.simulate_arm import simulate_arm as simulate_arm
from .motion.pose.pose_law import (
    PoseLaw as PoseLaw,
    PoseProgram as PoseProgram,
    closed_pose as closed_pose,
    pose_error as pose_error,
)
from .motion.pose.pose_motion import PoseMotion as PoseMotion
from .motion.pose.simulate_pose import simulate_pose as simulate_pose
from .motion.profiles.function_profile import FunctionProfile as FunctionProfile
from .motion.profiles.multi_knot_cubic import MultiKnotCubic as MultiKnotCubic
from .motion.profiles.profile import AbstractProfile as AbstractProfile
from .motion.profiles.s_curve import SCurve as SCurve
from .motion.profiles.slew_profile import slew_profile as slew_profile
from .motion.profiles.smooth_step import Cubic as Cubic, Quintic as Quintic, Septic as Septic
from .motion.profiles.time_optimal import TimeOptimal as TimeOptimal
from .motion.programs.euler_turn import EulerTurn as EulerTurn, SlewSequence as SlewSequence
from .motion.programs.frame_program import FrameProgram as FrameProgram
from .motion.programs.program_sequence import ProgramSequence as ProgramSequence
from .motion.programs.rotation_minimizing import RotationMinimizing as RotationMinimizing
from .motion.programs.slew_history import SlewHistory as SlewHistory, slew_history as slew_history
from .motion.programs.slew_torque import (
    TorquePeak as TorquePeak,
    peak_torque as peak_torque,
    within_torque as within_torque,
)
from .motion.programs.slew_verdict import SlewVerdict as SlewVerdict, judge_slew as judge_slew
from .motion.programs.spin import Spin as Spin
from .motion.programs.table_program import TableProgram as TableProgram
from .motion.propagation.gauss_legendre import GaussLegendre as GaussLegendre
from .motion.propagation.magnus import Magnus as Magnus
from .motion.propagation.propagate import (
    Propagation as Propagation,
    propagate as propagate,
    propagate_with_estimate as propagate_with_estimate,
)
from .motion.propagation.strapdown import propagate_samples as propagate_samples
from .motion.rate_residual import RateResidual as RateResidual, compare_rates as compare_rates
from .motion.simulation.actuator import Actuator as Actuator
from .motion.simulation.assess_loop import assess_loop as assess_loop
from .motion.simulation.body import ReactionWheels as ReactionWheels, RigidBody as RigidBody
from .motion.simulation.body_motion import BodyMotion as BodyMotion
from .motion.simulation.disturbance import (
    AbstractDisturbance as AbstractDisturbance,
    DisturbanceAcceleration as DisturbanceAcceleration,
    DisturbanceTorque as DisturbanceTorque,
    Sinusoid as Sinusoid,
)
from .motion.simulation.kinematics import integrate as integrate
from .motion.simulation.loop_history import LoopHistory as LoopHistory, loop_history as loop_history
from .motion.simulation.loop_verdict import LoopVerdict as LoopVerdict, judge_loop as judge_loop
from .motion.simulation.monte_carlo import monte_carlo as monte_carlo
from .motion.simulation.open_loop import open_loop as open_loop
from .motion.simulation.sensor import AbstractSensor as AbstractSensor, Gyros as Gyros, Sensor as Sensor
from .motion.simulation.simulate import simulate as simulate
from .motion.simulation.solution import Solution as Solution
from .motion.simulation.study import Study as Study
from .path.axes_frame import AxesFrame as AxesFrame
from .path.boundary import BoundaryState as BoundaryState
from .path.boundary_problem import axis_between as axis_between
from .path.change import PathChange as PathChange, compare_paths as compare_paths
from .path.curve import Curve as Curve
from .path.driving import Driving as Driving
from .path.hodograph import AbstractHodograph as AbstractHodograph
from .path.nearest import Nearest as Nearest
from .path.own_motion import sqrt as sqrt
from .path.own_quantity import Quantity as Quantity
from .path.placement import Placement as Placement
from .path.residual import Residual as Residual
from .path.road import Road as Road
from .path.route import Route as Route
from .path.sample_times import sample_times as sample_times
from .path.shape import Shape as Shape
from .path.spiral_helix import SpiralHelix as SpiralHelix
from .path.thrust_aligned import ThrustAligned as ThrustAligned
from .path.track import Track as Track
from .path.trihedral import (
    AbstractFrame as AbstractFrame,
    Natural as Natural,
    Trihedral as Trihedral,
    Upright as Upright,
    trihedral as trihedral,
)
from .path.vehicle import Vehicle as Vehicle
from .sweeps.atlas.atlas import atlas as atlas
from .sweeps.atlas.axis import AtlasAxis as AtlasAxis
from .sweeps.atlas.outcome import Atlas as Atlas
from .sweeps.atlas.tuned_points import tuned_points as tuned_points
from .sweeps.sweep import sweep as sweep
from .sweeps.swept import Swept as Swept
