"""Check limits with two sides, zones, own quantities and obstacles against dense samples with 50 digits.

    python -m benchmarks.limits_against_sampling [--limits 2000] [--obstacles 300] [--seed 0]

The paths are random spiral-helices, routes and timings. Each limit has two sides, the smallest and the largest value of
a quantity on the path times 1 ± 1e-9. These extremes are found among dense samples and refined with 50 digits, by
formulas of their own (`exact_motion`). The wider limit must be proved, and the narrower one broken, on both sides. With
a third limit, whose sides differ from the extremes by 1e-12 to 0.3, no status may be contradicted. In zones, the
distance is known to 2e-9 of the length, so the wider limit is satisfied, and the narrower one violated, wherever within
this uncertainty the zones begin. Linear limits along the way differ by 1e-5 instead of 1e-9, see docs/howto/limits.md.

Each obstacle is next to a path, and the radius of the body is its exact distance times 1 ± 1e-9
(`obstacles_against_sampling`). The exit code is 1 if a status is wrong.
"""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import jax
import mpmath
import numpy as np

import qtraj as qt
from qtraj.path.quantity import quantity
from qtraj.path.sides import upper_side

from . import exact_motion, obstacles_against_sampling
from .exact_motion import FORMULAS, Distances, Forms, Piece
from .extremes import Span, largest
from .random_quantities import INVARIANT, OF_SHAPE, WORLD, quantity_of, random_function, value_of

PATHS, KINDS = ("helix", "route", "timing"), ("two sides", "zones", "own")
CLOSE = 1e-9
"""Relative difference between the decided limits and the extremes."""

BORDER = 2e-9
"""Uncertainty of a distance, as a fraction of the length."""

SMALLEST, LARGEST = 1e-12, 0.3
TINY = 1e-6
"""An extreme below this part of the largest magnitude has no limit, because its relative difference is meaningless."""

PER_PATH = 4
"""Number of limits on each path."""

CAR = qt.Vehicle(mass=1200.0, wheelbase=exact_motion.WHEELBASE)
ON_TIMING = (
    *("speed", "longitudinal_acceleration", "yaw_rate", "yaw_acceleration", "vertical_speed", "vertical_acceleration"),
    *("curvature_rate", "slope", "horizontal_curvature", "sharpness", "height", "curvature", "steering_angle"),
)
ANYWHERE = tuple(name for name in FORMULAS if name != "torsion")
"""Quantities with two sides that are proved on timings, and those on routes, which have inflections."""

Value = Callable[[int, Any, Any], Any]
"""A quantity of piece k at x, in an arithmetic."""


class Path(NamedTuple):
    kind: str
    path: Any
    pieces: list[Piece]

    def whole(self) -> list[Span]:
        return [Span(k, 0.0, piece.length) for k, piece in enumerate(self.pieces)]


class Case(NamedTuple):
    """Limits on one quantity.

    `least` are lower bounds, and `most` upper bounds, of the largest factor of the limit with which each side is
    violated. `limits` makes the limits from a factor for each of the `sides`.
    """

    kind: str
    path: Path
    sides: tuple[str, ...]
    least: list[Any]
    most: list[Any]
    close: float
    limits: Callable[[list[float]], qt.Limits]


def random_path(rng: np.random.Generator, kind: str) -> Path:
    if kind == "timing":
        base = random_path(rng, str(rng.choice(PATHS[:2])))
        limits = {"speed": rng.uniform(5, 9), "lateral_acceleration": rng.uniform(1, 4)}
        limits["longitudinal_acceleration"] = (-rng.uniform(1, 4), rng.uniform(0.5, 3))
        limits |= {"jerk": rng.uniform(2, 6)} if rng.random() < 0.5 else {}
        timed = qt.retime(base.path, qt.Limits(**limits), knots=64).path
        return Path(kind, timed, exact_motion.of_timing(timed, base.pieces))
    if kind == "route":
        n = 4
        times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.8, 2.0, n - 1))])
        states = rng.normal(size=(3, n, 3)) + np.array([[5.0, 0, 0], [4.0, 0, 0], [0.0, 0, 0]])[:, None]
        route = qt.Route(times, np.cumsum(states[0], axis=0), *states[1:])
        return Path(kind, route, exact_motion.of_route(route))
    radius, height = [rng.uniform(5, 20), *rng.normal(size=2) * 0.2], [rng.normal(), *rng.normal(size=3) * 0.2]
    angle = [rng.normal(), rng.uniform(0.3, 0.8) * rng.choice([-1, 1]), rng.normal() * 0.03]
    helix = qt.SpiralHelix(radius, angle, height, rng.uniform(2.0, 5.0))
    return Path(kind, helix, exact_motion.of_helix(helix))


