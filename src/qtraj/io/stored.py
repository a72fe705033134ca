"""Load stored documents of any class in the library.

`foundation.document` reads only classes that have been imported. This module imports all classes that can be stored.
"""

import importlib

from qtraj.foundation.document import load

__all__ = ["load"]

HOMES = (
    "qtraj.design.along",
    "qtraj.design.bound",
    "qtraj.design.by_speed",
    "qtraj.design.ellipse",
    "qtraj.design.fitting.fitted",
    "qtraj.design.fitting.fitted_route",
    "qtraj.design.limits",
    "qtraj.design.obstacles.ball",
    "qtraj.design.obstacles.body",
    "qtraj.design.obstacles.convex_polygon",
    "qtraj.design.obstacles.cylinder",
    "qtraj.design.obstacles.ellipsoid",
    "qtraj.design.obstacles.half_space",
    "qtraj.design.proof.certificate",
    "qtraj.design.proof.route_certificate",
    "qtraj.design.regions",
    "qtraj.design.robust.outcome",
    "qtraj.design.robust.spread",
    "qtraj.design.timing.outcome",
    "qtraj.design.timing.timing",
    "qtraj.design.tuning.outcome",
    "qtraj.design.tuning_route.tuned_route",
    "qtraj.motion.attitude_residual",
    "qtraj.motion.control.baselines",
    "qtraj.motion.control.closed_form",
    "qtraj.motion.control.hysteresis",
    "qtraj.motion.control.laws",
    "qtraj.motion.manipulator.arm",
    "qtraj.motion.manipulator.arm_motion",
    "qtraj.motion.manipulator.inverse",
    "qtraj.motion.pose.pose_law",
    "qtraj.motion.pose.pose_motion",
    "qtraj.motion.profiles.function_profile",
    "qtraj.motion.profiles.multi_knot_cubic",
    "qtraj.motion.profiles.profile",
    "qtraj.motion.profiles.s_curve",
    "qtraj.motion.profiles.smooth_step",
    "qtraj.motion.profiles.time_optimal",
    "qtraj.motion.programs.euler_turn",
    "qtraj.motion.programs.frame_program",
    "qtraj.motion.programs.program_sequence",
    "qtraj.motion.programs.rotation_minimizing",
    "qtraj.motion.programs.spin",
    "qtraj.motion.programs.table_program",
    "qtraj.motion.rate_residual",
    "qtraj.motion.simulation.actuator",
    "qtraj.motion.simulation.body",
    "qtraj.motion.simulation.body_motion",
    "qtraj.motion.simulation.disturbance",
    "qtraj.motion.simulation.sensor",
    "qtraj.motion.simulation.solution",
    "qtraj.motion.torques.aerodynamic",
    "qtraj.motion.torques.circular_orbit",
    "qtraj.motion.torques.gravity_gradient",
    "qtraj.motion.torques.magnetic",
    "qtraj.motion.torques.torque_sum",
    "qtraj.path.boundary",
    "qtraj.path.driving",
    "qtraj.path.placement",
    "qtraj.path.residual",
    "qtraj.path.road",
    "qtraj.path.route",
    "qtraj.path.shape",
    "qtraj.path.spiral_helix",
    "qtraj.path.thrust_aligned",
    "qtraj.path.track",
    "qtraj.path.trihedral",
    "qtraj.path.vehicle",
    "qtraj.sweeps.atlas.axis",
    "qtraj.sweeps.atlas.outcome",
)
"""Modules that define the classes of stored documents."""

for _home in HOMES:
    importlib.import_module(_home)
