"""Random quantities of one's own on random routes and spiral-helices, against their extremes in 50 digits."""

import math
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest

import qtraj as qt

DIGITS, SAMPLES, MARGIN = 50, 1500, 1e-9


class Vector:
    """A vector of numbers of any kind, with their square root."""

    def __init__(self, parts, sqrt):
        self.parts, self.sqrt = list(parts), sqrt

    def __getitem__(self, k):
        return self.parts[k]

    def dot(self, other):
        return sum(x * y for x, y in zip(self.parts, other.parts, strict=True))

    def cross(self, other):
        a, b = self.parts, other.parts
        return Vector([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]], self.sqrt)

    def norm(self):
        return self.sqrt(self.dot(self))


INVARIANT = (
    lambda p: p.velocity.dot(p.acceleration),
    lambda p: p.velocity.cross(p.acceleration).norm(),
    lambda p: p.acceleration.norm(),
    lambda p: p.velocity[2],
    lambda p: p.velocity.cross(p.acceleration)[2],
    lambda p: p.velocity.dot(p.jerk),
    lambda p: p.velocity.cross(p.acceleration).dot(p.jerk),
    lambda p: p.speed,
)
WORLD = (
    *INVARIANT,
    lambda p: p.velocity[0],
    lambda p: p.acceleration[1],
    lambda p: p.position[2],
    lambda p: p.position.norm(),
)


def random_function(rng, atoms):
    """Return a random function of a motion p and of the function that computes roots."""
    first, second, third = (atoms[k] for k in rng.integers(len(atoms), size=3))
    a, b = (round(float(x), 3) for x in rng.uniform(0.3, 2.0, 2))
    return (
        lambda p, sqrt: first(p) / p.speed,
        lambda p, sqrt: first(p) * second(p) / p.speed**3,
        lambda p, sqrt: a * first(p) - b * second(p),
        lambda p, sqrt: sqrt(first(p) ** 2 + a * second(p) ** 2) / p.speed,
        lambda p, sqrt: first(p) / (a + second(p) ** 2),
        lambda p, sqrt: a * p.speed - sqrt(b + first(p) ** 2),
        lambda p, sqrt: (first(p) + a * p.speed) / sqrt(second(p) ** 2 + third(p) ** 2 + b),
        lambda p, sqrt: abs(first(p)) * sqrt(p.speed) + b * second(p),
        lambda p, sqrt: first(p) / (p.speed + sqrt(second(p) ** 2 + a)),
    )[rng.integers(9)]


def quantity_of(function):
    """Return the quantity with the unit that its function has, or None for a constant and for a unit with roots."""
    try:
        return qt.Quantity("mine", "1", lambda p: function(p, qt.sqrt))
    except ValueError as error:
        if "does not depend" in str(error):
            return None
        unit = str(error).split("has the unit ")[1].split(",")[0]
    return None if "^" in unit else qt.Quantity("mine", unit, lambda p: function(p, qt.sqrt))


def random_route(rng):
    n = 4
    times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.8, 2.0, n - 1))])
    position = np.cumsum(rng.normal(size=(n, 3)) + np.array([5.0, 0.0, 0.0]), axis=0)
    return qt.Route(times, position, rng.normal(size=(n, 3)) + np.array([4.0, 0.0, 0.0]), rng.normal(size=(n, 3)))


def random_helix(rng):
    return qt.SpiralHelix(
        [rng.uniform(5, 20), *rng.normal(size=2) * 0.2],
        [0.0, rng.uniform(0.3, 0.8), rng.normal() * 0.03],
        [0.0, *rng.normal(size=3) * 0.2],
        rng.uniform(2.0, 5.0),
    )


def segment_motion(route, k):
    """Return the motion on one segment of a route as a function of the time since its start."""
    c = np.asarray(route.coefficients)[k]

    def motion(t):
        rows = [[derivative(c[:, axis], t, m) for axis in range(3)] for m in range(4)]
        rows[0] = [x + float(o) for x, o in zip(rows[0], np.asarray(route.origin), strict=True)]
        return rows

    return motion


