"""The arguments, in integers, with which `test_every_call.py` calls each public function, class and method of arrays.

A new public name needs a row in `CALLS`, or a reason in `OTHERS` why kinds and shapes of arguments do not apply to it.
"""

import numpy as np

import qtraj as qt
from qtraj import control, dynamics, exchange, torques

ONE, TURNED, RATE = [1, 0, 0, 0], [2, 1, 0, 1], [0, 1, 0, 2]
QUATERNIONS = np.array(TURNED, float), np.array(RATE, float)
PATH = qt.SpiralHelix([10.0, 0.5], [0.0, 1.0, 0.1], [0.0, 0.5, 0.2], 4.0)
STATES = np.array([[0.0, 0, 0], [3, 1, 0], [5, 4, 1]]), np.array([[3.0, 0, 0], [3, 2, 1], [2, 4, 1]])
ROUTE = qt.Route([0.0, 1.0, 2.0], *STATES, np.zeros((3, 3)))
SLEW = qt.EulerTurn(ONE, [1, 1, 0, 0], qt.Quintic(duration=2.0))
FAST = qt.EulerTurn(ONE, [1, 1, 0, 0], qt.TimeOptimal(1.0, 2.0))
FRAME = qt.FrameProgram(PATH)
LAW, RATE_LAW = qt.AccelerationLaw(3.0, 2.0), qt.RateLaw(2.0)
REFERENCE = FRAME(1.0)
INERTIA = [3.0, 4.0, 5.0]
BODY = qt.RigidBody(INERTIA, wheels=qt.ReactionWheels(np.eye(3), max_torque=9.0, max_momentum=9.0))
ORBIT = torques.CircularOrbit(3.0, mu=2.0)
AIR = torques.AerodynamicTorque([0.0, 0, 1], 2.0, 1.0, ORBIT.velocity)
DIPOLE = torques.MagneticDipole([1.0, 0, 1], [1.0, 2, 3])
ARM = qt.stanford_arm()
POSE = qt.PoseProgram(PATH, FRAME)
SPEED = {"speed": 4.0, "acceleration": 2.0}
RETIMED = qt.retime(PATH, qt.Limits(**SPEED), start_speed=0.0, end_speed=0.0).path


def motion(attitude):
    """The arrays of an attitude."""
    return attitude.quaternion, attitude.rate, attitude.acceleration


def law_of(law):
    """A law as a function of quaternion and rate."""
    return (lambda q, w: law(REFERENCE, q, w)), TURNED, RATE


def profile_of(law):
    """The angle, the rate and the acceleration of a slew by 2 rad, of a law with these limits."""
    return lambda *limits: law(*limits).profile(2.0).derivatives(0.6, 2)


def end(path):
    """Position and velocity at an instant."""
    return path.derivatives(0.5, 1)


def states(position, velocity, end_position, end_velocity):
    """Two boundary states."""
    return qt.BoundaryState(position, velocity), qt.BoundaryState(end_position, end_velocity)


def frame_of(tri):
    """The arrays of a trihedral."""
    return tri.quaternion(), tri.rate, tri.acceleration, tri.curvature


def clearance_from(obstacle):
    """The distance of a point from an obstacle, of its numbers."""
    return lambda *x: qt.clearance(PATH, 1.0, qt.Limits(keep_out=[obstacle(*x)]))["keep_out[0]"]


SHAPE = np.array([[4.0, 1, 0], [1, 3, 1], [0, 1, 2]])
VELOCITIES = np.array([1.0, 5, 0]), np.array([-6.0, 2, 1])
TWO_STATES = [5, 0, 0], [0, 4, 1], [0, 6, 2], [-4, 1, 1]
HELIX = [10], [0, 1], [0, 2], 4
SAMPLES = [0, 1, 2, 3], [[0, 0, 1], [0, 1, 1], [1, 1, 1], [1, 0, 1]], ONE

