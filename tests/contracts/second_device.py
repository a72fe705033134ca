"""Calls of the public names that `every_call.py` does not call, with arguments that are moved to a second device.

`test_devices.py` runs `faults` in a process with two CPU devices. A new public name needs a row in `CALLS` or in
`every_call.CALLS`, or a reason in `NO_ARRAYS` why its arguments cannot be on a device.
"""

import tempfile

import jax
import jax.numpy as jnp
import numpy as np
import optax
from tests.algebra import test_every_function as rotations
from tests.contracts.every_call import INTERNAL, RESULTS

import qtraj as qt
from qtraj import control, exchange, sweeps, torques

PATH = qt.SpiralHelix([20.0, 1.0, 0.3, -0.05], [0.2, 0.35, 0.01], [1.0, 0.4, 0.05], 4.5)
STATES = np.array([[0.0, 0, 0], [3, 1, 0], [5, 4, 1]]), np.array([[3.0, 0, 0], [3, 2, 1], [2, 4, 1]])
ROUTE = qt.Route([0.0, 1.0, 2.0], *STATES, np.zeros((3, 3)))
STOPS = qt.Route(  # forwards, a stop, backwards
    [0.0, 2.0, 4.0], [[0.0, 0, 0], [4, 0, 0], [2, 1, 0]], [[2.0, 0, 0], [0, 0, 0], [-2.0, 1, 0]], np.zeros((3, 3))
)
START = qt.BoundaryState([20.0, 0.0, 0.0], [1.0, 7.0, 0.3])
END = qt.BoundaryState([0.0, 28.0, 1.5], [-9.8, -1.0, 0.0])
LIMITS, ON_ROUTE = qt.Limits(curvature=0.048, lateral_acceleration=2.2), qt.Limits(curvature=3.0, speed=20.0)
TIMED = qt.Limits(speed=13.9, lateral_acceleration=1.5, longitudinal_acceleration=1.2)
BOX, SPREAD = qt.Box(start_speed=[-0.1, 0.1]), qt.Spread(start_velocity=0.01)
FRAME, LAW, SPIN = qt.FrameProgram(PATH), qt.AccelerationLaw(2.0, 1.5), qt.Spin([0.0, 0.0, 0.3], 4.5)
SLEW = qt.EulerTurn([1.0, 0, 0, 0], [1.0, 0.2, 0, 0], qt.Quintic(duration=2.0))
POSITION, VELOCITY, QUATERNION = np.array([20.0, 0, 1]), np.array([1.0, 7, 0.3]), np.array([1.0, 0.1, 0, 0])
RATE, INSTANTS, JOINTS = np.array([0, 0, 0, 0.3]), np.linspace(0.0, 2.0, 5), np.array([0.1, 0.5, 1, 0.2, 0.5, 0.3])
LATER = np.array(1.0)
TIMES = np.linspace(0.0, 4.5, 60)
MOTION = jax.vmap(FRAME)(jnp.asarray(TIMES))
DRIVEN = np.stack([PATH.position(t) for t in TIMES]) + 1e-3 * np.random.default_rng(0).normal(size=(60, 3))
TURNED, TURNING = np.asarray(MOTION.quaternion), np.asarray(MOTION.rate)
POSE, POSE_LAW = qt.PoseProgram(PATH, FRAME), qt.PoseLaw(LAW, 2.0, 1.5)
LOOP = FRAME, LAW, QUATERNION, RATE, INSTANTS
FLIGHT = POSE, POSE_LAW, POSITION, VELOCITY, QUATERNION, RATE, INSTANTS
REFERENCES = jax.vmap(FRAME)(jnp.asarray(INSTANTS))
HYSTERETIC, OPTIMISER = qt.HystereticLaw(LAW, 0.2), optax.adam(1e-2)
PACE = np.array([[0.0, 1, 0, 0], [1.0, 1, 0, 0]]), np.array([0.0, 1, 2])
SLOPES, SQUARE = np.array([5.0, 4, 2]), np.array([[0.0, 0], [4, 0], [4, 4], [0, 4]])

ARRAYS = np.ndarray | np.generic | jax.Array
RELATIVE, ABSOLUTE = 1e-6, 1e-9
"""Differences between results of NumPy or of the first device and those of the second device."""


def history(*loop):
    """The history of a simulated loop."""
    return qt.loop_history(*loop[:-1], qt.simulate(*loop))