def of_registry(rng: np.random.Generator, path: Path) -> tuple[Value, Any, bool]:
    """Return a random quantity of the registry as a function, its name, and whether it is never negative."""
    names = {"helix": tuple(FORMULAS), "route": ANYWHERE, "timing": ON_TIMING}[path.kind]
    name = str(rng.choice(names))
    formula = FORMULAS[name]

    def value(k: int, x: Any, arithmetic: Any) -> Any:
        return formula(Forms(path.pieces[k].motion(x), arithmetic)) + 0 * x

    return value, name, quantity(name).component is None


def of_own(rng: np.random.Generator, path: Path) -> tuple[Value, Any, bool] | None:
    """Return a random quantity of one's own in the same way, or None if the random function is none."""
    function = random_function(rng, {"helix": INVARIANT, "route": WORLD, "timing": OF_SHAPE}[path.kind])
    own = quantity_of(function)
    if own is None:
        return None
    assert own.provable

    def value(k: int, x: Any, arithmetic: Any) -> Any:
        piece = path.pieces[k]
        rows = (piece.derivatives if path.kind == "timing" else piece.motion)(x)
        return value_of(function, rows, arithmetic) + 0 * x

    return value, own, own.entries["mine"].component is None


def plain_case(rng: np.random.Generator, kind: str, path: Path) -> Case | None:
    """Return a case with one value for the whole path."""
    made = of_registry(rng, path) if kind == "two sides" else of_own(rng, path)
    if made is None:
        return None
    value, key, positive = made
    ends = [largest(path.whole(), value, side) for side in (-1, 1)]
    size = max(abs(x) for x in ends)
    known = [abs(x) > TINY * size for x in ends]
    if size == 0 or ends[1] + ends[0] < TINY * size:  # a constant has no narrower limit
        return None
    known[0] &= not positive or -ends[0] > TINY * size
    known[1] &= not positive or ends[1] > 0
    factors = [x for x, own in zip(ends, known, strict=True) if own]
    names = _sides(key) if isinstance(key, str) else (f"{key.name}_min", key.name if positive else f"{key.name}_max")

    def limits(bounds: list[float]) -> qt.Limits:
        given = iter(bounds)
        pair = (-next(given) if known[0] else None, next(given) if known[1] else None)
        if isinstance(key, str):
            return qt.Limits(**{key: pair}, vehicle=CAR if key.startswith("steering") else None)
        return qt.Limits(own={key: pair})

    sides = tuple(name for name, own in zip(names, known, strict=True) if own)
    return Case(kind, path, sides, factors, factors, CLOSE, limits) if sides else None


def _sides(name: str) -> tuple[str, str]:
    return f"{name}_min", upper_side(quantity(name))


def zones_case(rng: np.random.Generator, path: Path) -> Case | None:
    """Return a case with an upper limit, and a lower one if the quantity is negative somewhere, in random zones."""
    value, name, positive = of_registry(rng, path)
    on, form = Distances(path.pieces), str(rng.choice(["step", "step", "linear"]))
    at = np.append(0.0, np.sort(rng.uniform(0.05, 0.95, rng.integers(1, 4)))) * on.length
    spread = [abs(largest(path.whole(), value, side, precise=False)) for side in (-1, 1)]
    least, most, weights = [], [], []
    for side in (-1, 1):
        weight = max(spread) * rng.uniform(0.4, 1.6, at.size)
        ends = [
            _largest_in_zones(path, value, side, on, at, weight, form, BORDER * on.length * sign) for sign in (-1, 1)
        ]
        if form == "linear":  # the uncertainty of the distance is one of the limit
            slope = np.max(np.abs(np.diff(weight)) / np.diff(at) / np.minimum(weight[1:], weight[:-1]))
            ends = [
                x + sign * abs(x) * float(slope) * BORDER * on.length for x, sign in zip(ends, (-1, 1), strict=True)
            ]
        weights.append(weight)
        least.append(ends[0])
        most.append(ends[1])
    known = [not positive and least[0] > 0.01, least[1] > 0.01]
    if not any(known):
        return None

    def limits(factors: list[float]) -> qt.Limits:
        given = iter(factors)
        lower = qt.Along(at, -next(given) * weights[0], form) if known[0] else None
        upper = qt.Along(at, next(given) * weights[1], form) if known[1] else None
        return qt.Limits(**{name: (lower, upper)}, vehicle=CAR if name.startswith("steering") else None)

    widest = 1.1 * max(np.max(f * w) for f, w in zip(least, weights, strict=True))
    if (part := quantity(name).tangent_of) and widest > part * np.pi / 2:
        return None  # not the limit of an angle
    sides = tuple(x for x, own in zip(_sides(name), known, strict=True) if own)
    own = ([x for x, k in zip(ends, known, strict=True) if k] for ends in (least, most))
    return Case("zones", path, sides, *own, CLOSE, limits)


