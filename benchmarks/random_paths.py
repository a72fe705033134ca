"""Random regular paths, seeded: splines of several kinds through random points, with parameters of several kinds.

The points are a cloud, a random walk, a random walk in which two points almost coincide, or lines with bends between
them. The curves are cubic and quintic interpolating splines, and cubic and quintic Hermite curves, of which the cubic
ones have jumps of the curvature. The parameter is uniform, the chord length, its square root, or random. The sizes are
1 mm to 50 km, and the paths have loops, sharp bends and near cusps.
"""

from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import BPoly, CubicHermiteSpline, CubicSpline, PPoly, make_interp_spline

POINTS = ("cloud", "walk", "nearby", "lines")
CURVES = ("cubic", "quintic", "cubic hermite", "quintic hermite")
PARAMETERS = ("uniform", "chord", "root", "random")


class RandomPath(NamedTuple):
    """A spline with values (3,) [m] over its parameter, its kinds, and limits in the order of `retime`."""

    spline: PPoly
    kinds: tuple[str, str, str]
    limits: dict[str, Any]

    def braking(self, ratio: float) -> "RandomPath":
        """Return the same path with a limit on braking that is `ratio` times the limit on the acceleration."""
        limit = self.limits["longitudinal_acceleration"]
        return self._replace(limits=self.limits | {"longitudinal_acceleration": (-ratio * limit, limit)})


def random_path(seed: int, points: int = 40) -> RandomPath:
    """Return a path through at most `points` points, with limits on speed, lateral and longitudinal acceleration."""
    rng = np.random.default_rng(seed)
    count = int(np.exp(rng.uniform(np.log(3), np.log(points))))
    size = np.exp(rng.uniform(np.log(1e-3), np.log(5e4)))
    kinds = rng.choice(POINTS), rng.choice(PARAMETERS), rng.choice(CURVES)
    own = _points(rng, kinds[0], count)
    own = own / np.ptp(own, axis=0).max() * size
    spline = _curve(
        rng, kinds[2] if count >= 6 or kinds[2] != "quintic" else "cubic", _parameter(rng, kinds[1], own), own
    )
    limits = {
        "speed": np.exp(rng.uniform(np.log(0.5), np.log(30))),
        "lateral_acceleration": np.exp(rng.uniform(-1, 2)),
        "longitudinal_acceleration": np.exp(rng.uniform(-1, 2)),
    }
    return RandomPath(spline, kinds, {name: float(x) for name, x in limits.items()})


def _points(rng: np.random.Generator, kind: str, count: int) -> np.ndarray:
    if kind == "cloud":
        return rng.uniform(-1, 1, (count, 3)) * [1, 1, 0.1]
    if kind == "lines":
        angle = np.cumsum(np.where(rng.random(count) < 0.6, 0, rng.normal(0, 0.8, count)))
        steps = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
        return np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    found = np.cumsum(rng.normal(0, 1, (count, 3)) * [1, 1, 0.1] + [1, 0, 0], axis=0)
    if kind == "nearby":
        k = rng.integers(0, count - 1)
        found[k + 1] = found[k] + rng.normal(0, 1e-3, 3)
    return found


def _parameter(rng: np.random.Generator, kind: str, points: np.ndarray) -> np.ndarray:
    chord = np.linalg.norm(np.diff(points, axis=0), axis=1)
    chord = np.maximum(chord, 1e-9 * chord.max())
    steps = {"uniform": np.ones_like(chord), "chord": chord, "root": np.sqrt(chord)}.get(kind)
    steps = chord * np.exp(rng.normal(0, 1, chord.size)) if steps is None else steps
    steps = steps / steps.mean() * np.exp(rng.uniform(np.log(0.01), np.log(100)))
    return np.concatenate([[0.0], np.cumsum(steps)])