def swept(radius):
    """The peaks of a sweep over radii."""
    peak = sweeps.evaluate(lambda p: qt.SpiralHelix([p["radius"]], [0.0, 0.3], [0.0], 3.0), ["curvature"])
    with tempfile.TemporaryDirectory() as folder:
        return np.concatenate([*qt.sweep(peak, {"radius": radius}, folder, workers=0).values_of("curvature")])


def studied(tilts, spins):
    """The attitude errors of flights with random initial states."""

    def flight(tilt, spin):
        start = jnp.concatenate([jnp.ones(1), tilt]), jnp.concatenate([jnp.zeros(1), spin])
        return qt.simulate(SPIN, LAW, *start, INSTANTS)

    return qt.monte_carlo(flight, {"tilt": tilts, "spin": spins}, 4)


def feasible(radius):
    """The classes of points whose problems contain an array."""

    def problem(speed, width):
        start = qt.BoundaryState([radius, 0.0 * radius, 0.0 * radius], [0, speed, 0])
        end = qt.BoundaryState([0.0 * radius, radius, 0.0 * radius], [-speed, 0, 0])
        return start, end, qt.Limits(lateral_acceleration=width)

    return problem


def upright(velocity, up):
    """The axes of an upright frame."""
    forward = velocity / jnp.sqrt(velocity @ velocity)
    left = jnp.cross(up, forward)
    left = left / jnp.sqrt(left @ left)
    return jnp.stack([forward, left, jnp.cross(forward, left)])


def tuned_corners(radius):
    found = qt.tuned_points(feasible(radius), fixed=["duration"])(np.array([3.0, 9.0]), np.array([1.5, 1.5]))
    return found["status"] == "feasible"


def mapped(speed):
    """The classes of an atlas of the lateral acceleration at a speed."""
    axes = qt.AtlasAxis("radius", 10.0, 50.0, 5.0, 4), qt.AtlasAxis("factor", 1.0, 3.0, 0.5, 4)
    return qt.atlas(lambda r, c: (c * speed) ** 2 / r <= 1.5, *axes).status == "feasible"


