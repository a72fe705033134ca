"""Check exact proofs of limits on random paths against 50-digit arithmetic.

    python -m benchmarks.exact_proofs [COUNT]             COUNT proofs, one path at a time, in exact integers
    python -m benchmarks.exact_proofs [COUNT] --batch     the paths of each kind together, first in bounded floats
    python -m benchmarks.exact_proofs --seconds 600       until this processor time [s] is spent

The paths are uniform, hermite and quintic spiral-helices, and segments of routes. For each quantity the limit is its
maximum times 1 + m, where |m| is between 1e-12 and 0.05. The maximum is found among `SAMPLES` floats and refined with
50 digits. A proof is contradicted if the refined maximum, or the value at a random instant, exceeds the limit. A
violation is contradicted if neither the refined maximum nor the value at the reported instant exceeds the limit. No
contradiction is allowed; the exit code is 1 if there is one.

The derivatives are computed from the stored coefficients without the moving basis of the proofs. The formulas of the
quantities are those of the registry.
"""

import argparse
import sys
import time
from collections import Counter
from math import comb

import jax
import mpmath
import numpy as np

import qtraj as qt
from qtraj.path.frenet import Invariants
from qtraj.path.quantity import QUANTITIES

NAMES = tuple(name for name, entry in QUANTITIES.items() if not entry.needs)
KINDS = ("uniform", "hermite", "quintic", "route")
LONG = ("angular_acceleration", "yaw_acceleration")
"""Quantities of such a high degree on a quintic that only one of `RARELY` quintics is checked for them."""

RARELY = 10
DIGITS, SAMPLES, ZOOM, INSTANTS = 50, 2049, 65, 2
SMALLEST, LARGEST = 1e-12, 0.05
"""The smallest and the largest relative difference between a limit and the maximum."""

CLOSE = 0.99
"""Local maxima of the samples below this part of the largest one are not refined."""

STEP = mpmath.mpf("1e-9")
"""Distance of the instants of the last parabola, as a fraction of the duration."""

BATCH = 64
"""Number of paths that are created, and with --batch judged, together."""


def random_path(rng, kind):
    """Return a random turn of 0.6 to 3 rad between radii of 10 to 40 m, or a segment of a route."""
    if kind == "route":
        states = rng.normal(0, 1, (3, 2, 3)) + np.array(
            [[[0, 0, 0], [30, 8, 1]], [[7, 0, 0], [5, 5, 0]], [[0] * 3] * 2]
        )
        return qt.Route([0.0, rng.uniform(3, 6)], *states)
    (r0, r1), turn, v = rng.uniform(10, 40, 2), rng.uniform(0.6, 3.0), rng.normal(0, 1.5, 4)
    rate, out, across = 8 / r0, np.array([np.cos(turn), np.sin(turn), 0]), np.array([-np.sin(turn), np.cos(turn), 0])
    ends = [[r0, 0, 0], [v[0], 8, v[1]]], [r1 * out + [0, 0, 2], v[2] * out + rate * r1 * across + [0, 0, v[3]]]
    if kind == "quintic":
        ends = [[*end, rng.normal(0, 0.5, 3)] for end in ends]
    start, end = (qt.BoundaryState(*np.asarray(x, float)) for x in ends)
    if kind == "uniform":
        return qt.SpiralHelix.from_boundary(start, end)
    return qt.SpiralHelix.hermite(start, end, turn / rate * rng.uniform(0.9, 1.3))