def _curve(rng: np.random.Generator, kind: str, u: np.ndarray, points: np.ndarray) -> PPoly:
    slope: Any = np.gradient(points, u, axis=0)
    if kind == "cubic":
        return CubicSpline(u, points)
    if kind == "cubic hermite":
        return CubicHermiteSpline(u, points, slope * rng.uniform(0.5, 1))
    if kind == "quintic hermite":
        bend = np.gradient(slope, u, axis=0) * rng.uniform(0, 0.5)
        return PPoly.from_bernstein_basis(BPoly.from_derivatives(u, np.stack([points, slope, bend], axis=1)))
    spline = make_interp_spline(u, points, k=5)
    axes = [PPoly.from_spline((spline.t, c, 5)) for c in np.asarray(spline.c).T]
    filled = np.diff(axes[0].x) > 0
    c = np.stack([axis.c[:, filled] for axis in axes], axis=-1)
    return PPoly(c, np.append(axes[0].x[:-1][filled], axes[0].x[-1]))


def exact_duration(path: RandomPath, samples: int = 200_000) -> float:
    """Return the minimum duration from rest to rest, by a forward and a backward pass along the distance [s].

    Between two samples the squared speed is linear in the distance. The limit on the longitudinal acceleration may be a
    pair (lower, upper).
    """
    first, second = path.spline.derivative(1), path.spline.derivative(2)
    u = _resolving(first, samples)
    h = np.diff(u)
    nodes, weights = np.polynomial.legendre.leggauss(4)
    middle = 0.5 * (u[1:] + u[:-1])
    steps = sum(w * np.linalg.norm(first(middle + 0.5 * h * x), axis=1) for x, w in zip(nodes, weights, strict=True))
    s = np.concatenate([[0.0], np.cumsum(0.5 * h * steps)])

    def highest(u: np.ndarray) -> np.ndarray:
        v, a = first(u), second(u)
        bend = np.linalg.norm(np.cross(v, a), axis=1) / np.maximum(np.linalg.norm(v, axis=1), 1e-300) ** 3
        return 0.5 * np.minimum(
            path.limits["speed"] ** 2, path.limits["lateral_acceleration"] / np.maximum(bend, 1e-300)
        )

    energy = highest(u)
    energy[1:] = np.minimum(energy[1:], highest(u[1:] - 1e-9 * h))  # the curvature may jump at a joint
    energy[[0, -1]] = 0.0
    given = path.limits["longitudinal_acceleration"]
    braking, accelerating = (-given[0] * s, given[1] * s) if isinstance(given, tuple) else (given * s, given * s)
    rising = np.minimum.accumulate(energy - accelerating) + accelerating
    falling = np.minimum.accumulate((energy + braking)[::-1])[::-1] - braking
    speed = np.sqrt(2 * np.maximum(np.minimum(rising, falling), 0.0))
    both = speed[1:] + speed[:-1]
    return float(np.sum(np.divide(2 * np.diff(s), both, out=np.zeros_like(both), where=both > 0)))


def _resolving(first: PPoly, samples: int) -> np.ndarray:
    """Return parameters that resolve the distance, the direction and the parameter itself."""
    inside = np.unique(np.concatenate([np.linspace(0, 1, 64), 2.0 ** -np.arange(1, 40), 1 - 2.0 ** -np.arange(1, 40)]))
    u = np.unique(np.concatenate([a + (b - a) * inside for a, b in zip(first.x[:-1], first.x[1:], strict=True)]))
    for _ in range(7):
        middle = 0.5 * (u[1:] + u[:-1])
        v, between = first(u), first(middle)
        bad = _angle(v[:-1], between) + _angle(between, v[1:]) > 0.02
        if not bad.any() or u.size > samples:
            break
        u = np.unique(np.concatenate([u, middle[bad]]))
    v = first(u)
    speed = np.linalg.norm(v, axis=1)
    distance, turn = np.diff(u) * (speed[1:] + speed[:-1]), _angle(v[:-1], v[1:])
    weight = distance / distance.sum() + turn / max(turn.sum(), 1e-9) + np.diff(u) / np.ptp(u) + 2 / distance.size
    share = np.concatenate([[0.0], np.cumsum(weight)])
    return np.unique(np.concatenate([u, np.interp(np.linspace(0, share[-1], samples), share, u)]))


def _angle(v: np.ndarray, w: np.ndarray) -> np.ndarray:
    return np.arctan2(np.linalg.norm(np.cross(v, w), axis=1), np.sum(v * w, axis=1))