CALLS = {
    # paths
    "SpiralHelix": (lambda *x: end(qt.SpiralHelix(*x)), *HELIX),
    "SpiralHelix.hermite": (lambda *x: end(qt.SpiralHelix.hermite(*states(*x[:4]), x[4])), *TWO_STATES, 3),
    "SpiralHelix.between": (lambda *x: end(qt.SpiralHelix.between(*states(*x[:4]), x[4])), *TWO_STATES, 3),
    "SpiralHelix.from_boundary": (
        lambda w: end(
            qt.SpiralHelix.from_boundary(*states([5, 0, 0], VELOCITIES[0] * w, [0, 6, 2], VELOCITIES[1] * w))
        ),
        1,
    ),
    "SpiralHelix.derivatives": (lambda t: PATH.derivatives(t, 4), 2),
    "SpiralHelix.rotating_derivatives": (lambda t: PATH.rotating_derivatives(t, 2), 2),
    "AbstractHodograph.__call__": (PATH, 2),
    **{
        f"AbstractHodograph.{name}": (getattr(PATH, name), 2)
        for name in ("position", "velocity", "acceleration", "jerk", "arc_length", "time_at")
    },
    "AbstractHodograph.state": (lambda t: (PATH.state(t).position, PATH.state(t).velocity), 2),
    "AbstractHodograph.nearest": (PATH.nearest, [9, 3, 1]),
    "Route": (lambda *x: qt.Route(*x, np.zeros((3, 3))).derivatives(0.5, 3), [0, 1, 2], *(x.tolist() for x in STATES)),
    "Route.derivatives": (lambda t: ROUTE.derivatives(t, 4), 1),
    "Route.arc_length": (ROUTE.arc_length, 1),
    "Route.time_at": (ROUTE.time_at, 3),
    "Route.nearest": (ROUTE.nearest, [4, 1, 1]),
    "Route.index": (ROUTE.index, 1),
    "RetimedPath.derivatives": (lambda t: RETIMED.derivatives(t, 2), 2),
    "Timing.motion": (lambda t: RETIMED.timing.motion(t), 2),
    "Timing.parameter": (lambda t: RETIMED.timing.parameter(t), 2),
    "Timing.time": (lambda u: RETIMED.timing.time(u), 2),
    "Timing.squared_speed": (lambda u: RETIMED.timing.squared_speed(u), 2),
    "BoundaryState": (lambda r, v, a: vars(qt.BoundaryState(r, v, a)), [5, 0, 0], [0, 4, 1], [1, 2, 3]),
    "Placement": (lambda r, q: qt.Placement(r, q).to_world(np.array([1.0, 2, 3])), [1, 2, 3], TURNED),
    "Placement.to_local": (qt.Placement([1.0, 2, 3], TURNED).to_local, [3, 1, 2]),
    "Placement.to_world": (qt.Placement([1.0, 2, 3], TURNED).to_world, [3, 1, 2]),
    "axis_between": (lambda *x: qt.axis_between(*states(*x)).origin, *TWO_STATES),
    "trihedral": (lambda t: frame_of(qt.trihedral(PATH, t)), 2),
    **{
        f"Trihedral.{name}": (lambda t, name=name: getattr(qt.trihedral(PATH, t, qt.Upright()), name)(), 2)
        for name in ("dcm", "gibbs", "quaternion")
    },
    "Trihedral.in_axes": (lambda t: qt.trihedral(PATH, t).in_axes("inertial").rate, 2),
    "Upright": (lambda up: frame_of(qt.trihedral(PATH, 1.0, qt.Upright(up))), [1, 0, 3]),
    "ThrustAligned": (lambda *x: frame_of(qt.trihedral(PATH, 1.0, qt.ThrustAligned(*x))), 1, 9),
    "evaluate": (lambda t: qt.evaluate(PATH, t, ["position", "curvature"]).values, [1, 2, 3]),
    "peak": (lambda *x: qt.peak(qt.SpiralHelix(*x, 4.0), "lateral_acceleration")[1], [10, 1], [0, 1], [0, 2]),
    "Limits": (lambda v, a: qt.Limits(speed=v, acceleration=a).margins(PATH, 1.0), 12, 9),
    "Limits.margins": (lambda t: qt.Limits(**SPEED).margins(PATH, t), 2),
    "Limits.values": (lambda t: qt.Limits(**SPEED).values(PATH, t), 2),
    "Ball": (clearance_from(qt.Ball), [3, 1, 2], 2),
    "Cylinder": (clearance_from(qt.Cylinder), [3, 1, 2], [1, 2, 0], 2),
    "Ellipsoid": (clearance_from(lambda c, x: qt.Ellipsoid(c, x * SHAPE)), [3, 1, 2], 2),
    "HalfSpace": (clearance_from(qt.HalfSpace), [0, 1, 2], 3),
    "ConvexPolygon": (clearance_from(qt.ConvexPolygon), [[0, 0], [4, 0], [5, 3], [0, 4]]),
    "clearance": (lambda t: qt.clearance(PATH, t, qt.Limits(keep_out=[qt.Ball([3.0, 1, 2], 2.0)])), 2),
    "Along": (lambda s, v: qt.Along(s, v, kind="linear").at(1.5), [0, 1, 3], [5, 4, 2]),
    "Along.at": (qt.Along([0.0, 1, 3], [5.0, 4, 2], kind="linear").at, 2),
    "BySpeed.at": (qt.BySpeed([0.0, 10, 30], upper=[3.0, 3, 1]).at, 20),
    "Vehicle": (
        lambda *x: qt.peak(PATH, "power", vehicle=qt.Vehicle(x[0], drag_area=x[1], gravity=x[2]))[1],
        *(900, 1, 10),
    ),
    "Vehicle.inertia_in_frame": (lambda m, J: qt.Vehicle(m, J).inertia_in_frame(), 900, [3, 4, 5]),
    # attitudes
    "Attitude": (lambda *x: motion(qt.Attitude(*x).in_axes("inertial")), TURNED, [1, 2, 0], [0, 1, 3]),
    "Attitude.in_axes": (lambda *x: motion(qt.Attitude(*x).in_axes("inertial")), TURNED, [1, 2, 0], [0, 1, 3]),
    "AbstractProgram.at": (lambda t: motion(SLEW.at(t, "inertial")), 1),
    "EulerTurn": (lambda a, b: motion(qt.EulerTurn(a, b, SLEW.law)(0.6)), ONE, TURNED),
    "EulerTurn.__call__": (lambda t: motion(SLEW(t)), 1),
    "EulerTurn.about": (
        lambda e, angle, q: motion(qt.EulerTurn.about(e, angle, q, SLEW.law, "inertial")(0.6)),
        *([0, 1, 2], 3, TURNED),
    ),
    "EulerTurn.axis": (lambda a, b: qt.EulerTurn(a, b, SLEW.law).axis(), ONE, TURNED),
    "SlewSequence": (lambda q: motion(qt.SlewSequence(q, SLEW.law)(2.6)), [ONE, [1, 1, 0, 0], TURNED]),
    "SlewSequence.__call__": (lambda t: motion(qt.SlewSequence([ONE, [1, 1, 0, 0], TURNED], SLEW.law)(t)), 3),
    "Spin": (lambda w, T, q: motion(qt.Spin(w, T, q, "inertial")(0.6)), [0, 1, 2], 3, TURNED),
    "Spin.__call__": (lambda t: motion(qt.Spin([0.0, 1, 2], 3.0)(t)), 1),
    "ProgramSequence.__call__": (lambda t: motion(qt.ProgramSequence([SLEW, qt.Spin([0, 0, 0], 2.0, SLEW.end)])(t)), 1),
    "TableProgram": (
        lambda q: motion(qt.TableProgram([0.0, 1.0, 3.0], q)(0.6)),
        [ONE, [3, 1, 0, 0], TURNED],
    ),
    "TableProgram.__call__": (lambda t: motion(qt.TableProgram([0, 1, 3], [ONE, [3, 1, 0, 0], TURNED])(t)), 2),
    "FrameProgram.__call__": (lambda t: motion(FRAME(t)), 2),
    "PoseProgram.__call__": (lambda t: (POSE(t)[0], motion(POSE(t)[1])), 2),
    "PoseProgram.dual": (POSE.dual, 2),
    "RotationMinimizing": (
        lambda n: qt.FrameProgram(PATH, qt.RotationMinimizing(n))(0.6).quaternion,
        [1, 2, 0],
    ),
    "TimeOptimal": (profile_of(qt.TimeOptimal), 1, 2),
    "SCurve": (profile_of(qt.SCurve), 1, 2, 8),
    "Cubic": (profile_of(qt.Cubic), 3),
    "Quintic": (profile_of(qt.Quintic), 3),
    "Septic": (profile_of(qt.Septic), 3),
    "MultiKnotCubic": (profile_of(qt.MultiKnotCubic), 5, 2, 1),
    "AbstractProfile.profile": (lambda angle: qt.SCurve(1.0, 2.0, 8.0).profile(angle).derivatives(0.6, 2), 2),
    "slew_profile": (
        lambda v, a: qt.slew_profile(max_rate=v, max_acceleration=a).profile(2.0).derivatives(0.6, 1),
        *(1, 2),
    ),
    "propagate_samples": (qt.propagate_samples, *SAMPLES),
    "propagate": (lambda q, t: qt.propagate(lambda t: np.array([0.0, 0.3, 0.1]) * (1 + t), q, t), TURNED, [0, 1, 3]),
    "propagate_with_estimate": (
        lambda q, t: qt.propagate_with_estimate(lambda t: np.array([0.0, 0.3, 0.1]) * t, q, t).quaternion,
        *(TURNED, [0, 1, 3]),
    ),
    # control
    "AccelerationLaw": (lambda k1, k2: qt.AccelerationLaw(k1, k2)(REFERENCE, *QUATERNIONS), 3, [1, 2, 2, 2]),
    "RateLaw": (lambda k: qt.RateLaw(k)(REFERENCE, QUATERNIONS[0]), 3),
    "QuaternionFeedback": (lambda *k: qt.QuaternionFeedback(*k)(REFERENCE, *QUATERNIONS), 3, 2),
    "GeometricFeedback": (lambda *k: qt.GeometricFeedback(*k)(REFERENCE, *QUATERNIONS), 3, 2),
    "LogarithmicFeedback": (lambda *k: qt.LogarithmicFeedback(*k)(REFERENCE, *QUATERNIONS), 3, 2),
    "AccelerationLaw.__call__": law_of(LAW),
    "RateLaw.__call__": law_of(RATE_LAW),
    "QuaternionFeedback.__call__": law_of(qt.QuaternionFeedback(3.0, 2.0)),
    "GeometricFeedback.__call__": law_of(qt.GeometricFeedback(3.0, 2.0)),
    "LogarithmicFeedback.__call__": law_of(qt.LogarithmicFeedback(3.0, 2.0)),
    "HystereticLaw.__call__": law_of(qt.HystereticLaw(LAW, 0.1)),
    "feedback_law": (lambda *k: qt.feedback_law(k1=k[0], k2=k[1])(REFERENCE, *QUATERNIONS), 3, 2),
    "error_response": (lambda m, n, t: qt.error_response(LAW, m, n, t), TURNED, RATE, 2),
    "control.error_state": (lambda m, n, t: control.error_state(LAW, m, n, t), TURNED, RATE, 2),
    **{
        f"{law}.deviation": (lambda q, law=law: getattr(qt, law)(3.0, 2.0).deviation(REFERENCE, q), TURNED)
        for law in ("AccelerationLaw", "QuaternionFeedback", "GeometricFeedback", "LogarithmicFeedback")
    },
    "RateLaw.deviation": (lambda q: RATE_LAW.deviation(REFERENCE, q), TURNED),
    "HystereticLaw.deviation": (lambda q: qt.HystereticLaw(LAW).deviation(REFERENCE, q), TURNED),
    "control.least_norm": (lambda m, n: control.least_norm(LAW, m, n), TURNED, RATE),
    "control.from_damping": (control.from_damping, 1, 2),
    "control.from_settling_time": (control.from_settling_time, 3),
    "control.rate_from_settling_time": (control.rate_from_settling_time, 3),
    "control.from_weights": (control.from_weights, 16, 3, 2),
    "control.place": (lambda m, w: control.place(LAW, REFERENCE, m, w), TURNED, [1, 0, 2]),
    "control.choose_sign": (lambda q, w: control.choose_sign(LAW, REFERENCE, q, w), TURNED, RATE),
    "control.state_from_error": (lambda m, w: control.state_from_error(REFERENCE, m, w), TURNED, RATE),
    "control.gibbs_normalization": (lambda q, w: control.gibbs_normalization(REFERENCE, q, w), TURNED, RATE),
    "control.error_angle": (lambda q: control.error_angle(REFERENCE, q), TURNED),
    "control.error_quaternion": (lambda q: control.error_quaternion(REFERENCE, q), TURNED),
    "control.error_rate": (lambda q, w: control.error_rate(REFERENCE, q, w), TURNED, RATE),
    "control.body_command": (lambda e: control.body_command(REFERENCE, e), RATE),
    "control.body_correction": (lambda e: control.body_correction(REFERENCE, e), RATE),
    "control.inertial_command": (lambda q, e: control.inertial_command(REFERENCE, q, e), TURNED, RATE),
    "control.inertial_correction": (lambda q, e: control.inertial_correction(REFERENCE, q, e), TURNED, RATE),
    # bodies
    "RigidBody": (
        lambda J, M: qt.RigidBody(J, torque=M).free(0.0, np.array(ONE, float), np.array(RATE, float)),
        *([3, 4, 5], [1, 0, 2]),
    ),
    "RigidBody.free": (BODY.free, 1, TURNED, RATE),
    "RigidBody.acceleration": (BODY.acceleration, 1, TURNED, [0, 1, 2], [1, 2, 0], [1, 0, 2]),
    "RigidBody.commanded_torques": (BODY.commanded_torques, [1, 0, 0], [0, 1, 0], [1, 0, 1]),
    **{
        f"RigidBody.{name}": (getattr(BODY, name), [1, 0, 2], [1, 2, 0])
        for name in ("actual_torques", "control_torque", "momentum_rate")
    },
    "RigidBody.wheel_momentum": (BODY.wheel_momentum, [1, 2, 0]),
    "ReactionWheels": (
        lambda *x: vars(qt.ReactionWheels(x[0], momentum=x[1])),
        *([[1, 0, 0], [0, 1, 0], [0, 1, 2]], [0, 1, 2]),
    ),
    "torques.CircularOrbit": (lambda *x: torques.CircularOrbit(*x, mu=2.0)(1.0), 3, [1, 2, 0], [0, 0, 1]),
    "CircularOrbit.__call__": (ORBIT, 2),
    "CircularOrbit.velocity": (ORBIT.velocity, 2),
    "torques.GravityGradient": (
        lambda *x: torques.GravityGradient(*x, mu=2.0)(0.0, *QUATERNIONS),
        *([3, 4, 5], [1, 2, 3]),
    ),
    "GravityGradient.__call__": (torques.GravityGradient([3.0, 4, 5], ORBIT, mu=2.0), 1, TURNED, [0, 1, 2]),
    "torques.MagneticDipole": (lambda *x: torques.MagneticDipole(*x)(0.0, *QUATERNIONS), [1, 0, 1], [1, 2, 3]),
    "MagneticDipole.__call__": (DIPOLE, 1, TURNED, [0, 1, 2]),
    "torques.AerodynamicTorque": (
        lambda *x: torques.AerodynamicTorque(*x)(0.0, *QUATERNIONS),
        *([0, 0, 1], 2, 1, [3, 2, 1], 2),
    ),
    "AerodynamicTorque.__call__": (AIR, 1, TURNED, [0, 1, 2]),
    "TorqueSum.__call__": (torques.TorqueSum([AIR, [0.0, 1, 2]]), 1, TURNED, [0, 1, 2]),
    "Sinusoid": (lambda *x: qt.Sinusoid(*x)(np.array(0.5)), [1, 2, 0], 3, 1),
    "DisturbanceTorque": (lambda *x: qt.DisturbanceTorque(*x).acceleration(0.0), [1, 2, 0], [3, 4, 5]),
    "Sinusoid.__call__": (qt.Sinusoid([1.0, 2, 0], 3.0, 1.0), 1),
    "DisturbanceTorque.acceleration": (qt.DisturbanceTorque(DIPOLE, INERTIA).acceleration, 1, TURNED, [0, 1, 2]),
    "DisturbanceAcceleration.acceleration": (qt.DisturbanceAcceleration(DIPOLE).acceleration, 1, TURNED, [0, 1, 2]),
    "DisturbanceAcceleration": (lambda a: qt.DisturbanceAcceleration(a).acceleration(0.0), [1, 2, 0]),
    "Actuator": (lambda limit: qt.Actuator(limit)(np.array([0.0, 3, 4, 0])), 2),
    "Actuator.__call__": (qt.Actuator(2.0), [0, 3, 4, 1]),
    "dynamics.forces": (lambda t, m, g: dynamics.forces(PATH, t, m, g), 2, 3, [0, 0, -9]),
    "dynamics.power": (lambda t, m, g: dynamics.power(PATH, t, m, g), 2, 3, [0, 0, -9]),
    "dynamics.friction_demand": (lambda t, m, g: vars(dynamics.friction_demand(PATH, t, m, g)), 2, 3, [0, 0, -9]),
    "Arm.pose": (ARM.pose, [0, 1, 2, 0, 1, 0]),
    "Arm.jacobian": (ARM.jacobian, [0, 1, 2, 0, 1, 0]),
    "Arm.kinematics": (ARM.kinematics, [0, 1, 2, 0, 1, 0]),
    "Arm.bias": (ARM.bias, [0, 1, 2, 0, 1, 0], [1, 0, 1, 2, 0, 1]),
    "Arm.from_dh": (lambda rows: qt.Arm.from_dh(rows).pose(np.array([0.1, 0.2])), [[0, 1, 2, 1], [1, 0, 1, 2]]),
    "Joint": (lambda *x: (qt.Joint(*x).axis, qt.Joint(*x).point), [0, 0, 2], [1, 2, 3]),
    "peak_torque": (lambda J: qt.peak_torque(SLEW, J)[1], [3, 4, 5]),
    "within_torque": (lambda J, M: qt.within_torque(FAST, J, M).duration, [3, 4, 5], 2),
    "slew_history": (lambda t, J: qt.slew_history(SLEW, t, J).torque, [0, 1, 2], [3, 4, 5]),
    "Curve": (lambda T: qt.Curve(PATH.position, T).derivatives(0.5, 1), 3),
    "Curve.derivatives": (lambda t: qt.Curve(PATH.position, 3.0).derivatives(t, 1), 2),
    "Ellipse": (lambda *x: qt.Ellipse(*x).usage(1.0, 2.0, 3.0), 8, 3, 9),
    "Ellipse.usage": (qt.Ellipse(8.0, 3.0, 9.0).usage, 2, 3, 4),
    "sqrt": (qt.sqrt, 4),
    # components
    **{f"exchange.{name}": (getattr(exchange, name), [1, 2, 0, 1]) for name in ("xyzw_from_wxyz", "wxyz_from_xyzw")},
    "pose_error": (qt.pose_error, [1, 0, 0, 0, 0, 1, 2, 0], [2, 0, 0, 0, 0, 1, 0, 1]),
}


