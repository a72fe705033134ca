"""qtraj: where a vehicle must be, and how it must turn. Differentiable trajectories and orientation in JAX."""

from qtraj._version import __version__
from qtraj.algebra import quaternion, rotation
from qtraj.batch.evaluate import evaluate
from qtraj.batch.table import Table
from qtraj.design.fitting.fit import fit
from qtraj.design.limits import Limits
from qtraj.design.magnitudes import peak
from qtraj.design.proof.certificate import Certificate
from qtraj.design.proof.certify import certify
from qtraj.design.tuning.outcome import Tuned
from qtraj.design.tuning.tune import tune
from qtraj.foundation.document import load
from qtraj.io import exchange
from qtraj.io.dataset_file import load_dataset, save_dataset
from qtraj.io.label import label
from qtraj.io.track_file import read_track
from qtraj.motion import control, dynamics
from qtraj.motion.attitude import AbstractProgram, Attitude
from qtraj.motion.control.baselines import GeometricFeedback, LogarithmicFeedback, QuaternionFeedback
from qtraj.motion.control.laws import AccelerationLaw, RateLaw
from qtraj.motion.control.response import error_response
from qtraj.motion.profiles.s_curve import SCurve
from qtraj.motion.profiles.smooth_step import Cubic, Quintic, Septic
from qtraj.motion.profiles.time_optimal import TimeOptimal
from qtraj.motion.programs.euler_turn import EulerTurn, TurnChain
from qtraj.motion.programs.frame_program import FrameProgram
from qtraj.motion.programs.rotation_minimizing import RotationMinimizing
from qtraj.motion.programs.table_program import TableProgram
from qtraj.motion.propagation.gauss_legendre import GaussLegendre
from qtraj.motion.propagation.magnus import Magnus
from qtraj.motion.propagation.propagate import Propagation, propagate, propagate_with_estimate
from qtraj.motion.propagation.strapdown import propagate_samples
from qtraj.motion.simulation.actuator import Actuator
from qtraj.motion.simulation.disturbance import DisturbanceAcceleration, DisturbanceTorque, Sinusoid
from qtraj.motion.simulation.kinematics import integrate
from qtraj.motion.simulation.sensor import Gyros, Sensor
from qtraj.motion.simulation.simulate import simulate
from qtraj.motion.simulation.solution import Solution
from qtraj.path.boundary import BoundaryState
from qtraj.path.hodograph import AbstractHodograph, Curve
from qtraj.path.placement import Placement
from qtraj.path.residual import Residual
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.track import Track
from qtraj.path.trihedral import Natural, Trihedral, Upright, trihedral

__all__ = [
    "AbstractHodograph",
    "AbstractProgram",
    "AccelerationLaw",
    "Actuator",
    "Attitude",
    "BoundaryState",
    "Certificate",
    "Cubic",
    "Curve",
    "DisturbanceAcceleration",
    "DisturbanceTorque",
    "EulerTurn",
    "FrameProgram",
    "GaussLegendre",
    "GeometricFeedback",
    "Gyros",
    "Limits",
    "LogarithmicFeedback",
    "Magnus",
    "Natural",
    "Placement",
    "Propagation",
    "QuaternionFeedback",
    "Quintic",
    "RateLaw",
    "Residual",
    "RotationMinimizing",
    "SCurve",
    "Sensor",
    "Septic",
    "Sinusoid",
    "Solution",
    "SpiralHelix",
    "Table",
    "TableProgram",
    "TimeOptimal",
    "Track",
    "Trihedral",
    "Tuned",
    "TurnChain",
    "Upright",
    "__version__",
    "certify",
    "control",
    "dynamics",
    "error_response",
    "evaluate",
    "exchange",
    "fit",
    "integrate",
    "label",
    "load",
    "load_dataset",
    "peak",
    "propagate",
    "propagate_samples",
    "propagate_with_estimate",
    "quaternion",
    "read_track",
    "rotation",
    "save_dataset",
    "simulate",
    "trihedral",
    "tune",
]
