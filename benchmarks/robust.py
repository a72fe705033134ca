"""Check robust tunings by random samples: the stated shares, and the proofs over boxes.

    python -m benchmarks.robust                     10⁶ samples on each problem; this takes many minutes
    python -m benchmarks.robust --samples 20000     fewer samples
    python -m benchmarks.robust box --samples 20000 only the proofs; `spread`: only the shares; `route`: only routes

For a `Spread`, the share of samples that satisfy all limits must be from 98.7 to 99.3 % if 99 % are wanted. For a
`Box`, no sample may violate a limit that is proved, and the worst sample must reach at least 97 % of an active limit.
The samples are independent of those of the tuning. The largest values along the paths are refined, not those of a grid.
"""

import argparse
import sys
import time

import jax
import numpy as np

import qtraj as qt
from qtraj.design.robust.box_problem import BoxProblem
from qtraj.design.robust.driven import Samples, driven
from qtraj.design.robust.route_box import RouteBoxProblem
from qtraj.design.robust.to_share import satisfied

BLOCK = 2**15
RANGE, CONSERVATIVE = (0.987, 0.993), 0.97

START, END = qt.BoundaryState([20, 0, 0], [0, 6, 0]), qt.BoundaryState([0, 22, 1], [-6, 0, 0.2])
WIDE = qt.BoundaryState([30, 0, 0], [0, 8, 0]), qt.BoundaryState([0, 26, 0], [-8, 0.5, 0])
BUS, COACH = qt.Vehicle(mass=9000.0), qt.Vehicle(mass=9000.0, drag_area=5.0)

SPREADS = {
    "lateral acceleration": (
        (START, END),
        qt.Limits(lateral_acceleration=1.5),
        qt.Spread(start_velocity=0.1, end_velocity=0.1),
    ),
    "curvature and lateral acceleration": (
        (START, END),
        qt.Limits(curvature=1 / 17, lateral_acceleration=1.5),
        qt.Spread(0.1, 0.1, 0.1, 0.1),
    ),
    "speed and yaw rate": ((START, END), qt.Limits(speed=6.3, yaw_rate=0.28), qt.Spread(0.05, 0.08, 0.05, 0.08)),
    "friction, uncertain": (
        (START, END),
        qt.Limits(friction=0.2, vehicle=BUS),
        qt.Spread(start_velocity=0.05, limits={"friction": 0.01}),
    ),
    "wide turn": (WIDE, qt.Limits(curvature=1 / 24, lateral_acceleration=2.2), qt.Spread(0.2, 0.1, 0.2, 0.1)),
    "mass and drag by wind, uncertain": (
        (START, END),
        qt.Limits(lateral_force=13.5e3, power=20e3, vehicle=COACH),
        qt.Spread(start_velocity=0.05, mass=300.0, drag_area=2.0),
    ),
}
BOXES = {
    "speeds at both ends": (
        (START, END),
        qt.Limits(curvature=1 / 17, lateral_acceleration=1.5),
        qt.Box(start_speed=0.3, end_speed=0.3),
    ),
    "speed, climb, height": (
        (START, END),
        qt.Limits(lateral_acceleration=1.5, slope=0.06),
        qt.Box(start_speed=0.2, start_axial_speed=0.1, end_axial_position=0.1),
    ),
    "speed, mass, friction": (
        (START, END),
        qt.Limits(friction=0.2, power=30e3, vehicle=BUS),
        qt.Box(start_speed=0.2, mass=(0, 1500), limits={"friction": 0.02}),
    ),
    "end speeds, yaw rate": (
        (START, END),
        qt.Limits(yaw_rate=0.28, curvature=1 / 18),
        qt.Box(end_speed=0.3, end_radial_speed=0.2),
    ),
    "speed, drag by wind": (
        (START, END),
        qt.Limits(power=19e3, longitudinal_force=(None, 4e3), vehicle=COACH),
        qt.Box(start_speed=0.2, drag_area=(-2, 8)),
    ),
    "mass, drag by wind": (
        (START, END),
        qt.Limits(power=19e3, friction=0.18, vehicle=COACH),
        qt.Box(mass=(0, 600), drag_area=(-2, 8)),
    ),
    "wide turn": (
        WIDE,
        qt.Limits(curvature=1 / 24, lateral_acceleration=2.2),
        qt.Box(start_speed=0.4, start_radial_speed=0.2),
    ),
}