class Exact:
    """The squared quantities of a path at fractions of its duration, in floats or with 50 digits.

    For an angle, it is the square of the tangent of the angle, or of half of it (see `PathQuantity.tangent_of`).
    """

    def __init__(self, path):
        if isinstance(path, qt.Route):
            self.parts, self.turns = [list(map(float, x)) for x in np.asarray(path.coefficients)[0].T], False
        else:
            self.parts, self.turns = [list(map(float, x)) for x in (path.radius, path.angle, path.height)], True
        self.duration = float(path.duration)
        self.precise = [[mpmath.mpf(x) for x in part] for part in self.parts]
        if isinstance(path, qt.Route):
            for k, start in enumerate(map(float, path.origin)):
                self.precise[k][0] += start
                self.parts[k][0] += start
        self._largest = {}

    def square(self, name, u):
        """Return the square of a quantity at `u`, an mpmath number or an array."""
        t = u * self.duration
        parts = self.parts if isinstance(u, np.ndarray) else self.precise
        first, second, third = ([derivative(part, t, k) for k in range(5)] for part in parts)
        if self.turns:
            first, second = turning(first, second[1:])
        root = np.sqrt if isinstance(u, np.ndarray) else mpmath.sqrt
        entry, i = QUANTITIES[name], Invariants(list(zip(first, second, third, strict=True)), root=root)
        return entry.numerator(i) / (1 if entry.denominator is None else entry.denominator(i))

    def largest(self, name):
        """Return the largest value of a squared quantity with 50 digits."""
        if name not in self._largest:
            self._largest[name] = self._found(name)
        return self._largest[name]

    def _found(self, name):
        u = np.linspace(0.0, 1.0, SAMPLES)
        values = self.square(name, u)
        padded = np.concatenate([[-np.inf], values, [-np.inf]])
        peaks = (values >= padded[:-2]) & (values >= padded[2:]) & (values >= CLOSE * np.max(values))
        return max(self._refined(name, x) for x in u[peaks])

    def _refined(self, name, near):
        """Return the value at the vertex of a parabola, first through floats and then with 50 digits."""
        u = np.clip(near + np.linspace(-1, 1, ZOOM) / (SAMPLES - 1), 0.0, 1.0)
        values = self.square(name, u)
        k = int(np.argmax(values))
        at = mpmath.mpf(float(u[k]))
        if 0 < k < ZOOM - 1:
            at += float(vertex(*values[k - 1 : k + 2]) * (u[k + 1] - u[k]))
        best = self.square(name, at)
        if STEP < at < 1 - STEP:
            at += STEP * vertex(self.square(name, at - STEP), best, self.square(name, at + STEP))
        return max(best, self.square(name, min(max(at, mpmath.mpf(0)), mpmath.mpf(1))))


def derivative(coefficients, t, k):
    """Return the k-th derivative of a polynomial with ascending coefficients."""
    value = 0 * t
    for j in range(len(coefficients) - 1, k - 1, -1):
        value = value * t + coefficients[j] * (comb(j, k) * FACTORIALS[k])
    return value


FACTORIALS = (1, 1, 2, 6, 24)


def turning(radius, rate):
    """Return the derivatives of ρ·e^{iφ}, divided by e^{iφ}, from those of ρ and of φ', by Leibniz's rule."""
    w, w1, w2, w3 = rate
    real = [1, 0 * w, -w * w, -3 * w * w1, w**4 - 3 * w1 * w1 - 4 * w * w2]
    imaginary = [0, w, w1, w2 - w**3, w3 - 6 * w * w * w1]
    return [
        [sum(comb(k, j) * radius[j] * part[k - j] for j in range(k + 1)) for k in range(5)]
        for part in (real, imaginary)
    ]


def vertex(before, middle, after):
    """Return the maximum of the parabola through three values at −1, 0 and 1, as a number in [−1, 1]."""
    bend = before - 2 * middle + after
    return min(max((before - after) / (2 * bend), -1), 1) if bend < 0 else 0


def value_of(name, square):
    """Return the value of a quantity with this square, or this squared tangent of an angle."""
    part, value = QUANTITIES[name].tangent_of, mpmath.sqrt(square)
    return part * mpmath.atan(value) if part else value


def square_of(name, value):
    """Return the inverse of `value_of` for a float."""
    part, value = QUANTITIES[name].tangent_of, mpmath.mpf(value)
    return (mpmath.tan(value / part) if part else value) ** 2


