"""Tune problems that are feasible only far from their initial paths:  python -m benchmarks.tuning.hard [--problems N]

Each problem has random states on both sides of an axis, and limits on curvature and lateral acceleration. The limits
are the peaks of another path, which has very different boundary velocities and a longer duration, so the problem is
feasible; they are at most `SHARE` of the peaks of the initial path. "sqp" with 8 and with 64 starts is compared with 64
starts of `optax.adam(1e-2)`.
"""

import argparse
import time
from typing import Any

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402
import optax  # noqa: E402

import qtraj as qt  # noqa: E402

SEED = 38
SHARE = 0.6
NAMES = ("curvature", "lateral_acceleration")
EQUAL = 1e-6  # relative difference of objectives that count as equal
WAYS = {"sqp, 8 starts": ("sqp", 8), "sqp, 64 starts": ("sqp", 64), "adam, 64 starts": (optax.adam(1e-2), 64)}


def states(rng: np.random.Generator) -> tuple[Any, ...]:
    """Return positions and velocities at the ends, and a duration [s]."""
    radii, turn = rng.uniform(15, 40, 2), rng.uniform(1.5, 3.0) * rng.choice([-1, 1])
    speed = rng.uniform(5, 9)
    out, along = (np.array([np.cos(turn), np.sin(turn), 0]), np.array([-np.sin(turn), np.cos(turn), 0]))
    first = np.array([rng.normal(0, 2), np.sign(turn) * speed, rng.normal(0, 0.3)])
    last = rng.normal(0, 2) * out + np.sign(turn) * speed * along + [0, 0, rng.normal(0, 0.3)]
    end = radii[1] * out + [0, 0, rng.uniform(-1, 1)]
    return np.array([radii[0], 0, 0]), first, end, last, abs(turn) * np.mean(radii) / speed


def peaks(path: qt.SpiralHelix) -> np.ndarray:
    """Return the largest values of the limited quantities."""
    return np.array([float(qt.peak(path, name)[1]) for name in NAMES])


def problem(rng: np.random.Generator) -> tuple[Any, ...]:
    """Return the states at the ends, the duration and the limits of one problem."""
    while True:
        r0, v0, r1, v1, duration = states(rng)
        before = peaks(qt.SpiralHelix.hermite(qt.BoundaryState(r0, v0), qt.BoundaryState(r1, v1), duration))
        for _ in range(20):
            far = [v + rng.normal(0, 8, 3) * (1, 0.5, 0.1) for v in (v0, v1)]
            longer = duration * rng.uniform(1, 6)
            path = qt.SpiralHelix.hermite(qt.BoundaryState(r0, far[0]), qt.BoundaryState(r1, far[1]), longer)
            found = 1.01 * peaks(path)
            if np.all(found < SHARE * before):
                return r0, v0, r1, v1, duration, found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", type=int, default=40)
    rng = np.random.default_rng(SEED)
    posed = [problem(rng) for _ in range(parser.parse_args().problems)]
    r0, v0, r1, v1, duration, bounds = (np.stack(x) for x in zip(*posed, strict=True))
    starts, ends = (jax.vmap(qt.BoundaryState)(r, v) for r, v in ((r0, v0), (r1, v1)))
    limits = jax.vmap(lambda x: qt.Limits(**dict(zip(NAMES, x, strict=True))))(bounds)
    found, spent = {}, {}
    for label, (method, count) in WAYS.items():
        begun = time.process_time()
        found[label] = qt.tune(starts, ends, limits, motion="hermite", duration=duration, method=method, starts=count)
        spent[label] = (time.process_time() - begun) / len(bounds)
    costs = {label: np.where(best.converged, best.objective, np.inf) for label, best in found.items()}
    least, usual = np.min(list(costs.values()), axis=0), costs["sqp, 8 starts"]
    columns = ("converged, proved", "infeasible", "best of all", "better than sqp, 8", "worse", "CPU time per problem")
    print(f"| {len(bounds)} problems | {' | '.join(columns)} |\n|---|---|---|---|---|---|---|")
    for label, best in found.items():
        own = costs[label]
        counts = (
            np.sum(np.asarray(best.converged) & np.asarray(best.certificate.holds)),
            np.sum([status == "infeasible" for status in best.status]),
            np.sum(own <= least * (1 + EQUAL)),
            np.sum(own < usual * (1 - EQUAL)),
            np.sum(own > usual * (1 + EQUAL)),
        )
        print(f"| {label} | {' | '.join(map(str, counts))} | {spent[label]:.2f} s |", flush=True)
    for k in np.flatnonzero(np.max(list(costs.values()), axis=0) > least * (1 + EQUAL)):
        print(f"    problem {k}: " + ", ".join(f"{label} {own[k]:.8g}" for label, own in costs.items()))


if __name__ == "__main__":
    main()
