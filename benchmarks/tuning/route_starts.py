"""Measure whether more starts help `tune_route`:  python -m benchmarks.tuning.route_starts [--problems N] [--starts N]

Each random route is tuned as usual, which starts from the route itself, and where it enters obstacles, from both sides
of them. Then the search also starts from random routes within the tube (`starts`), with `--adam` after first steps of
`optax.adam(1e-2)`.
"""

import argparse
import time
from typing import Any, NamedTuple

import numpy as np
import optax

import qtraj as qt

SEED = 3
BETTER = 1e-3  # relative difference of objectives that counts; the term that makes "fastest" unique is of this order


class Case(NamedTuple):
    """A route, its limits, and the tube [m]."""

    route: qt.Route
    limits: qt.Limits
    tube: float
    objective: str


def winding(rng: np.random.Generator, count: int) -> qt.Route:
    """Return a winding route of segments of one second."""
    t = np.arange(count + 1.0)
    wave, phase, high, sway = rng.uniform(0.04, 0.09), rng.uniform(0, 6), rng.uniform(3, 7), rng.uniform(-1, 1)

    def position(t: Any) -> np.ndarray:
        s = 8.0 * t + sway * np.sin(0.4 * t)
        return np.stack([s, high * np.sin(wave * s + phase), 0.3 * np.cos(0.02 * s)], axis=-1)

    h = 1e-3
    before, here, after = position(t - h), position(t), position(t + h)
    return qt.Route(t, here, (after - before) / (2 * h), (after - 2 * here + before) / h**2)


def within(route: qt.Route, rng: np.random.Generator, least: float, most: float) -> qt.Limits:
    """Return limits that the route violates: random fractions of its largest values, away from its ends."""
    names = ("curvature", "lateral_acceleration")
    t = np.linspace(0, float(np.asarray(route.duration)), 2001)
    table = qt.evaluate(route, t, names)
    ends = {name: float(np.max(np.asarray(table.values[name])[[0, -1]])) for name in names}
    peak = {name: float(np.max(np.asarray(table.values[name]))) for name in names}
    curvature, lateral = (max(1.02 * ends[name], rng.uniform(least, most) * peak[name]) for name in names)
    return qt.Limits(curvature=curvature, lateral_acceleration=lateral, speed=9.5)


def blocked(route: qt.Route, rng: np.random.Generator, count: int) -> list[Any]:
    """Return vertical cylinders on or beside the route."""
    times = np.sort(rng.uniform(0.2, 0.8, count)) * float(np.asarray(route.duration))
    points = np.asarray(route.sampled(times, 0)[0]) + rng.normal(0, [0.3, 0.6, 0], (count, 3))
    return [qt.Cylinder(p, [0, 0, 1.0], rng.uniform(0.3, 0.8)) for p in points]


def cases(kind: str, count: int) -> list[Case]:
    """Return random problems of one kind, reproducible."""
    rng, found = np.random.default_rng([SEED, *map(ord, kind)]), []
    for k in range(count):
        route = winding(rng, int(rng.integers(8, 13)))
        objective = ("nearest", "fastest", "smoothest")[k % 3]
        if kind == "limits":
            own = within(route, rng, 0.7, 0.95)
            found.append(Case(route, own, rng.uniform(0.5, 3), objective))
        elif kind == "tight":
            own = within(route, rng, 0.5, 0.8)
            found.append(Case(route, own, rng.uniform(0.2, 1.0), objective))
        else:
            clear = blocked(route, rng, int(rng.integers(1, 4 if kind == "obstacles" else 7)))
            own = qt.Limits(curvature=0.15, speed=9.5, keep_out=clear, body=[(0.0, 0.4)])
            found.append(Case(route, own, rng.uniform(1.5, 3), objective))
    return found


def compared(case: Case, more: dict[str, Any]) -> tuple[list[Any], list[float]]:
    """Return the results of the usual call and of a call with more starts, and their processor times [s]."""
    found, spent = [], []
    for options in ({}, more):
        begun = time.process_time()
        found.append(qt.tune_route(case.route, case.limits, case.tube, case.objective, **options))
        spent.append(time.process_time() - begun)
    return found, spent


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", type=int, default=20, help="number of problems of each kind")
    parser.add_argument("--starts", type=int, default=9, help="number of starts")
    parser.add_argument("--adam", action="store_true", help="first steps by optax.adam(1e-2)")
    parser.add_argument("--kinds", nargs="*", default=["limits", "tight", "obstacles", "many obstacles"])
    chosen = parser.parse_args()
    more: dict[str, Any] = {"starts": chosen.starts} | ({"method": optax.adam(1e-2)} if chosen.adam else {})
    print("| problems | solved with one start | only with more | better with more | CPU time | with more |")
    print("|---|---|---|---|---|---|")
    for kind in chosen.kinds:
        counts, times = np.zeros(3, int), []
        for k, case in enumerate(cases(kind, chosen.problems)):
            try:
                (one, best), spent = compared(case, more)
            except ValueError:  # an end inside an obstacle
                continue
            times.append(spent)
            only = bool(best.converged) and not one.converged
            better = one.converged and best.converged and best.objective < one.objective * (1 - BETTER)
            counts += (bool(one.converged), only, bool(better))
            if only or better:
                print(f"    {kind} {k}, {case.objective}: {one.objective:.6g}, {best.objective:.6g}", flush=True)
        ms = " | ".join(f"{x:.2f} s" for x in np.mean(times, axis=0))
        print(f"| {len(times)} {kind} | {' | '.join(map(str, counts))} | {ms} |", flush=True)


if __name__ == "__main__":
    main()
