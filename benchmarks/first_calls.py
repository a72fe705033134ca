"""The calls of `benchmarks.first_answers`; `python -m benchmarks.first_calls NAME` prints the processor time of one.

Each entry of `CALLS` prepares its arguments, and returns a function without arguments, whose call is measured [s].
Paths are created from coefficients, so that the preparation shares as little as possible with the call.
"""

import json
import sys
import time
from pathlib import Path

import jax
import numpy as np

import qtraj as qt

from . import questions

DRIVE = Path(__file__).parents[1] / "examples" / "drive_8km.csv.gz"
TURN = Path(qt.__file__).parent / "io" / "data" / "boreas_right_angle.csv"
WINDOW = (20.0, 80.0)
"""A minute of the drive without a stop [s]."""

START = ([20.0, 0.0, 0.0], [1.0, 7.0, 0.3])
END = ([0.0, 28.0, 1.5], [-9.8, -1.0, 0.0])
TWO = {"curvature": 0.048, "lateral_acceleration": 2.2}
TWELVE = {
    "torsion": 1.0,
    "speed": 12.0,
    "acceleration": 20.0,
    "longitudinal_acceleration": 10.0,
    "slope": 1.0,
    "angular_rate": 2.0,
    "angular_acceleration": 5.0,
    "jerk": 20.0,
    "yaw_rate": 1.0,
    "yaw_acceleration": 5.0,
    **TWO,
}
ON_DRIVE = {"curvature": 0.2, "speed": 16.7, "lateral_acceleration": 3.0, "jerk": 8.0, "yaw_rate": 0.5}
TIMED = {"speed": 13.9, "lateral_acceleration": 1.5, "longitudinal_acceleration": 1.2, "jerk": 0.9}
TUBED = {"curvature": 0.1, "lateral_acceleration": 1.5}
INSTANTS = 200


def turn(placement=None):
    """Return a spiral-helix with a cubic angle, as `SpiralHelix.hermite` creates it."""
    return qt.SpiralHelix([20.0, 1.0, 0.3, -0.05], [0.2, 0.35, 0.01, -0.002], [1.0, 0.4, 0.05, -0.01], 4.5, placement)


def certify(limits):
    path, given = turn(), qt.Limits(**limits)
    return lambda: qt.certify(path, given)


def drive():
    """Return the route of the whole drive."""
    return qt.fit_route(qt.read_track(DRIVE)).path


def certify_drive():
    route, limits = drive(), qt.Limits(**ON_DRIVE)
    return lambda: qt.certify(route, limits)


def tune(motion, again=None):
    """Return a tuning; with `again`, a tuning with another motion and other limits has run before."""
    start, end = qt.BoundaryState(*START), qt.BoundaryState(*END)
    if again is not None:
        qt.tune(start, end, qt.Limits(speed=12.0, jerk=20.0), motion=again)
    return lambda: qt.tune(start, end, qt.Limits(**TWO), motion=motion)


def gradient_of_tune():
    """The derivatives of the duration of a tuned path with respect to both velocities, outside jit."""
    jax.config.update("jax_enable_x64", True)

    def duration(velocities):
        start, end = (qt.BoundaryState(x[0], v) for x, v in zip((START, END), velocities, strict=True))
        return qt.tune(start, end, qt.Limits(**TWO), motion="hermite").path.duration

    velocities = jax.numpy.asarray([START[1], END[1]])
    return lambda: jax.grad(duration)(velocities)


def on_minute(call, **limits):
    """Return a call with a minute of the drive and limits."""
    route, given = drive().window(*WINDOW), qt.Limits(**limits)
    return lambda: call(route, given)


def fit():
    track = qt.read_track(TURN).window(1093.5, 1099.5)
    return lambda: qt.fit(track)


def fit_route():
    track = qt.read_track(DRIVE)
    return lambda: qt.fit_route(track)


def slew():
    last = np.array([np.cos(0.5), 0.0, 0.6 * np.sin(0.5), 0.8 * np.sin(0.5)])
    return qt.EulerTurn([1.0, 0.0, 0.0, 0.0], last, qt.TimeOptimal(max_rate=0.1, max_acceleration=0.01))


def simulate():
    program, law, times = slew(), qt.AccelerationLaw(0.4, 0.04), np.linspace(0.0, 20.0, 201)
    return lambda: qt.simulate(program, law, [1.0, 0.01, 0.0, 0.0], np.zeros(4), times)


def propagate(omega):
    first, times = np.array([1.0, 0.0, 0.0, 0.0]), np.linspace(0.0, 7.0, 11)
    return lambda: qt.propagate(omega, first, times)


def waves(t):
    """Return an angular rate that varies with time."""
    return jax.numpy.stack([0.1 * jax.numpy.cos(t), 0.2 * jax.numpy.sin(t), 0.3 + 0 * t])


def rate_of_slew():
    program = slew()
    return lambda t: program(t).rate


def hermite():
    start, end = qt.BoundaryState(*START), qt.BoundaryState(*END)
    return lambda: qt.SpiralHelix.hermite(start, end, 4.0)


def formulas():
    """Return one call each of six functions that evaluate formulas."""
    calls = [CALLS[name]() for name in FORMULAS]
    return lambda: [call() for call in calls]


def of_path(call):
    path = turn()
    return lambda: call(path)


FORMULAS = ("trihedral", "FrameProgram(t)", "evaluate, 200 instants", "peak", "length", "SpiralHelix.hermite")

CALLS = {
    "certify, two limits": lambda: certify(TWO),
    "certify, twelve limits": lambda: certify(TWELVE),
    "certify, 8 km, five limits": certify_drive,
    "tune, uniform": lambda: tune("uniform"),
    "tune, hermite": lambda: tune("hermite"),
    "tune, hermite, after uniform with other limits": lambda: tune("hermite", again="uniform"),
    "retime, 60 s": lambda: on_minute(qt.retime, **TIMED),
    "gradient of tune, hermite": gradient_of_tune,
    "tune_route, 60 s": lambda: on_minute(qt.tune_route, **TUBED),
    "fit": fit,
    "fit_route, 8 km": fit_route,
    "simulate, slew": simulate,
    "propagate": lambda: propagate(waves),
    "propagate, rate of a slew": lambda: propagate(rate_of_slew()),
    "trihedral": lambda: of_path(lambda path: qt.trihedral(path, 2.0).quaternion()),
    "FrameProgram(t)": lambda: of_path(lambda path: qt.FrameProgram(path)(2.0)),
    "evaluate, 200 instants": lambda: of_path(lambda path: qt.evaluate(path, np.linspace(0.0, 4.5, INSTANTS))),
    "peak": lambda: of_path(lambda path: qt.peak(path, "curvature")),
    "length": lambda: of_path(lambda path: path.length()),
    "SpiralHelix.hermite": hermite,
    "these six": formulas,
    f"{questions.COUNT} different questions": lambda: questions.ask,
}


def main():
    jax.config.update("jax_enable_x64", True)
    for name in qt.__all__:
        getattr(qt, name)  # imports the module in which it is defined
    call = CALLS[sys.argv[1]]()
    begun = time.process_time()
    jax.block_until_ready(call())
    print(json.dumps(time.process_time() - begun))


if __name__ == "__main__":
    main()