UNTRACED = {
    **dict.fromkeys(("Along", "Ellipse", "Arm.from_dh"), "created outside jit, and says so"),
    **dict.fromkeys(("peak_torque", "within_torque", "slew_history"), "a search or a table on the host"),
    "Route.index": "an integer",
}
"""Rows that jit, vmap and grad do not reach, and why."""

HEAVY = {
    *("AbstractHodograph.arc_length", "AbstractHodograph.nearest", "AbstractHodograph.time_at"),
    *("AbstractProfile.profile", "AbstractProgram.at", "AccelerationLaw.__call__", "Arm.bias", "Arm.jacobian"),
    *("Arm.kinematics", "Arm.pose", "EulerTurn", "EulerTurn.about", "EulerTurn.axis", "FrameProgram.__call__"),
    *("GeometricFeedback.__call__", "LogarithmicFeedback.__call__", "MultiKnotCubic", "PoseProgram.__call__"),
    *("PoseProgram.dual", "ProgramSequence.__call__", "QuaternionFeedback.__call__", "RetimedPath.derivatives"),
    *("RotationMinimizing", "Route", "Route.nearest", "Route.time_at", "SCurve", "SlewSequence"),
    *("SlewSequence.__call__", "SpiralHelix.between", "SpiralHelix.from_boundary", "SpiralHelix.hermite"),
    *("TableProgram", "TableProgram.__call__", "ThrustAligned", "TimeOptimal", "TorqueSum.__call__"),
    *("Trihedral.dcm", "Trihedral.gibbs", "Trihedral.in_axes", "Trihedral.quaternion", "Upright", "Vehicle"),
    *("control.choose_sign", "control.least_norm", "control.place", "dynamics.forces", "dynamics.friction_demand"),
    *("evaluate", "peak", "propagate", "propagate_samples", "propagate_with_estimate", "slew_profile", "trihedral"),
}
"""Rows whose compilation with derivatives takes more than a second; these are marked as slow."""

