"""Check statuses and clearances of obstacles against exact distances, in dense samples that are refined with 50 digits.

The distances are computed by formulas that differ from those of the library. `benchmarks.limits_against_sampling` runs
this check.
"""

from functools import cache
from typing import Any

import mpmath
import numpy as np

import qtraj as qt

from .exact_motion import FLOATS, Piece, coefficients, of_helix, of_route, polynomial
from .extremes import Span, largest
from .random_obstacles import distance, random_helix, random_obstacle, random_route

CLOSE, VALUE = 1e-9, 1e-8
"""Relative difference between the radius of the body and the distance, and accuracy of clearances [m]."""

OUTSIDE = 1e-3
"""A body of radius zero that is nearer [m] than this has no radius that is close to its distance."""

OFFSETS = [(0.0,), (0.0,), (-1.3, 1.3), ((0.8, 0.3, -0.2),)]


def in_world(helix: Any) -> list[Piece]:
    """Return the piece of a spiral-helix with components in world axes."""
    own = of_helix(helix)[0]
    azimuth, (q, origin) = coefficients(helix.angle), (np.asarray(x).tolist() for x in _placement(helix))

    def motion(x: Any) -> list[list[Any]]:
        phi = polynomial(azimuth, x, 0)
        c, s = (np.cos(phi), np.sin(phi)) if isinstance(x, np.ndarray) else (mpmath.cos(phi), mpmath.sin(phi))
        rows = [_rotated(q, [c * p[0] - s * p[1], s * p[0] + c * p[1], p[2]]) for p in own.motion(x)]
        return [[o + p for o, p in zip(origin, rows[0], strict=True)], *rows[1:]]

    return [Piece(own.length, motion, motion)]


def _placement(helix: Any) -> tuple[Any, Any]:
    return helix.placement.orientation, helix.placement.origin


def _rotated(q: Any, v: list[Any]) -> list[Any]:
    """Rotate a vector by a quaternion of any norm."""
    scalar, u = q[0] + 0 * v[0], q[1:]
    norm = sum(x * x for x in [scalar, *u])
    inner = [scalar * x + y for x, y in zip(v, _cross(u, v), strict=True)]
    return [x + 2 * y / norm for x, y in zip(v, _cross(u, inner), strict=True)]


def _cross(a: Any, b: Any) -> list[Any]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def place(rows: list[list[Any]], offset: Any, sqrt: Any) -> list[Any]:
    """Return the centre of a ball of the body; an offset of three numbers is along the travel, to the left and up."""
    r, v = rows[:2]
    along, left, up = offset if np.ndim(offset) else (offset, 0.0, 0.0)
    speed = sqrt(sum(x * x for x in v))
    tau = [x / speed for x in v]
    level = sqrt(tau[0] ** 2 + tau[1] ** 2)
    across = [-tau[1] / level, tau[0] / level, 0 * level]
    axes = zip(r, tau, across, _cross(tau, across), strict=True)
    return [o + along * x + left * y + up * z for o, x, y, z in axes]


def exact_distance(obstacle: Any, point: list[Any], t: Any) -> Any:
    """Return the distance of a point from an obstacle, negative inside, in mpmath numbers."""
    if isinstance(obstacle, qt.HalfSpace):
        normal = _numbers(obstacle.normal)
        return (_dot(point, normal) - _numbers(obstacle.offset)) / _norm(normal)
    if isinstance(obstacle, qt.ConvexPolygon):
        return _from_polygon([_numbers(x) for x in np.asarray(obstacle.vertices)], point[:2])
    centre = obstacle.point if isinstance(obstacle, qt.Cylinder) else obstacle.centre
    track = np.atleast_2d(np.asarray(centre))
    away = [p - polynomial(coefficients(c), t, 0) for p, c in zip(point, track.T, strict=True)]
    if isinstance(obstacle, qt.Ball):
        return _norm(away) - _numbers(obstacle.radius)
    if isinstance(obstacle, qt.Cylinder):
        axis = _numbers(obstacle.axis)
        return _norm(_cross(away, axis)) / _norm(axis) - _numbers(obstacle.radius)
    return _from_ellipsoid(obstacle.shape, away)


def _numbers(x: Any) -> Any:
    values = np.asarray(x).tolist()
    return [mpmath.mpf(y) for y in values] if isinstance(values, list) else mpmath.mpf(values)


def _dot(a: Any, b: Any) -> Any:
    return mpmath.fsum(x * y for x, y in zip(a, b, strict=True))


def _norm(a: Any) -> Any:
    return mpmath.sqrt(_dot(a, a))


