"""Count the problems that few starts miss:  python -m benchmarks.tuning.hard [--problems N] [--find N]

All problems have random states on both sides of an axis, and limits on curvature and lateral acceleration.

- "random": the limits are random shares of the peaks of the initial path, and the duration is at most half as long
  again. Some of these problems have no solution.
- "hard": the limits are the peaks of the best of `TRIED` random paths, which have very different velocities and up to
  six times the duration. So each problem is feasible, but only far from its initial path. `HARD` are the first ones,
  and all others among 450 for which one search from the initial path misses the optimum that 8 starts find; `--find`
  lists the latter.
"""

import argparse
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
NAMES = ("curvature", "lateral_acceleration")
RANDOM, SHARES, LONGER = 100, (0.3, 0.8), 1.5
TRIED, LONGEST, SHARE = 300, 6.0, 0.8
SCATTER = np.array([8.0, 4.0, 0.8])  # standard deviation [m/s] of the changes of V_rho, V_phi and V_h
HARD = (*range(34), 37, 57, 158, 161, 254, 421)  # the last six, 26 and 32 by `--find 450`
EQUAL = 1e-6  # relative difference of objectives that count as equal
INSTANTS = np.linspace(0.0, 1.0, 129)
WAYS = {"sqp, 8 starts": ("sqp", 8), "sqp, 64 starts": ("sqp", 64), "adam, 64 starts": (optax.adam(1e-2), 64)}


class Posed(NamedTuple):
    """One problem or a batch: world states at both ends, initial and maximum duration [s], and the limits."""

    position: Any
    velocity: Any
    end_position: Any
    end_velocity: Any
    duration: Any
    longest: Any
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
        """Return the largest curvature and lateral acceleration at the samples; infinite near the axis."""
        t, (a, b) = self.duration, self.radii
        first, last = self.first.T * t, self.last.T * t
        r, r1, r2 = _cubic(a, first[0], b, last[0])
        _, f1, f2 = _cubic(0.0, first[1] / a, self.turn, last[1] / b)
        _, h1, h2 = _cubic(0.0, first[2], self.rise, last[2])
        v = np.stack([r1, r * f1, h1]) / t
        acceleration = np.stack([r2 - r * f1**2, r * f2 + 2 * r1 * f1, h2]) / t**2
        speed, cross = np.linalg.norm(v, axis=0), np.linalg.norm(np.cross(v, acceleration, axis=0), axis=0)
        found = np.stack([cross / np.maximum(speed, 1e-6) ** k for k in (3, 1)])
        return np.where(r.min(axis=0) < 2.0, np.inf, found.max(axis=1))

    def posed(self, longest: float, limits: np.ndarray) -> Posed:
        """Return the problem in world axes."""
        c, s = np.cos(self.turn), np.sin(self.turn)
        turned = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        start, end = np.array([self.radii[0], 0, 0]), turned @ [self.radii[1], 0, 0] + [0, 0, self.rise]
        return Posed(start, self.first, end, turned @ self.last, self.duration, longest * self.duration, limits)


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
    return turn.posed(LONGER, rng.uniform(*SHARES, 2) * turn.peaks())


def far(index: int) -> Posed:
    """Return a problem that is feasible far from its initial path."""
    rng = np.random.default_rng((SEED, 1, index))
    while True:
        turn = initial(rng)
        first, last = (v + SCATTER * rng.normal(size=(TRIED, 3)) for v in (turn.first, turn.last))
        durations = turn.duration * rng.uniform(0.7, LONGEST, TRIED)
        found, before = turn._replace(first=first, last=last, duration=durations).peaks(), turn.peaks()
        ratio = np.max(found / before[:, None], axis=0)
        best = np.argmin(ratio)
        if ratio[best] < SHARE and np.all(np.isfinite(before)):
            return turn.posed(LONGEST, 1.01 * found[:, best])


def tuned(problems: Sequence[Posed], method: Any, starts: int) -> tuple[qt.Tuned, float]:
    """Return the results of a batch, and the CPU time per problem [s], with the compilation of an optimiser."""
    p = Posed(*(np.stack(x) for x in zip(*problems, strict=True)))
    begins, ends = jax.vmap(qt.BoundaryState)(*p[:2]), jax.vmap(qt.BoundaryState)(*p[2:4])
    limits = jax.vmap(lambda x: qt.Limits(**dict(zip(NAMES, x, strict=True))))(p.limits)
    options: Any = {"motion": "hermite", "duration": p.duration, "bounds": {"duration": (p.duration / 2, p.longest)}}
    begun = time.process_time()
    best = qt.tune(begins, ends, limits, method=method, starts=starts, **options)
    return best, (time.process_time() - begun) / len(problems)


def costs(best: qt.Tuned) -> np.ndarray:
    """Return the objectives of a batch, infinite where the search did not converge."""
    return np.where(np.asarray(best.converged), np.asarray(best.objective), np.inf)


def compare(name: str, problems: Sequence[Posed]) -> None:
    """Print a table, and the problems with different results."""
    columns = ("converged, proved", "infeasible", "best of all", "better than sqp, 8", "worse", "CPU time per problem")
    print(f"| {len(problems)} {name} problems | {' | '.join(columns)} |\n|---|---|---|---|---|---|---|", flush=True)
    found = {label: tuned(problems, *way) for label, way in WAYS.items()}
    own = {label: costs(best) for label, (best, _) in found.items()}
    least, usual = np.min(list(own.values()), axis=0), own["sqp, 8 starts"]
    for label, (best, spent) in found.items():
        counts = (
            np.sum(np.asarray(best.converged) & np.asarray(best.certificate.holds)),
            np.sum(best.status == "infeasible"),
            np.sum(own[label] <= least * (1 + EQUAL)),
            np.sum(own[label] < usual * (1 - EQUAL)),
            np.sum(own[label] > usual * (1 + EQUAL)),
        )
        print(f"| {label} | {' | '.join(map(str, counts))} | {spent:.2f} s |", flush=True)
    for k in np.flatnonzero(np.max(list(own.values()), axis=0) > least * (1 + EQUAL)):
        print(f"    problem {k}: " + ", ".join(f"{label} {x[k]:.8g}" for label, x in own.items()), flush=True)


def find(first: int, last: int) -> list[int]:
    """Return the problems for which one search from the initial path misses the optimum that 8 starts find."""
    problems = [far(k) for k in range(first, last)]
    one, more = (costs(tuned(problems, "sqp", starts)[0]) for starts in (1, 8))
    return [first + int(k) for k in np.flatnonzero(one > more * (1 + EQUAL))]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", type=int, help="number of problems of each set, by default all")
    parser.add_argument("--find", type=int, metavar="N", help="instead, list the hard problems among the first N")
    given = parser.parse_args()
    if given.find is not None:
        for first in range(0, given.find, 50):
            print(*find(first, min(first + 50, given.find)), sep=", ", flush=True)
        return
    count = given.problems
    compare("random", [random(k) for k in range(RANDOM)][:count])
    print()
    compare("hard", [far(k) for k in HARD][:count])


if __name__ == "__main__":
    main()
