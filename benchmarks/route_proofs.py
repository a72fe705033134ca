"""Do 50 digits contradict the proofs of a route? Samples of a whole drive against its certificate.

`python -m benchmarks.route_proofs [FILE] [--places 100000]`: the route is fitted to a recording, by default the drive
of the examples. The limits are close to the largest values of many segments, so proofs and violations are close calls.
At random places the limits' inequalities, numerator ≤ limit²·divisor, are computed with 50 digits from the route's
own coefficients, except where the route is at rest. A contradiction is a violation in a segment that was called
proved. A violation is planted as well: a limit just below the largest value between two samples must be refuted.
"""

import argparse
from collections import Counter
from pathlib import Path

import jax
import mpmath
import numpy as np

import qtraj as qt

DRIVE = Path(__file__).parents[1] / "examples" / "drive_8km.csv.gz"
LIMITS = {"curvature": 0.05, "lateral_acceleration": 1.0, "jerk": 2.0, "yaw_rate": 0.1}
SEED, DIGITS = 20, 50
REST = 1e-12
"""[m/s] At the end of a segment before a stop the stored polynomial has a speed of about 1e-16, where the route is at
rest. Such places are counted apart: ratios of rounding errors say nothing about the route."""


def derivatives(coefficients, u):
    """The first three derivatives of a polynomial in mpmath numbers; coefficients (terms, 3), ascending."""
    rows = [[mpmath.mpf(float(x)) for x in row] for row in coefficients]
    orders = []
    for _ in range(3):
        rows = [[k * x for x in row] for k, row in enumerate(rows)][1:]
        value = [mpmath.mpf(0)] * 3
        for row in reversed(rows):
            value = [v * u + x for v, x in zip(value, row, strict=True)]
        orders.append(value)
    return orders


def excesses(r1, r2, r3):
    """numerator − limit²·divisor of each limit; positive where it is violated."""
    cross = [r1[(k + 1) % 3] * r2[(k + 2) % 3] - r1[(k + 2) % 3] * r2[(k + 1) % 3] for k in range(3)]
    speed, level = (sum(x * x for x in r1[:n]) for n in (3, 2))
    normal, jerk = (sum(x * x for x in v) for v in (cross, r3))
    square = {name: mpmath.mpf(value) ** 2 for name, value in LIMITS.items()}
    return {
        "curvature": normal - square["curvature"] * speed**3,
        "lateral_acceleration": normal - square["lateral_acceleration"] * speed,
        "jerk": jerk - square["jerk"],
        "yaw_rate": cross[2] ** 2 - square["yaw_rate"] * speed * level,
    }


def contradictions(route, status, places):
    """Counts (contradicted proofs, violations, places) of random places, half of them at joints and ends of cells."""
    rng = np.random.default_rng(SEED)
    segments, spans = rng.integers(0, route.segments, places), np.diff(np.asarray(route.times))
    fractions = np.where(rng.random(places) < 0.5, rng.random(places), rng.integers(0, 65, places) / 64)
    coefficients, counts = np.asarray(route.coefficients), Counter()
    for i, fraction in zip(segments.tolist(), fractions.tolist(), strict=True):
        u = mpmath.mpf(float(spans[i])) * mpmath.mpf(fraction)
        rows = derivatives(coefficients[i], u)
        if sum(x * x for x in rows[0]) < REST**2:
            counts["at rest"] += 1
            continue
        for name, excess in excesses(*rows).items():
            violated = excess > 0
            counts[name, "violated"] += violated
            counts[name, "contradicted"] += violated and status[name][i] == "proved"
    return counts


def planted(route):
    """The status of limits that only a place between two of 17 samples violates, for segments of the route."""
    found = []
    for i in range(0, route.segments, 40):
        start, end = np.asarray(route.times)[i : i + 2]
        part = route.window(float(start), float(end))
        table = qt.evaluate(part, np.linspace(0, part.duration, 4097), ("lateral_acceleration",))
        dense = np.asarray(table.lateral_acceleration)
        between = (dense[::256].max() + dense.max()) / 2
        if dense.max() > between * (1 + 1e-9):
            found.append(qt.certify(part, qt.Limits(lateral_acceleration=between)).status["lateral_acceleration"])
    return found


def main():
    """Print the counts of one recording."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", nargs="?", default=DRIVE)
    parser.add_argument("--places", type=int, default=100_000)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    mpmath.mp.dps = DIGITS
    route = qt.fit_route(qt.read_track(options.file)).path
    certificate = qt.certify(route, qt.Limits(**LIMITS))
    status = {name: np.asarray(certificate.segments.status[name]) for name in certificate.names}
    counts = contradictions(route, status, options.places)
    for name in certificate.names:
        by_status = ", ".join(f"{n} {text}" for text, n in Counter(status[name].tolist()).items())
        print(
            f"{name}: {by_status} segments; {counts[name, 'violated']} of {options.places} places violate it, "
            f"{counts[name, 'contradicted']} of them in proved segments"
        )
    print(f"{counts['at rest']} places at rest are left out")
    print(f"planted between samples: {Counter(planted(route))}")


if __name__ == "__main__":
    main()