def _from_polygon(vertices: list[Any], point: list[Any]) -> Any:
    best, turns = mpmath.inf, []
    for a, b in zip(vertices, vertices[1:] + vertices[:1], strict=True):
        edge, away = ([y - x for x, y in zip(a, c, strict=True)] for c in (b, point))
        along = min(max(_dot(edge, away) / _dot(edge, edge), mpmath.mpf(0)), mpmath.mpf(1))
        best = min(best, _norm([x - along * e for x, e in zip(away, edge, strict=True)]))
        turns.append(edge[0] * away[1] - edge[1] * away[0])
    return -best if min(turns) >= 0 or max(turns) <= 0 else best


def _from_ellipsoid(shape: Any, away: list[Any]) -> Any:
    """Return the distance, by Newton's method for the multiplier; inside, the smallest semi-axis times √(xᵀP⁻¹x) − 1.

    The function of the multiplier decreases and is convex, so that the steps from zero never go too far.
    """
    squares, axes = _principal(tuple(map(tuple, np.asarray(shape).tolist())), mpmath.mp.dps)
    own = [_dot(axis, away) for axis in axes]
    level = mpmath.sqrt(mpmath.fsum(x * x / s for x, s in zip(own, squares, strict=True)))
    if level <= 1:
        return (level - 1) * mpmath.sqrt(min(squares))
    k, step = mpmath.mpf(0), mpmath.inf
    while step > mpmath.mpf(10) ** -40 * (k + min(squares)):
        terms = [(s * x * x / (s + k) ** 2, s + k) for x, s in zip(own, squares, strict=True)]
        step = (sum(x for x, _ in terms) - 1) / sum(2 * x / y for x, y in terms)
        k += step
    return k * _norm([x / (s + k) for x, s in zip(own, squares, strict=True)])


@cache
def _principal(shape: tuple[tuple[float, ...], ...], _: int) -> tuple[list[Any], list[list[Any]]]:
    """Return the squares of the semi-axes and their directions."""
    squares, axes = mpmath.eigsy(mpmath.matrix(shape))
    return list(squares), [list(row) for row in axes.T.tolist()]


def checked(rng: np.random.Generator) -> list[str]:
    """Check one random obstacle next to a random path; return descriptions of what is wrong."""
    kind = rng.integers(4)
    path = random_route(rng, septic=kind == 1) if kind < 2 else random_helix(rng, kind == 2)
    pieces = of_route(path) if kind < 2 else in_world(path)
    starts = np.append(0.0, np.cumsum([x.length for x in pieces]))
    near = np.asarray(path.position(float(path.duration) * rng.uniform(0.2, 0.8)))
    obstacle, offsets = random_obstacle(rng, near, rng.random() < 0.3), OFFSETS[rng.integers(len(OFFSETS))]

    def clearance(k: int, x: Any, arithmetic: Any) -> Any:
        rows, t = pieces[k].motion(x), float(starts[k]) + x
        centres = [place(rows, offset, arithmetic.sqrt) for offset in offsets]
        if arithmetic is FLOATS:
            return np.min([distance(obstacle, np.stack(p, axis=1), t) for p in centres], axis=0)
        return min(exact_distance(obstacle, p, t) for p in centres)

    exact = -largest([Span(k, 0.0, piece.length) for k, piece in enumerate(pieces)], clearance, -1)
    wrong, outside = [], exact > OUTSIDE
    changes = ((-CLOSE, "proved"), (CLOSE, "broken")) if outside else ((0.0, "broken"),)
    for change, expected in changes:
        radius = float(exact) * (1 + change) if outside else 0.0
        found = qt.certify(path, qt.Limits(keep_out=[obstacle], body=[(offset, radius) for offset in offsets]))
        status, value = found.status["keep_out[0]"], found.worst["keep_out[0]"][1]
        if status != expected or abs(value - float(exact - radius)) > VALUE:
            text = f"{status}, not {expected}, with {value!r}, not {float(exact - radius)!r}"
            wrong.append(f"{obstacle}, offsets {offsets}, radius {radius!r}: {text}")
    return wrong


def check(seed: int, count: int) -> tuple[list[str], str]:
    """Check random obstacles; return descriptions of what is wrong, and a summary."""
    rng, wrong = np.random.default_rng(seed), []
    with mpmath.workdps(50):
        for _ in range(count):
            wrong += (bad := checked(rng))
            print(*bad, sep="\n", end="\n" if bad else "", flush=True)
    return wrong, f"{count} obstacles, {len(wrong)} wrong statuses or clearances"