def derivative(c, t, m):
    """Return the m-th derivative of a polynomial, in the arithmetic of `t`."""
    return sum((math.perm(j, m) * (float(x) * t ** (j - m)) for j, x in enumerate(c) if j >= m), 0 * t)


def helix_motion(path):
    """Return the derivatives of a spiral-helix in the axes that rotate with it, from its definition."""

    def motion(t):
        rho, phi, h = (
            [derivative(np.asarray(c), t, m) for m in range(4)] for c in (path.radius, path.angle, path.height)
        )
        w = 1j * phi[1]
        g = [1, w, 1j * phi[2] + w**2, 1j * phi[3] + 3 * w * 1j * phi[2] + w**3]
        plane = [sum(math.comb(m, j) * rho[m - j] * g[j] for j in range(m + 1)) for m in range(4)]
        return [[z.real + 0 * t, z.imag + 0 * t, x] for z, x in zip(plane, h, strict=True)]

    return motion


def value_at(function, motion, t, sqrt):
    position, velocity, acceleration, jerk = (Vector(row, sqrt) for row in motion(t))
    p = SimpleNamespace(
        position=position, velocity=velocity, acceleration=acceleration, jerk=jerk, speed=velocity.norm()
    )
    return function(p, sqrt)


def extreme_of(function, parts):
    """Return the largest value on the parts of a path, in 50 digits, and samples of the values."""
    best, samples = [], []
    for motion, duration in parts:
        t = np.linspace(0.0, duration, SAMPLES)
        values = value_at(function, motion, t, np.sqrt)
        samples.append(values)
        k = int(np.argmax(values))
        low, high = (mpmath.mpf(float(t[j])) for j in (max(k - 1, 0), min(k + 1, SAMPLES - 1)))
        best.append(golden(lambda t, motion=motion: value_at(function, motion, t, mpmath.sqrt), low, high))
    return max(best), np.concatenate(samples)


def golden(f, low, high):
    """Return the maximum of a function with one maximum, by golden sections."""
    ends, ratio = (f(low), f(high)), (mpmath.sqrt(5) - 1) / 2
    a, b = high - ratio * (high - low), low + ratio * (high - low)
    x, y = f(a), f(b)
    for _ in range(60):
        if x > y:
            high, b, y = b, a, x
            a = high - ratio * (high - low)
            x = f(a)
        else:
            low, a, x = a, b, y
            b = low + ratio * (high - low)
            y = f(b)
    return max(x, y, *ends)


def check(seed):
    """Compare the findings of one random quantity with its largest value; return whether it was provable."""
    rng = np.random.default_rng(seed)
    on_route = seed % 2 == 0
    path = random_route(rng) if on_route else random_helix(rng)
    parts = [(helix_motion(path), float(path.duration))]
    if on_route:
        parts = [(segment_motion(path, k), h) for k, h in enumerate(np.diff(np.asarray(path.times)))]
    function = random_function(rng, WORLD if on_route else INVARIANT)
    quantity = quantity_of(function)
    if quantity is None:
        return False
    assert quantity.provable
    with mpmath.workdps(DIGITS):
        largest, values = extreme_of(function, parts)
        assert float(largest) >= values.max() - 1e-9 * np.abs(values).max()
        above, below = (float(largest + sign * MARGIN * abs(largest)) for sign in (1, -1))
    if abs(float(largest)) < 1e-6 * np.abs(values).max():
        return False
    for bound, status in ((above, "proved"), (below, "broken")):
        limit = (None, bound)
        found = (
            qt.certify(path, qt.Limits(own={quantity: limit})).status if bound > 0 or not _magnitude(quantity) else {}
        )
        assert set(found.values()) <= {status}, (seed, found, status, float(largest))
    return True


def _magnitude(quantity):
    return quantity.entries["mine"].component is None


def test_random_quantities():
    assert sum(check(seed) for seed in range(24)) >= 20


@pytest.mark.slow
def test_many_random_quantities():
    assert sum(check(seed) for seed in range(1000, 1125)) >= 100
