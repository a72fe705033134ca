"""Check the certificate of a whole drive against random samples in 50-digit arithmetic.

Run `python -m benchmarks.route_proofs [FILE] [--places 100000]`. The route is fitted to a recording, by default the
drive in the examples. The limits are close to the largest values on many segments, so the decisions are close. At
random places, the inequality of each limit, numerator ≤ limit²·divisor, is evaluated with 50 digits from the
coefficients of the route, except where the route is at rest. A violation on a segment whose status is "proved" is a
contradiction. In addition, some limits are chosen so that the path violates them only between samples; the certificate
must report these violations.
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
"""Speed [m/s] below which the route counts as at rest.

At the end of a segment before a stop, the speed of the stored polynomial is about 1e-16 because of rounding. Such
places are counted separately, because ratios of rounding errors contain no information about the route.
"""


def derivatives(coefficients, u):
    """Return the first three derivatives of a polynomial as mpmath numbers; `coefficients` (terms, 3) are ascending."""
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
    """Return numerator − limit²·divisor for each limit, which is positive where the limit is violated."""
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
    """Count violations, contradicted proofs and places at rest, by random places.

    About half of the places are multiples of 1/64 of the segment, including its ends.
    """
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
    """Return the status of limits between the largest of 17 samples and the largest of 4097 samples of a segment."""
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
    """Print the counts for one recording."""
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
    print(f"{counts['at rest']} places at rest are not checked")
    print(f"status of limits violated only between samples: {Counter(planted(route))}")


if __name__ == "__main__":
    main()