def chosen(rng, kind):
    """Return the names of the quantities to check on a path."""
    return [x for x in NAMES if not (kind == "quintic" and x in LONG) or rng.integers(RARELY) == 0]


def problems(rng, kind, count):
    """Return paths, and for each of them its `Exact` and a dictionary of limits."""
    found = []
    for _ in range(count):
        path = random_path(rng, kind)
        exact, limits = Exact(path), {}
        for name in chosen(rng, kind):
            margin = rng.choice([-1, 1]) * 10 ** rng.uniform(np.log10(SMALLEST), np.log10(LARGEST))
            limits[name] = float(value_of(name, exact.largest(name)) * (1 + margin))
        found.append((path, exact, limits))
    return found


def certificates(found, kind, batch):
    """Yield for each problem its certificate; with `batch`, all paths are certified together."""
    if not batch or kind == "route":  # a route is a batch of segments
        for path, _, limits in found:
            yield qt.certify(path, qt.Limits(**limits))
        return
    names = [x for x in NAMES if all(x in limits for _, _, limits in found)]
    each = [(path, qt.Limits(**{name: limits[name] for name in names})) for path, _, limits in found]
    together = qt.certify(*jax.tree.map(lambda *x: np.stack(x), *each))
    yield from (together[k] for k in range(len(found)))


def contradicted(exact, name, limit, status, at, rng):
    """Return whether values with 50 digits contradict a status; `at` is the reported instant [s]."""
    bound = square_of(name, limit)
    if status == "proved":
        instants = [mpmath.mpf(float(u)) for u in rng.random(INSTANTS)]
        return exact.largest(name) > bound or any(exact.square(name, u) > bound for u in instants)
    if status == "broken" and exact.largest(name) <= bound:
        u = mpmath.mpf(float(at)) / exact.duration
        return exact.square(name, min(max(u, mpmath.mpf(0)), mpmath.mpf(1))) <= bound
    return False


def check(rng, kind, count, batch=False):
    """Return how often each quantity has each status on `count` paths, and descriptions of the contradictions."""
    counts, wrong = Counter(), []
    with mpmath.workdps(DIGITS):
        found = problems(rng, kind, count)
        for (path, exact, limits), certificate in zip(found, certificates(found, kind, batch), strict=True):
            for name in certificate.names:
                status, limit = certificate.status[name], limits[name]
                counts[name, status] += 1
                if contradicted(exact, name, limit, status, certificate.worst[name][0], rng):
                    wrong.append(f"{kind}, {name} <= {limit!r} is {status}: {path!r}")
    return counts, wrong


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("count", nargs="?", type=int, default=2000, help="number of proofs")
    parser.add_argument("--seconds", type=float, help="processor time, instead of a number of proofs")
    parser.add_argument("--batch", action="store_true", help="certify paths together")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    rng, totals, wrong, begun, kinds = (
        np.random.default_rng(options.seed),
        Counter(),
        [],
        time.process_time(),
        Counter(),
    )
    while time.process_time() - begun < options.seconds if options.seconds else totals.total() < options.count:
        for kind in KINDS:
            counts, bad = check(rng, kind, BATCH if options.batch else 1, options.batch)
            totals, wrong, kinds[kind] = totals + counts, wrong + bad, kinds[kind] + counts.total()
            print(*bad, sep="\n", end="\n" if bad else "", flush=True)
    for name in NAMES:
        print(f"{name}: " + ", ".join(f"{n} {status}" for (x, status), n in sorted(totals.items()) if x == name))
    print(f"{totals.total()} proofs ({', '.join(f'{n} {kind}' for kind, n in kinds.items())})")
    print(
        f"{len(wrong)} contradictions, {sum(n for (_, x), n in totals.items() if x == 'undecided')} undecided, ", end=""
    )
    print(f"{time.process_time() - begun:.0f} s of processor time")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