COMPILED = {
    *("AbstractHodograph.__call__", "AbstractHodograph.acceleration", "AbstractHodograph.jerk"),
    *("AbstractHodograph.velocity", "AccelerationLaw", "AccelerationLaw.__call__", "Actuator", "Actuator.__call__"),
    *("Along", "Along.at", "Arm.bias", "Ball", "BySpeed.at", "CircularOrbit.__call__", "Curve", "Curve.derivatives"),
    *("Ellipse", "Ellipse.usage", "Ellipsoid", "EulerTurn", "GeometricFeedback.__call__", "Limits", "Limits.margins"),
    *("ProgramSequence.__call__", "QuaternionFeedback", "QuaternionFeedback.__call__", "ReactionWheels", "RigidBody"),
    *("RigidBody.acceleration", "RigidBody.commanded_torques", "RigidBody.free", "Route.nearest", "Sinusoid"),
    *("Sinusoid.__call__", "SpiralHelix.from_boundary", "Spin", "ThrustAligned", "Vehicle.inertia_in_frame"),
    *("control.body_command", "control.choose_sign", "control.error_angle", "control.error_state"),
    *("control.from_settling_time", "control.from_weights", "control.gibbs_normalization", "control.least_norm"),
    *("control.place", "error_response", "exchange.wxyz_from_xyzw", "exchange.xyzw_from_wxyz", "propagate"),
    *("slew_history", "sqrt", "torques.CircularOrbit", "torques.GravityGradient"),
}
"""Rows that JAX compiles, because they have no formula in NumPy or run separate operations of JAX."""