CALLS = {
    # searches and proofs
    "certify": (qt.certify, PATH, LIMITS),
    "certify a route": (qt.certify, ROUTE, ON_ROUTE),
    "certify_box": (lambda *x: qt.certify_box(*x, BOX), PATH, LIMITS),
    "tune": (qt.tune, START, END, LIMITS),
    "tune by optax": (
        lambda *x: qt.tune(*x, method=OPTIMISER, starts=2, inner_steps=20),
        *(START, END, LIMITS),
    ),
    "tune_route": (qt.tune_route, ROUTE, ON_ROUTE),
    "robust_tune": (lambda *x: qt.robust_tune(*x, BOX), START, END, LIMITS),
    "robust_tune_route": (lambda *x: qt.robust_tune_route(*x, SPREAD, samples=256), ROUTE, ON_ROUTE),
    "retime": (lambda *x: qt.retime(*x, knots=32), PATH, TIMED),
    "retime_together": (lambda p, x: qt.retime_together([p, p], [x, x], knots=32), ROUTE, TIMED),
    "speed_profile": (lambda *x: qt.speed_profile(qt.retime(*x, knots=32)), PATH, TIMED),
    "fit": (lambda *x: qt.fit(qt.Track(*x)), TIMES, DRIVEN),
    "fit_route": (lambda *x: qt.fit_route(qt.Track(*x)), TIMES, DRIVEN),
    "uncertainty": (lambda t, *x: qt.uncertainty(qt.fit(qt.Track(*x)), t), INSTANTS, TIMES, DRIVEN),
    "margin_uncertainty": (lambda x, *y: qt.margin_uncertainty(qt.fit(qt.Track(*y)), x), LIMITS, TIMES, DRIVEN),
    "compare_paths": (qt.compare_paths, PATH, PATH),
    "compare_attitude": (
        lambda p, t, x, q: qt.compare_attitude(p, qt.Track(t, x, attitudes=q)),
        *(FRAME, TIMES, DRIVEN, TURNED),
    ),
    "compare_rates": (
        lambda p, t, x, w: qt.compare_rates(p, qt.Track(t, x, rates=w)),
        *(FRAME, TIMES, DRIVEN, TURNING),
    ),
    "tuned_points": (tuned_corners, np.array(20.0)),
    "atlas": (mapped, np.array(4.0)),
    "sweep": (swept, np.array([8.0, 9.0, 10.0])),
    "in_blocks": (lambda x: qt.in_blocks(jnp.sin, x, block=2), INSTANTS),
    # simulations
    "simulate": (qt.simulate, SPIN, LAW, QUATERNION, RATE, INSTANTS),
    "integrate": (lambda *x: qt.integrate(lambda t, q, w: -0.1 * w, *x), QUATERNION, RATE, INSTANTS),
    "monte_carlo": (studied, np.full(3, 0.1), np.full(3, 0.01)),
    "open_loop": (qt.open_loop, SLEW, INSTANTS),
    "loop_history": (history, *LOOP),
    "judge_loop": (lambda *x: qt.judge_loop(history(*x), x[1]), *LOOP),
    "judge_slew": (qt.judge_slew, SLEW),
    "assess_loop": (qt.assess_loop, *LOOP),
    "control.closed_motion": (control.closed_motion, LAW, REFERENCES, *LOOP[2:]),
    "control.spectral_abscissa": (control.spectral_abscissa, LAW),
    "simulate_pose": (qt.simulate_pose, *FLIGHT),
    "closed_pose": (qt.closed_pose, *FLIGHT),
    "simulate_arm": (
        lambda *x: qt.simulate_arm(qt.stanford_arm(), *x, damping=qt.Damping(0.01)),
        *(SLEW, LAW, JOINTS, 0 * JOINTS, INSTANTS),
    ),
    "Sensor": (
        lambda b, t: qt.simulate(SPIN, LAW, QUATERNION, RATE, INSTANTS, sensor=qt.Sensor(b, sampling=t)),
        *(np.array([0.0, 1e-3, 0]), np.array(0.5)),
    ),
    "Gyros": (
        lambda t, b: qt.simulate(SPIN, LAW, QUATERNION, RATE, INSTANTS, sensor=qt.Gyros(t, b)),
        *(np.array(0.5), np.array([0.0, 1e-3, 0])),
    ),
    # paths, frames and programs that are made of other objects or of functions
    "AxesFrame": (
        lambda p, t, up: qt.trihedral(p, t, qt.AxesFrame(lambda r, v, a: upright(v, up))).quaternion(),
        *(PATH, LATER, np.array([0.0, 0, 1])),
    ),
    "Driving": (
        lambda t, *x: qt.trihedral(STOPS, t, qt.Driving(*x)).quaternion(),
        *(LATER, *(getattr(qt.Driving.along(STOPS), name) for name in ("starts", "signs", "angles"))),
    ),
    "Driving.along": (lambda p, t: qt.trihedral(p, t, qt.Driving.along(p)).quaternion(), STOPS, LATER),
    "FrameProgram": (lambda p, t: qt.FrameProgram(p)(t), PATH, LATER),
    "PoseProgram": (lambda p, q, t: qt.PoseProgram(p, q)(t), PATH, FRAME, LATER),
    "ProgramSequence": (lambda p, t: qt.ProgramSequence([p])(t), SLEW, LATER),
    "FunctionProfile": (
        lambda T, t: qt.FunctionProfile(lambda s: s**2 * (3 - 2 * s), T).profile(1.0).derivatives(t, 2),
        *(np.array(2.0), LATER),
    ),
    "RetimedPath": (lambda p, *x: qt.RetimedPath(p, qt.Timing(*x)).position(0.5), PATH, *PACE),
    "Timing": (lambda *x: qt.Timing(*x).time(0.5), *PACE),
    "HystereticLaw": (lambda x, h: qt.HystereticLaw(x, h).half_width, LAW, np.array(0.2)),
    "HystereticLaw.switches": (lambda s, a, q: HYSTERETIC.switches(s, a, q), np.array(1.0), FRAME(1.0), QUATERNION),
    "HystereticLaw.updated_sign": (
        lambda s, a, q: HYSTERETIC.updated_sign(s, a, q),
        *(np.array(1.0), FRAME(1.0), QUATERNION),
    ),
    "PoseLaw": (lambda *x: qt.PoseLaw(*x)(*POSE(1.0), *FLIGHT[2:6]), LAW, np.array(2.0), np.array(1.5)),
    "PoseLaw.__call__": (lambda x, *y: POSE_LAW(*x, *y), POSE(1.0), *FLIGHT[2:6]),
    "Arm": (
        lambda x, p, q: qt.Arm([qt.Joint(x, np.zeros(3))], p).pose(q),
        *(np.array([0.0, 0, 1]), np.array([1.0, 0, 0]), np.array([0.5])),
    ),
    "Damping": (lambda *x: vars(qt.Damping(*x)), np.array(0.1), np.array(0.2)),
    "torques.TorqueSum": (
        lambda *x: torques.TorqueSum([*x])(0.5, QUATERNION, RATE[1:]),
        *(np.array([0.0, 1, 2]), np.array([1.0, 0, 2])),
    ),
    # tables of numbers, and what is computed from a whole route
    "Along.from_samples": (lambda *x: qt.Along.from_samples(*x).at(1.0), PATH, np.array([0.0, 2, 4]), SLOPES),
    "BySpeed": (lambda *x: qt.BySpeed(*x[:1], upper=x[1]).at(5.0), np.array([0.0, 10, 20]), SLOPES),
    "Box": (lambda *x: vars(qt.Box(*x)), np.array([-0.1, 0.1]), np.array([-0.2, 0.2])),
    "Spread": (lambda *x: vars(qt.Spread(*x)), np.full(3, 0.1), np.full(3, 0.2)),
    "Regions": (lambda x, v: vars(qt.Regions([(x, v)])), SQUARE, np.array(5.0)),
    "Regions.along": (lambda x, p: vars(qt.Regions([(x, 5.0)], 9.0).along(p)), SQUARE, ROUTE),
    "Road": (lambda *x: tuple(qt.Road(*x).at(np.array([3.0]))), np.array([0.0, 5, 9]), SLOPES / 10),
    "Shape": (lambda p, w: vars(qt.Shape(p, w)), ROUTE, np.ones((3, 2))),
    "Shape.through": (lambda x, w: vars(qt.Shape.through(x, widths=w)), STATES[0], np.ones((3, 2))),
    "Track": (lambda *x: vars(qt.Track(*x)), TIMES, DRIVEN),
    "Track.window": (lambda x, a, b: vars(x.window(a, b)), qt.Track(TIMES, DRIVEN), np.array(1.0), np.array(3.0)),
    "Route.from_path": (qt.Route.from_path, PATH),
    "Route.joints": (qt.Route.joints, ROUTE),
    "Route.jumps": (qt.Route.jumps, ROUTE),
    "Route.length": (qt.Route.length, ROUTE),
    "AbstractHodograph.length": (qt.SpiralHelix.length, PATH),
    "Route.reversed": (qt.Route.reversed, ROUTE),
    "Route.segment": (lambda p: p.segment(1), ROUTE),
    "Route.to_ppoly": (lambda p: p.to_ppoly().c, ROUTE),
    "Route.window": (lambda *x: qt.Route.window(*x), ROUTE, np.array(0.5), np.array(1.5)),
    "SCurve.possible_durations": (lambda x: [*map(ord, qt.SCurve(1.0, 2.0, 8.0).possible_durations(x))], np.array(2.0)),
    "label": (lambda t, v: qt.label(t, speed=(v, "m/s", "speed")).speed.values, INSTANTS, INSTANTS),
    "dynamics.inertia_matrix": (qt.dynamics.inertia_matrix, np.array([3.0, 4, 5])),
    "rotation.slerp_along": (qt.rotation.slerp_along, TIMES, TURNED, LATER),
    "rotation.to_scipy": (lambda q: qt.rotation.to_scipy(q).as_quat(), QUATERNION),
    "exchange.scipy_from_wxyz": (lambda q: exchange.scipy_from_wxyz(q).as_quat(), QUATERNION),
    "exchange.jaxlie_from_wxyz": (lambda q: exchange.jaxlie_from_wxyz(q).wxyz, QUATERNION),
}


