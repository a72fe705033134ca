"""Random regular paths, seeded: splines of several kinds through random points, with parameters of several kinds.

The points are a cloud, a random walk, a random walk in which two points almost coincide, or lines with bends between
them. The curves are cubic and quintic interpolating splines, and cubic and quintic Hermite curves, of which the cubic
ones have jumps of the curvature. The parameter is uniform, the chord length, its square root, or random. The sizes are
1 mm to 50 km, and the paths have loops, sharp bends and near cusps.
"""

import bisect
import math
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import BPoly, CubicHermiteSpline, CubicSpline, PPoly, make_interp_spline

import qtraj as qt

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


def with_speed(path: RandomPath, seed: int) -> RandomPath:
    """Return the same path with limits on its accelerations that depend on the speed, of a random kind."""
    rng = np.random.default_rng(seed)
    top, (lateral, along) = path.limits["speed"], list(path.limits.values())[1:]

    def curve(least: float) -> qt.BySpeed:
        count = int(rng.integers(2, 5))
        speeds = np.concatenate([[0.0], np.sort(rng.uniform(0.1, 1, count - 1))]) * top
        return qt.BySpeed(speeds, magnitude=np.exp(rng.uniform(np.log(least), 0, count)))

    if rng.random() < 0.5:
        sides = curve(0.2).scaled(-2 * along), curve(0.2).scaled(along)
        limits = {"lateral_acceleration": curve(0.5).scaled(lateral), "longitudinal_acceleration": sides}
    else:
        fields = curve(0.2).scaled(2 * along), curve(0.2).scaled(along), curve(0.5).scaled(lateral)
        limits = {"combined_acceleration": qt.Ellipse(*fields)}
    return path._replace(limits={"speed": top, **limits})


def reparametrised(path: RandomPath, seed: int) -> RandomPath | None:
    """Return the same curve over another parameter, or None for a curve of more than the third degree.

    The old parameter u is a quadratic spline of the new one, whose rate changes at random by factors of up to 200
    between its 2 to 12 pieces. A cubic curve of it has the degree 6, and r'' jumps between the pieces.
    """
    x, c = path.spline.x, path.spline.c[::-1]
    if len(c) > 4:
        return None
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 13))
    rates = np.exp(rng.uniform(np.log(0.005), 0.0, count + 1))
    steps = np.exp(rng.normal(0, 0.5, count))
    scale = (x[-1] - x[0]) / np.sum(steps * (rates[1:] + rates[:-1]) / 2)
    rates, s = rates * scale, np.concatenate([[0.0], np.cumsum(steps)])
    bend, first = (
        np.diff(rates) / steps / 2,
        x[0] + np.concatenate([[0.0], np.cumsum(steps * np.convolve(rates, [0.5, 0.5])[1:-1])]),
    )
    piece = np.clip(np.searchsorted(first, x[1:-1], side="right") - 1, 0, count - 1)
    ahead = x[1:-1] - first[piece]
    joints = s[piece] + 2 * ahead / (rates[piece] + np.sqrt(rates[piece] ** 2 + 4 * bend[piece] * ahead))
    knots = np.unique(np.concatenate([s, joints]))
    knots = np.append(knots[:-1][np.diff(knots) > 1e-12 * s[-1]], s[-1])
    piece = np.clip(np.searchsorted(s, knots[:-1], side="right") - 1, 0, count - 1)
    t, half = knots[:-1] - s[piece], np.diff(knots) / 2
    u, slope = first[piece] + t * (rates[piece] + bend[piece] * t), rates[piece] + 2 * bend[piece] * t
    k = np.clip(np.searchsorted(x, u + half * (slope + bend[piece] * half), side="right") - 1, 0, x.size - 2)
    found, power = np.zeros((7, t.size, 3)), np.eye(7)[0][:, None] * np.ones(t.size)
    for i in range(len(c)):  # Taylor's coefficients of the cubic at u, and the powers of u(s) − u
        taylor = sum(math.comb(j, i) * c[j, k] * (u - x[k])[:, None] ** (j - i) for j in range(i, len(c)))
        found += power[:, :, None] * taylor
        power = np.pad(power, ((1, 0), (0, 0)))[:7] * slope + np.pad(power, ((2, 0), (0, 0)))[:7] * bend[piece]
    return path._replace(spline=PPoly(found[::-1], knots))


