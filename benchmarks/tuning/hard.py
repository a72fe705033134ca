"""Count the problems that few starts miss:  python -m benchmarks.tuning.hard [--problems N] [--find N]

All problems have random states on both sides of an axis, and limits on curvature and lateral acceleration.

- "random": the limits are random shares of the peaks of the initial path, and the duration is at most half as long
  again. Some of these problems have no solution.
- "hard": the limits are 1 % above the peaks of a path that a random search found, at most `SHARE` of the peaks of the
  initial path. So each problem is feasible, but only far from its initial path. There are three families:
  "climb", large rises with a limit on slope, so that only wide detours are feasible; "chord", the same between near
  points with opposite radial velocities; and "against", initial velocities along the radius. `MISSED` lists all
  problems among the first of each family for which no search from a planned start finds a solution, so that
  `starts_tried` exceeds `PLANNED`; `--find` lists them anew. The set consists of these and of the `FURTHER` first
  others of each family.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402
import optax  # noqa: E402
from numpy.polynomial import polynomial  # noqa: E402

import qtraj as qt  # noqa: E402

SEED = 38
NAMES = ("curvature", "lateral_acceleration", "slope")
RANDOM, SHARES, LONGER = 100, (0.3, 0.8), 1.5
TRIED, ROUNDS, EACH = 300, 60, 32  # random paths, and rounds of random changes of the best one
STEP, NARROWED = 0.3, 0.8  # size of these changes, which is multiplied by the second number if all are worse
SHARE, MARGIN = 0.7, 1.01
SCATTER = np.array(
    [8.0, 4.0, 0.8, 8.0, 4.0, 0.8, 0.5]
)  # of V_rho, V_phi and V_h [m/s] at both ends, and of ln(duration)
DURATIONS = {"climb": (0.7, 6.0), "chord": (1.0, 12.0), "against": (0.1, 1.5)}  # bounds, in initial durations
STREAM = {"climb": 3, "against": 4, "chord": 5}  # of random numbers
MISSED = {"climb": (2, 13, 25, 47, 50, 58), "chord": (0, 4, 16), "against": (5, 20, 108, 135, 171, 187, 202)}
SEARCHED = {"climb": 60, "chord": 60, "against": 260}
FURTHER = {"climb": 8, "chord": 8, "against": 8}
PLANNED = 11  # starts, with the slow ones
EQUAL = 1e-6  # relative difference of objectives that count as equal
INSTANTS = np.linspace(0.0, 1.0, 129)
WAYS = {"sqp, 8 starts": ("sqp", 8), "sqp, 64 starts": ("sqp", 64), "adam, 64 starts": (optax.adam(1e-2), 64)}


class Posed(NamedTuple):
    """One problem or a batch: world states at both ends, initial duration and its bounds [s], and the limits."""

    position: Any
    velocity: Any
    end_position: Any
    end_velocity: Any
    duration: Any
    bounds: Any
    limits: Any


class Turn(NamedTuple):
    """Cylindrical data of a path: radii, turn and rise between the ends, velocities at both ends, duration."""

    radii: np.ndarray
    turn: float
    rise: float
    first: np.ndarray
    last: np.ndarray
    duration: Any

    def peaks(self) -> np.ndarray:
        """Return the largest curvature, lateral acceleration and slope at the samples; infinite near the axis."""
        t, (a, b) = self.duration, self.radii
        first, last = self.first * t, self.last * t
        r, r1, r2 = _cubic(a, first[0], b, last[0])
        _, f1, f2 = _cubic(0.0, first[1] / a, self.turn, last[1] / b)
        _, h1, h2 = _cubic(0.0, first[2], self.rise, last[2])
        v = np.stack([r1, r * f1, h1]) / t
        acceleration = np.stack([r2 - r * f1**2, r * f2 + 2 * r1 * f1, h2]) / t**2
        speed, cross = np.linalg.norm(v, axis=0), np.linalg.norm(np.cross(v, acceleration, axis=0), axis=0)
        curvature, lateral = (cross / np.maximum(speed, 1e-6) ** k for k in (3, 1))
        slope = np.abs(v[2]) / np.maximum(np.hypot(v[0], v[1]), 1e-6)
        return np.where(r.min(axis=0) < 2.0, np.inf, np.stack([curvature, lateral, slope]).max(axis=1))

    def posed(self, bounds: Sequence[float], limits: np.ndarray) -> Posed:
        """Return the problem in world axes, with bounds on the duration divided by the initial one."""
        c, s = np.cos(self.turn), np.sin(self.turn)
        turned = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        start, end = np.array([self.radii[0], 0, 0]), turned @ [self.radii[1], 0, 0] + [0, 0, self.rise]
        durations = self.duration * np.asarray(bounds)
        return Posed(start, self.first, end, turned @ self.last, self.duration, durations, limits)


def _cubic(x: Any, slope: Any, end: Any, end_slope: Any) -> tuple[np.ndarray, ...]:
    """Return a cubic Hermite polynomial at the samples, and its first two derivatives in the fraction of time."""
    rise = end - x
    parts = x + 0 * rise, slope, 3 * rise - 2 * slope - end_slope, slope + end_slope - 2 * rise
    c = np.stack(np.broadcast_arrays(*parts))
    return tuple(polynomial.polyval(INSTANTS, polynomial.polyder(c, k)).T for k in range(3))


def initial(rng: np.random.Generator) -> Turn:
    """Return random data of an initial path."""
    radii, turn, speed = rng.uniform(15, 40, 2), rng.uniform(1.5, 3.0) * rng.choice([-1, 1]), rng.uniform(5, 9)
    first, last = (np.array([rng.normal(0, 2), np.sign(turn) * speed, rng.normal(0, 0.3)]) for _ in range(2))
    return Turn(radii, turn, rng.uniform(-1, 1), first, last, abs(turn) * radii.mean() / speed)


def random(index: int) -> Posed:
    """Return a problem whose limits are random shares of the peaks of its initial path."""
    rng = np.random.default_rng((SEED, 0, index))
    turn = initial(rng)
    return turn.posed((0.5, LONGER), rng.uniform(*SHARES, 2) * turn.peaks()[:2])


def family(name: str, rng: np.random.Generator) -> Turn:
    """Return random data of an initial path of a hard problem."""
    sense, radii, speed = rng.choice([-1, 1]), rng.uniform(15, 40, 2), rng.uniform(5, 9)
    turn, rise = rng.uniform(1.5, 3.0) * sense, rng.uniform(-1, 1)
    first, last = (np.array([rng.normal(0, 2), sense * speed, rng.normal(0, 0.3)]) for _ in range(2))
    if name == "climb":
        rise = rng.uniform(6, 15) * rng.choice([-1, 1])
    if name == "chord":
        turn = rng.uniform(0.15, 0.6) * sense
        first[0], last[0] = rng.choice([-1, 1], 2) * rng.uniform(3, 8, 2)
        rise = rng.uniform(2, 8) * rng.choice([-1, 1])
    if name == "against":
        first, last = (
            np.array([rng.choice([-1, 1]) * rng.uniform(5, 9), sense * rng.uniform(0.3, 1), rng.normal(0, 0.3)])
            for _ in range(2)
        )
    return Turn(radii, turn, rise, first, last, abs(turn) * radii.mean() / speed)


def hard(name: str, index: int) -> Posed:
    """Return a problem of a family that is feasible far from its initial path."""
    rng = np.random.default_rng((SEED, STREAM[name], index))
    used, low_high = 2 if name == "against" else 3, DURATIONS[name]
    while True:
        turn = family(name, rng)
        before = turn.peaks()[:used]
        if not np.all(np.isfinite(before)):
            continue
        weights = before * rng.uniform(0.5, 1, used)

        def peaks(x: np.ndarray, turn: Turn = turn) -> np.ndarray:
            shape = (3, *x.shape[1:])
            first, last = x[:3].reshape(shape), x[3:6].reshape(shape)
            return turn._replace(first=first, last=last, duration=np.exp(x[6])).peaks()[:used]

        found = peaks(least(peaks, weights, turn, turn.duration * np.array(low_high), rng))
        if MARGIN * np.max(found / before) < SHARE:
            return turn.posed(low_high, MARGIN * found)


def least(peaks: Any, weights: np.ndarray, turn: Turn, bounds: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the variables of a path with small peaks, relative to the weights, by a random search."""
    scatter = SCATTER[:, None]

    def worst(x: np.ndarray) -> np.ndarray:
        inside = (np.exp(x[6]) >= bounds[0]) & (np.exp(x[6]) <= bounds[1])
        return np.where(inside, np.max(peaks(x) / weights[:, None], axis=0), np.inf)

    velocities = np.concatenate([turn.first, turn.last])[:, None] + scatter[:6] * rng.normal(size=(6, TRIED))
    x = np.concatenate([velocities, np.log(rng.uniform(bounds[0], bounds[1], (1, TRIED)))])
    best, size = x[:, np.argmin(worst(x))], STEP
    value = worst(best[:, None])[0]
    for _ in range(ROUNDS):
        x = best[:, None] + size * scatter * rng.normal(size=(7, EACH))
        values = worst(x)
        k = np.argmin(values)
        if values[k] < value:
            best, value = x[:, k], values[k]
        else:
            size *= NARROWED
    return best