STORED = {
    **dict.fromkeys(("BoundaryState", "Ellipse", "Joint", "Limits", "Placement", "ReactionWheels"), "only stores"),
    **dict.fromkeys(("Vehicle", "Vehicle.inertia_in_frame"), "does not combine these numbers"),
    **dict.fromkeys(("MagneticDipole.__call__", "RateLaw.__call__"), "does not use all arguments"),
    **dict.fromkeys(("RigidBody.acceleration", "RigidBody.free"), "does not use all arguments"),
    **dict.fromkeys(("DisturbanceAcceleration.acceleration", "DisturbanceTorque.acceleration"), "uses no rate"),
    **dict.fromkeys(("slew_history", "within_torque"), "computes on the host"),
}
"""Rows that accept a first argument on another device, and why."""

MEMBERS = {
    **dict.fromkeys(("record", "to_xarray", "to_dataframe", "plot", "draw", "save"), "stores or shows a result"),
    **dict.fromkeys(("check", "explain", "describe", "findings", "rows", "sentences"), "a text about a result"),
    **dict.fromkeys(("components", "components_at", "sampled", "span", "nodes", "polynomials"), "between own modules"),
    **dict.fromkeys(("driven", "prepared", "timed", "increment"), "between own modules"),
    **dict.fromkeys(("measure", "start", "slope", "updated"), "called by the simulation, with arrays of one dtype"),
    **dict.fromkeys(
        ("distance", "outside", "occupancy", "at_rest", "enters", "checked"), "of obstacles, between own modules"
    ),
    **dict.fromkeys(("at_least", "sides", "without_missing", "scaled", "strictest"), "of limits, between own modules"),
}
"""Names of methods of any class to which kinds and shapes of arguments do not apply."""