NO_ARRAYS = {
    **dict.fromkeys(RESULTS, "a result, which functions with rows return"),
    **dict.fromkeys(INTERNAL, "called by own modules only"),
    **dict.fromkeys(
        (f"Abstract{name}" for name in ("Disturbance", "Frame", "Hodograph", "Profile", "Program", "Sensor")),
        "abstract",
    ),
    **dict.fromkeys(("control.AbstractLaw", "AbstractLaw.__call__", "AbstractLaw.deviation"), "abstract"),
    **dict.fromkeys(
        ("AbstractProgram.__call__", "AbstractHodograph.derivatives", "AbstractDisturbance.acceleration"), "abstract"
    ),
    **dict.fromkeys(
        ("AtlasAxis", "AtlasAxis.at", "AttitudeAngles", "GaussLegendre", "Magnus", "Natural", "Progress", "Quantity"),
        "of words and numbers of Python",
    ),
    **dict.fromkeys(
        ("TangentPlane", "enable_compilation_cache", "sample_times", "stanford_arm", "storable"),
        "of words and numbers of Python",
    ),
    **dict.fromkeys(
        ("sweeps.Column", "sweeps.Normal", "sweeps.Uniform", "Normal.from_unit", "Uniform.from_unit"),
        "of words, numbers of Python and the NumPy arrays of a sweep",
    ),
    **dict.fromkeys(
        ("AttitudeAngles.quaternions", "TangentPlane.project"), "of NumPy arrays, which are read from files"
    ),
    **dict.fromkeys(("load", "load_dataset", "read_road", "read_shape", "read_track", "save_dataset"), "of files"),
    **dict.fromkeys(("Swept", "Swept.parameters", "Swept.values_of"), "of a store"),
    **dict.fromkeys(
        (f"sweeps.{name}" for name in ("evaluate", "certify", "tune", "tune_route", "retime", "simulate")),
        "of functions of a point, which `sweep` calls with NumPy arrays",
    ),
    **dict.fromkeys(("exchange.wxyz_from_jaxlie", "exchange.wxyz_from_scipy"), "of an object of another library"),
    "Route.from_piecewise": "of an object of another library",
    **dict.fromkeys(("rotation.from_scipy", "rotation.random"), "of an object of another library, or of a key"),
}
"""Public names whose arguments are not arrays, and why."""