def tuned(problems: Sequence[Posed], method: Any, starts: int) -> tuple[qt.Tuned, float]:
    """Return the results of a batch, and the CPU time per problem [s], with the compilation of an optimiser."""
    p = Posed(*(np.stack(x) for x in zip(*problems, strict=True)))
    begins, ends = jax.vmap(qt.BoundaryState)(*p[:2]), jax.vmap(qt.BoundaryState)(*p[2:4])
    limits = jax.vmap(lambda x: qt.Limits(**dict(zip(NAMES, x, strict=False))))(p.limits)
    options: Any = {"motion": "hermite", "duration": p.duration, "bounds": {"duration": tuple(p.bounds.T)}}
    begun = time.process_time()
    best = qt.tune(begins, ends, limits, method=method, starts=starts, **options)
    return best, (time.process_time() - begun) / len(problems)


def costs(best: qt.Tuned) -> np.ndarray:
    """Return the objectives of a batch, infinite where the search did not converge."""
    return np.where(np.asarray(best.converged), np.asarray(best.objective), np.inf)


def compare(sets: dict[str, Sequence[Posed]]) -> None:
    """Print a table for sets of problems, and the problems with different results."""
    columns = ("converged, proved", "infeasible", "best of all", "better than sqp, 8", "worse", "CPU time per problem")
    print(f"| problems | method | {' | '.join(columns)} |\n|---|---|---|---|---|---|---|---|", flush=True)
    for name, problems in sets.items():
        found = {label: tuned(problems, *way) for label, way in WAYS.items()}
        own = {label: costs(best) for label, (best, _) in found.items()}
        smallest, usual = np.min(list(own.values()), axis=0), own["sqp, 8 starts"]
        for label, (best, spent) in found.items():
            counts = (
                np.sum(np.asarray(best.converged) & np.asarray(best.certificate.holds)),
                np.sum(best.status == "infeasible"),
                np.sum(own[label] <= smallest * (1 + EQUAL)),
                np.sum(own[label] < usual * (1 - EQUAL)),
                np.sum(own[label] > usual * (1 + EQUAL)),
            )
            print(f"| {len(problems)} {name} | {label} | {' | '.join(map(str, counts))} | {spent:.2f} s |", flush=True)
        for k in np.flatnonzero(np.max(list(own.values()), axis=0) > smallest * (1 + EQUAL)):
            print(f"    {name} {k}: " + ", ".join(f"{label} {x[k]:.8g}" for label, x in own.items()), file=sys.stderr)


def missed(name: str, count: int) -> list[int]:
    """Return the problems of a family for which no search from a planned start finds a solution."""
    best, _ = tuned([hard(name, k) for k in range(count)], "sqp", 8)
    return np.flatnonzero(np.asarray(best.starts_tried) > PLANNED).tolist()


def hard_set() -> dict[str, list[int]]:
    """Return the numbers of the hard problems of each family."""
    others = {name: [k for k in range(SEARCHED[name]) if k not in MISSED[name]] for name in MISSED}
    return {name: [*MISSED[name], *others[name][: FURTHER[name]]] for name in MISSED}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", type=int, help="number of problems of each set, by default all")
    parser.add_argument("--find", type=int, metavar="N", help="instead, list `MISSED` among the first N at most")
    chosen = parser.parse_args()
    if chosen.find is not None:
        for name, count in SEARCHED.items():
            print(name, missed(name, min(count, chosen.find)), flush=True)
        return
    sets = {"random": [random(k) for k in range(RANDOM)]}
    sets |= {f"hard, {name}": [hard(name, k) for k in numbers] for name, numbers in hard_set().items()}
    compare({name: problems[: chosen.problems] for name, problems in sets.items()})


if __name__ == "__main__":
    main()