def _largest_in_zones(
    path: Path, value: Value, side: int, on: Distances, at: Any, weight: Any, form: str, wider: float
) -> Any:
    """Return the largest ratio of a quantity to its limit; each zone is wider by a distance [m] on both sides."""

    def ratio(k: int, x: Any, arithmetic: Any) -> Any:
        s = on.at(k, np.atleast_1d(np.asarray(x, float)))
        limit = np.interp(s, at, weight)
        return value(k, x, arithmetic) / (limit if isinstance(x, np.ndarray) else float(limit[0]))

    if form == "linear":
        return largest(path.whole(), ratio, side)
    found = []
    for start, end, own in zip(at, np.append(at[1:], np.inf), weight, strict=True):
        spans = [
            Span(k, *span)
            for k in range(len(path.pieces))
            if (span := on.span(k, max(start - wider, 0.0), end + wider)) and span[1] >= span[0]
        ]
        found.append(largest(spans, value, side) / float(own))
    return max(found)


def cases(rng: np.random.Generator, count: int) -> Iterator[Case]:
    """Return this number of random cases, of each kind and on each kind of path in turn."""
    made, path = 0, random_path(rng, PATHS[0])
    while made < count:
        kind = KINDS[made % len(KINDS)]
        if made % PER_PATH == 0:
            path = random_path(rng, PATHS[(made // PER_PATH) % len(PATHS)])
        case = zones_case(rng, path) if kind == "zones" else plain_case(rng, kind, path)
        if case is not None:
            made += 1
            yield case


def signed(x: Any, change: float) -> float:
    """Return a factor that is larger by a relative change, also if it is negative."""
    return float(x + change * abs(x))


def wrong_statuses(rng: np.random.Generator, case: Case) -> tuple[list[str], Counter]:
    """Return descriptions of wrong statuses of a case, and how often its limits had each status."""
    wrong, counts = [], Counter()
    beside = 10 ** rng.uniform(np.log10(SMALLEST), np.log10(LARGEST), len(case.sides)) * rng.choice(
        [-1, 1], len(case.sides)
    )
    wider = [signed(x, case.close) for x in case.most]
    narrower = [signed(x, -case.close) for x in case.least]
    other = [signed(x, d) for x, d in zip(case.most, beside, strict=True)]
    for factors, expected in ((wider, "proved"), (narrower, "broken"), (other, None)):
        try:
            found = qt.certify(case.path.path, case.limits(factors)).status
        except ValueError as error:  # the random sides contradict each other
            if expected is None and ("lower" in str(error) or "angle" in str(error)):
                continue
            raise
        for side, factor, least, most in zip(case.sides, factors, case.least, case.most, strict=True):
            status = found[side]
            counts[status] += 1
            false = (status == "proved" and factor < least) or (status == "broken" and factor >= most)
            if false or (expected is not None and status != expected):
                wrong.append(
                    f"{case.kind} on {case.path.kind}: {side} is {status}, not {expected}: {case.limits(factors)}"
                )
    return wrong, counts


def check_limits(seed: int, count: int) -> tuple[list[str], Counter]:
    """Check random limits; return descriptions of wrong statuses, and counts of cases and statuses."""
    rng, wrong, counts = np.random.default_rng(seed), [], Counter()
    with mpmath.workdps(50):
        for case in cases(rng, count):
            bad, statuses = wrong_statuses(rng, case)
            wrong += bad
            counts += Counter({(case.kind, case.path.kind): 1}) + Counter(
                {("status", x): n for x, n in statuses.items()}
            )
            print(*bad, sep="\n", end="\n" if bad else "", flush=True)
            if (done := sum(n for key, n in counts.items() if key[0] != "status")) % 100 == 0:
                print(f"{done} limits, {len(wrong)} wrong statuses", file=sys.stderr, flush=True)
    return wrong, counts


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--limits", type=int, default=2000, help="number of limits")
    parser.add_argument("--obstacles", type=int, default=300, help="number of obstacles")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    begun = time.process_time()
    wrong, counts = check_limits(options.seed, options.limits)
    for (kind, path), n in sorted(counts.items()):
        print(f"{kind}, {path}: {n}")
    print(
        f"{options.limits} limits, {len(wrong)} wrong statuses, {time.process_time() - begun:.0f} s of processor time"
    )
    begun = time.process_time()
    entered, text = obstacles_against_sampling.check(options.seed, options.obstacles)
    print(f"{text}, {time.process_time() - begun:.0f} s of processor time")
    return int(bool(wrong or entered))


if __name__ == "__main__":
    sys.exit(main())