RESULTS = (
    *("Atlas", "Atlas.at", "BoxCertificate", "BoxTuned", "RobustTuned"),
    *("ArmMotion", "AttitudeResidual", "BodyMotion", "Certificate", "Fitted", "FittedRoute", "LoopHistory"),
    *("LoopVerdict", "MarginUncertainty", "Nearest", "PathChange", "PoseMotion", "Propagation", "RateResidual"),
    *("Residual", "ResultCode", "Retimed", "RouteCertificate", "SlewHistory", "SlewVerdict", "Solution"),
    *("SpeedProfile", "Study", "Table", "TorquePeak", "Trihedral", "Tuned", "TunedRoute", "Uncertainty"),
    *("control.ClosedMotion", "dynamics.FrictionDemand", "BodyMotion.exactness", "BodyMotion.first_mismatch"),
    *("BodyMotion.largest", "BodyMotion.variables", "Certificate.margin", "Fitted.covariance", "Fitted.program"),
    *("FittedRoute.covariance", "LoopHistory.at", "Retimed.intervals", "RouteCertificate.intervals"),
    *("RouteCertificate.margin", "RouteCertificate.margins", "Solution.reached_text", "Solution.settling_time"),
    *("SpeedProfile.share", "Study.percentiles", "Study.worst", "TunedRoute.unproved"),
)
SEARCHES = (
    *("atlas", "tuned_points", "certify_box", "robust_tune", "robust_tune_route"),
    *("assess_loop", "certify", "closed_pose", "fit", "fit_route", "judge_loop", "judge_slew", "margin_uncertainty"),
    *("retime", "retime_together", "tune", "tune_route", "uncertainty", "speed_profile", "monte_carlo", "loop_history"),
    *("compare_attitude", "compare_paths", "compare_rates"),
)
OBJECTS = (
    *("FrameProgram", "GaussLegendre", "Magnus", "Natural", "PoseProgram", "ProgramSequence", "RetimedPath"),
    *("HystereticLaw", "PoseLaw", "AxesFrame", "FunctionProfile", "Quantity", "torques.TorqueSum", "Arm"),
)
INTERNAL = (
    *(f"{frame}.{name}" for frame in ("AbstractFrame", "Driving", "ThrustAligned") for name in ("at", "trihedral")),
    *("AxesFrame.trihedral", "Natural.trihedral", "Upright.trihedral", "Upright.unit_up", "Vehicle.parameters"),
    *("BySpeed.loosest", "BySpeed.stricter", "Route.in_time", "Timing.taylor", "Timing.taylor_at"),
    *("Timing.motion_at", "Timing.times_of", "Road.at", "Road.sections", "Road.steepest"),
    *(f"Limits.{name}" for name in ("constant", "given", "on", "on_shape", "on_timing", "only")),
    *("Limits.road", "Limits.require_batch", "Limits.require_constant"),
)
SIMULATED = (
    *("HystereticLaw.switches", "HystereticLaw.updated_sign", "PoseLaw.__call__", "Damping", "Gyros", "Sensor"),
)
ON_THE_HOST = (
    *("AtlasAxis", "AtlasAxis.at", "Box", "Spread"),
    *("AttitudeAngles", "AttitudeAngles.quaternions", "TangentPlane", "TangentPlane.project", "Track"),
    *("Track.window", "Shape", "Shape.through", "Along.from_samples", "BySpeed", "Regions", "Regions.along", "Road"),
    *("Driving", "Driving.along", "Route.from_path", "Route.from_piecewise", "Route.reversed", "Route.segment"),
    *("Route.window", "Route.to_ppoly", "Route.joints", "Route.jumps", "Timing", "SCurve.possible_durations"),
)
OTHERS = {
    **dict.fromkeys(RESULTS, "a result, which functions with rows of their own return"),
    **dict.fromkeys(SEARCHES, "of paths, limits, recordings and results, which have rows of their own"),
    **dict.fromkeys(
        ("integrate", "open_loop", "simulate", "simulate_arm", "simulate_pose", "control.closed_motion"),
        "a simulation: tests/motion/simulation, which compile it",
    ),
    **dict.fromkeys(
        ("load", "load_dataset", "read_road", "read_shape", "read_track", "save_dataset", "label", "storable"),
        "of files and datasets",
    ),
    **dict.fromkeys(("sweep", "Swept", "Swept.parameters", "Swept.values_of"), "of functions and stores: tests/sweeps"),
    "in_blocks": "of functions: tests/foundation/test_in_blocks.py",
    **dict.fromkeys(
        (f"sweeps.{name}" for name in ("evaluate", "certify", "tune", "tune_route", "retime", "simulate")),
        "of functions: tests/sweeps",
    ),
    **dict.fromkeys(
        ("sweeps.Column", "sweeps.Normal", "sweeps.Uniform", "Normal.from_unit", "Uniform.from_unit"),
        "of parameters: tests/sweeps",
    ),
    **dict.fromkeys(("enable_compilation_cache", "sample_times", "stanford_arm", "Progress"), "of no arrays"),
    **dict.fromkeys(
        (f"exchange.{name}" for name in ("jaxlie_from_wxyz", "scipy_from_wxyz", "wxyz_from_jaxlie", "wxyz_from_scipy")),
        "of objects of another library",
    ),
    **dict.fromkeys(
        ("dynamics.acceleration", "dynamics.inertia_matrix", "dynamics.rotational_power", "dynamics.torque"),
        "tests/algebra/test_every_function.py",
    ),
    **dict.fromkeys(
        (f"Abstract{name}" for name in ("Disturbance", "Frame", "Hodograph", "Profile", "Program", "Sensor")),
        "abstract",
    ),
    **dict.fromkeys(
        ("control.AbstractLaw", "AbstractLaw.__call__", "AbstractLaw.deviation", "AbstractProgram.__call__"), "abstract"
    ),
    **dict.fromkeys(("AbstractHodograph.derivatives", "AbstractDisturbance.acceleration"), "abstract"),
    **dict.fromkeys(OBJECTS, "made of other objects or functions, not of arrays"),
    **dict.fromkeys(INTERNAL, "called by own modules only"),
    **dict.fromkeys(SIMULATED, "called by the simulation with arrays of one dtype, or its settings"),
    **dict.fromkeys(ON_THE_HOST, "tables of numbers, read and checked on the host"),
    **dict.fromkeys(("AbstractHodograph.length", "Route.length", "control.spectral_abscissa"), "of no arrays"),
}