def exact_duration(path: RandomPath, samples: int = 200_000) -> float:
    """Return the minimum duration from rest to rest, by a forward and a backward pass along the distance [s].

    Between two samples the squared speed is linear in the distance. The limit on the longitudinal acceleration may be a
    pair (lower, upper). Limits that depend on the speed are those of `with_speed`.
    """
    first, second = path.spline.derivative(1), path.spline.derivative(2)
    u = _resolving(first, samples)
    h = np.diff(u)
    nodes, weights = np.polynomial.legendre.leggauss(4)
    middle = 0.5 * (u[1:] + u[:-1])
    steps = sum(w * np.linalg.norm(first(middle + 0.5 * h * x), axis=1) for x, w in zip(nodes, weights, strict=True))
    s = np.concatenate([[0.0], np.cumsum(0.5 * h * steps)])

    def bend_at(u: np.ndarray) -> np.ndarray:
        v, a = first(u), second(u)
        return np.linalg.norm(np.cross(v, a), axis=1) / np.maximum(np.linalg.norm(v, axis=1), 1e-300) ** 3

    if not isinstance(path.limits.get("lateral_acceleration"), float):
        return _duration_by_speed(path.limits, s, np.maximum(bend_at(u), bend_at(u - 1e-9 * np.append(0.0, h))))

    def highest(u: np.ndarray) -> np.ndarray:
        bend = bend_at(u)
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


def _duration_by_speed(limits: dict[str, Any], s: np.ndarray, bend: np.ndarray) -> float:
    """Return the minimum duration for limits that depend on the speed; `bend` is the curvature at the distances `s`.

    Both passes take explicit midpoint steps.
    """
    ellipse = limits.get("combined_acceleration")
    if ellipse is None:
        braking, accelerating = (x.scaled(k) for x, k in zip(limits["longitudinal_acceleration"], (-1, 1), strict=True))
        lateral = limits["lateral_acceleration"]
    else:
        braking, accelerating, lateral = ellipse.braking, ellipse.accelerating, ellipse.lateral
    low, high = np.zeros_like(s), np.full_like(s, limits["speed"])
    speeds = np.linspace(0, limits["speed"], 400)
    holds = bend[:, None] * speeds**2 <= np.asarray(lateral.at(speeds))  # up to the lowest speed that violates it
    k = np.where(holds.all(axis=1), 0, np.argmin(holds, axis=1))
    low, high = np.where(k > 0, speeds[k - 1], low), np.where(k > 0, speeds[k], high)
    for _ in range(50):
        middle = 0.5 * (low + high)
        fits = bend * middle**2 <= np.asarray(lateral.at(middle))
        low, high = np.where(fits, middle, low), np.where(fits, high, middle)
    most = 0.5 * np.where(k > 0, low, limits["speed"]) ** 2
    most[[0, -1]] = 0.0

    def along(curve: qt.BySpeed) -> Any:
        v, f = (np.asarray(x).tolist() for x in (curve.speeds, curve.values))
        side_v, side_f = (np.asarray(x).tolist() for x in (lateral.speeds, lateral.values))

        def at(energy: float, bend: float) -> float:
            speed = math.sqrt(2 * max(energy, 0.0))
            value = _interpolated(speed, v, f)
            share = 0.0 if ellipse is None else 2 * energy * bend / _interpolated(speed, side_v, side_f)
            return value * math.sqrt(max(1 - share * share, 0.0))

        return at

    def swept(limit: Any, s: list[float], most: list[float], bend: list[float]) -> np.ndarray:
        energy = [most[0]]
        for i in range(len(s) - 1):
            step, now = s[i + 1] - s[i], energy[-1]
            half = min(now + 0.5 * step * limit(now, bend[i]), 0.5 * (most[i] + most[i + 1]) if most[i] else math.inf)
            energy.append(min(now + step * limit(half, 0.5 * (bend[i] + bend[i + 1])), most[i + 1]))
        return np.array(energy)

    rising = swept(along(accelerating), s.tolist(), most.tolist(), bend.tolist())
    back = (s[-1] - s)[::-1].tolist(), rising[::-1].tolist(), bend[::-1].tolist()
    speed = np.sqrt(2 * swept(along(braking), *back)[::-1])
    both = speed[1:] + speed[:-1]
    return float(np.sum(np.divide(2 * np.diff(s), both, out=np.zeros_like(both), where=both > 0)))


def _interpolated(x: float, places: list[float], values: list[float]) -> float:
    k = bisect.bisect_right(places, x)
    if k == 0 or k == len(places):
        return values[min(k, len(places) - 1)] if k == 0 else values[-1]
    share = (x - places[k - 1]) / (places[k] - places[k - 1])
    return values[k - 1] + share * (values[k] - values[k - 1])


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