def turn():
    """A route of four segments on a circle of 20 m."""
    t = np.linspace(0.0, 8.0, 5)
    r = 20 * np.stack([np.sin(0.3 * t), np.cos(0.3 * t), 0 * t], axis=1)
    v = 6 * np.stack([np.cos(0.3 * t), -np.sin(0.3 * t), 0 * t], axis=1)
    return qt.Route(t, r, v, -0.09 * r)


ROUTES = {
    "speeds at both ends": (
        (turn(),),
        qt.Limits(lateral_acceleration=1.6, speed=6.6),
        qt.Box(start_speed=0.1, end_lateral_speed=0.05, end_speed=0.05),
    ),
    "speed, mass, friction": (
        (turn(),),
        qt.Limits(friction=0.18, vehicle=BUS),
        qt.Box(start_speed=0.1, mass=(0, 1000), limits={"friction": 0.01}),
    ),
    "mass, drag by wind": (
        (turn(),),
        qt.Limits(power=19e3, longitudinal_force=(None, 2e3), lateral_force=16e3, vehicle=COACH),
        qt.Box(mass=(0, 600), drag_area=(-2, 8)),
    ),
}


def share_of(states, limits, spread, count):
    """Return the tuning and the share of new samples that satisfy all limits."""
    found = qt.robust_tune(*states, limits, spread, motion="hermite")
    paths, rng, good = driven(found.tuned, limits), np.random.default_rng(1), 0
    for first in range(0, count, BLOCK):
        n = min(BLOCK, count - first)
        samples = Samples(*(rng.standard_normal((n, k)) for k in (12, len(limits.given()), 2)))
        good += int(satisfied(samples, paths, spread).sum())
    return found, good / count


def worst_of(states, limits, box, count):
    """Return the tuning, and the worst value of each limit over random deviations, divided by the limit.

    A tenth of the deviations is at corners and edges of the box, where the worst values are expected.
    """
    if len(states) == 1:
        found = qt.robust_tune_route(*states, limits, box, fixed=np.zeros(5, bool))
        problem = RouteBoxProblem.of(found.tuned.path, limits, box)
    else:
        found = qt.robust_tune(*states, limits, box, motion="hermite")
        problem = BoxProblem.of(found.tuned.path, limits, box)
    rng, worst = np.random.default_rng(1), -np.inf
    for first in range(0, count, BLOCK):
        n = min(BLOCK, count - first)
        unit = rng.random((n, len(box.names)))
        at_end = (rng.random(unit.shape) < 0.7) & (np.arange(n) < n // 10)[:, None]
        unit = np.where(at_end, np.round(unit), unit)
        values = problem.values(box.lowest + (box.highest - box.lowest) * unit)[1]
        worst = np.maximum(worst, values.max(axis=0))
    bounds = [float(x) for x in problem.limits.given().values()]
    return found, dict(zip(problem.limits.given(), worst / bounds, strict=True))


def _chosen(kind, problems, given):
    return [x for x in problems.items() if kind in (given.kinds or [kind]) and given.only in x[0]]


def main(arguments):
    """Print the results, and return the number of problems that fail."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kinds", nargs="*", help="spread, box, route; default: all")
    parser.add_argument("--only", default="", help="only problems whose names contain this text")
    parser.add_argument("--samples", type=int, default=10**6, help="number of samples of each problem")
    given = parser.parse_args(arguments)
    jax.config.update("jax_enable_x64", True)
    failed = 0
    for name, problem in _chosen("spread", SPREADS, given):
        began = time.process_time()
        found, share = share_of(*problem, given.samples)
        good = bool(found.successful) and RANGE[0] <= share <= RANGE[1]
        failed += not good
        seconds = time.process_time() - began
        print(f"spread, {name}: {100 * share:.3f} % of {given.samples} samples; {seconds:.0f} CPU s", flush=True)
    boxes = [("box", *x) for x in _chosen("box", BOXES, given)] + [
        ("route", *x) for x in _chosen("route", ROUTES, given)
    ]
    for kind, name, problem in boxes:
        began = time.process_time()
        found, worst = worst_of(*problem, given.samples)
        good = bool(found.successful) and max(worst.values()) >= CONSERVATIVE and max(worst.values()) <= 1.0
        failed += not good
        texts = ", ".join(f"{key} {100 * x:.4f} %" for key, x in worst.items())
        seconds = time.process_time() - began
        print(
            f"{kind}, {name}: worst of {given.samples} samples: {texts} of the limit; {seconds:.0f} CPU s", flush=True
        )
    print("failed" if failed else "all problems pass")
    return failed


if __name__ == "__main__":
    sys.exit(min(main(sys.argv[1:]), 1))