ANYWHERE = {
    **dict.fromkeys(("Damping", "HystereticLaw", "PoseLaw"), "only stores"),
    **dict.fromkeys(("Along.from_samples", "Box", "Regions", "Road", "Spread"), "a table, copied to the host"),
    **dict.fromkeys(("Regions.along", "Shape", "Shape.through", "Track", "label"), "a table, copied to the host"),
    **dict.fromkeys(("Route.window", "Track.window"), "the bounds are copied to the host"),
}
"""Rows whose arguments may be on different devices, and why."""


def moved(tree, device):
    """The tree with its arrays on a device."""
    return jax.tree.map(lambda x: jax.device_put(jnp.asarray(x), device) if isinstance(x, ARRAYS) else x, tree)


def numbers(tree):
    """The arrays of a result."""
    return [np.asarray(x, float) for x in jax.tree.leaves(tree) if isinstance(x, ARRAYS)]


def of_rotations():
    """The functions of `tests/algebra/test_every_function.py` with arguments."""
    for name in sorted({*rotations.FUNCTIONS} - {*rotations.OTHERS}):
        call, sizes = rotations.case(name)
        yield name, (call, *rotations.drawn(sizes, ()))


def faults(rows):
    """Report for which rows the values differ, the results are elsewhere, or a mixture of devices is accepted."""
    first, second = jax.local_devices()
    for name, (call, *arguments) in rows:
        found = call(*moved(arguments, second))
        where = {device for x in jax.tree.leaves(found) if isinstance(x, jax.Array) for device in x.devices()}
        if where - {second}:
            yield f"{name} is on {where}"
        for x, y in zip(numbers(call(*arguments)), numbers(found), strict=True):
            if not np.allclose(x, y, RELATIVE, ABSOLUTE, equal_nan=True):
                yield f"{name} has other values"
        if sum(bool(numbers(x)) for x in arguments) > 1:
            yield from mixture_faults(name, call, moved(arguments[:1], first) + moved(arguments[1:], second))


def mixture_faults(name, call, mixture):
    """Report that arguments on two devices are accepted, or refused without a clear text."""
    try:
        call(*mixture)
    except ValueError as error:
        if "cpu:0 and cpu:1" not in str(error) or "jax.device_put(x, device)" not in str(error):
            yield f"{name} refuses a mixture without a clear text: {error}"
        if name in ANYWHERE:
            yield f"{name} refuses a mixture, so it does not belong to ANYWHERE"
    else:
        if name not in ANYWHERE:
            yield f"{name} accepts a mixture"
