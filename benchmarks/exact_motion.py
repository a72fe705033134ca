"""The motion along spiral-helices, routes and timings at any precision, from their stored coefficients alone.

A path is a list of pieces with a local parameter x. `motion(x)` returns position, velocity, acceleration and jerk, each
as three components, in the arithmetic of x: NumPy arrays in floats, or mpmath numbers. The components of a spiral-helix
are those in the axes that rotate with it, of which only the height of the position is that in world axes.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import mpmath
import numpy as np

PANELS, NODES = 64, np.polynomial.legendre.leggauss(20)


class Piece(NamedTuple):
    """A part of a path over 0 ≤ x ≤ `length`; `derivatives` are those with respect to x, not to the time."""

    length: float
    motion: Callable[[Any], list[list[Any]]]
    derivatives: Callable[[Any], list[list[Any]]]


class Arithmetic(NamedTuple):
    """The functions of an arithmetic."""

    sqrt: Any
    atan: Any
    atan2: Any


FLOATS = Arithmetic(np.sqrt, np.arctan, np.arctan2)
DIGITS = Arithmetic(mpmath.sqrt, mpmath.atan, mpmath.atan2)


class Coefficients(NamedTuple):
    """The ascending coefficients of a polynomial in both arithmetics."""

    floats: list[float]
    numbers: list[Any]


def coefficients(c: Any) -> Coefficients:
    """Return the coefficients of a polynomial, which are floats."""
    floats = [float(x) for x in np.asarray(c)]
    return Coefficients(floats, [mpmath.mpf(x) for x in floats])


def polynomial(own: Coefficients, x: Any, m: int) -> Any:
    """Return the m-th derivative of a polynomial."""
    c = own.floats if isinstance(x, np.ndarray) else own.numbers
    value = 0 * x
    for k in range(len(c) - 1, m - 1, -1):
        value = value * x + math.perm(k, m) * c[k]
    return value


def of_helix(path: Any) -> list[Piece]:
    """Return the piece of a spiral-helix, from the definition of its polynomials."""
    parts = [coefficients(c) for c in (path.radius, path.angle, path.height)]

    def motion(x: Any) -> list[list[Any]]:
        rho, phi, h = ([polynomial(c, x, m) for m in range(4)] for c in parts)
        w = 1j * phi[1]
        g = [1, w, 1j * phi[2] + w**2, 1j * phi[3] + 3 * w * 1j * phi[2] + w**3]
        plane = [sum(math.comb(m, k) * rho[m - k] * g[k] for k in range(m + 1)) for m in range(4)]
        return [[z.real + 0 * x, z.imag + 0 * x, up] for z, up in zip(plane, h, strict=True)]

    return [Piece(float(path.duration), motion, motion)]


def of_route(route: Any) -> list[Piece]:
    """Return the segments of a route."""
    origin = [mpmath.mpf(float(x)) for x in np.asarray(route.origin)]

    def piece(c: np.ndarray, length: float) -> Piece:
        columns = [coefficients(column) for column in c.T]

        def motion(x: Any) -> list[list[Any]]:
            rows = [[polynomial(column, x, m) for column in columns] for m in range(4)]
            start = map(float, origin) if isinstance(x, np.ndarray) else origin
            return [[o + p for o, p in zip(start, rows[0], strict=True)], *rows[1:]]

        return Piece(length, motion, motion)

    lengths = np.diff(np.asarray(route.times))  # the last rows of the coefficients may be padding
    return [piece(c, float(h)) for c, h in zip(np.asarray(route.coefficients), lengths, strict=False)]


def of_timing(path: Any, pieces: list[Piece]) -> list[Piece]:
    """Return the cells of a timing u̇² = a(u) of a path with the given pieces, each of which is divided into cells."""
    starts = np.append(0.0, np.cumsum([piece.length for piece in pieces]))
    knots, cubics = np.asarray(path.timing.knots), np.asarray(path.timing.coefficients)

    def cell(k: int) -> Piece:
        own = int(np.searchsorted(starts[1:-1], 0.5 * (knots[k] + knots[k + 1])))
        base, shift, length = pieces[own], float(knots[k] - starts[own]), float(knots[k + 1] - knots[k])
        c = coefficients(cubics[k])

        def derivatives(x: Any) -> list[list[Any]]:
            return base.derivatives(shift + x)

        def motion(x: Any) -> list[list[Any]]:
            r, first, second, third = derivatives(x)
            square, slope, bend = (polynomial(c, x / length, m) / length**m for m in range(3))
            rate = np.sqrt(square) if isinstance(x, np.ndarray) else mpmath.sqrt(square)
            return [
                r,
                [p * rate for p in first],
                [q * square + p * slope / 2 for p, q in zip(first, second, strict=True)],
                [
                    s * square * rate + 3 * q * rate * slope / 2 + p * bend * rate / 2
                    for p, q, s in zip(first, second, third, strict=True)
                ],
            ]

        return Piece(length, motion, derivatives)

    return [cell(k) for k in range(len(cubics))]


class Distances:
    """Distances along a path, by Gauss–Legendre quadrature in floats on short panels."""

    def __init__(self, pieces: list[Piece]):
        self.pieces, steps = pieces, []
        for piece in pieces:
            x = np.linspace(0.0, piece.length, PANELS + 1)
            steps.append(np.append(0.0, np.cumsum(_integral(piece, x[:-1], x[1:]))))
        self.starts = np.append(0.0, np.cumsum([own[-1] for own in steps]))
        self.steps = steps
        self.length = float(self.starts[-1])

    def at(self, k: int, x: np.ndarray) -> np.ndarray:
        """Return the distances until the parameters x of piece k."""
        h = self.pieces[k].length / PANELS
        panel = np.clip((x / h).astype(int), 0, PANELS - 1)
        return self.starts[k] + self.steps[k][panel] + _integral(self.pieces[k], panel * h, x)

    def span(self, k: int, start: float, end: float) -> tuple[float, float] | None:
        """Return the parameters of piece k between two distances, or None if there are none."""
        if end < self.starts[k] or start > self.starts[k + 1]:
            return None
        return self._parameter(k, start), self._parameter(k, end)

    def _parameter(self, k: int, distance: float) -> float:
        length = self.pieces[k].length
        if distance <= self.starts[k]:
            return 0.0
        if distance >= self.starts[k + 1]:
            return length
        x = length * float(np.interp(distance - self.starts[k], self.steps[k], np.linspace(0.0, 1.0, PANELS + 1)))
        for _ in range(4):
            pace = float(_pace(self.pieces[k], np.array([x]))[0])
            x = min(max(x - (float(self.at(k, np.array([x]))[0]) - distance) / pace, 0.0), length)
        return x


def _integral(piece: Piece, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    middle, half = 0.5 * (end + start), 0.5 * (end - start)
    return half * (_pace(piece, middle[:, None] + half[:, None] * NODES[0]) @ NODES[1])


def _pace(piece: Piece, x: np.ndarray) -> np.ndarray:
    return np.sqrt(sum(p * p for p in piece.derivatives(x)[1]))


G, WHEELBASE = 9.80665, 2.7


class Forms:
    """The products in which the quantities of a motion are formulas."""

    def __init__(self, rows: list[list[Any]], arithmetic: Arithmetic):
        self.r, self.v, self.a, self.j = rows
        self.arithmetic, self.sqrt = arithmetic, arithmetic.sqrt
        v, a, j = self.v, self.a, self.j
        self.cross = [v[1] * a[2] - v[2] * a[1], v[2] * a[0] - v[0] * a[2], v[0] * a[1] - v[1] * a[0]]
        self.S, self.B, self.N = dot(v, v), dot(v, a), dot(self.cross, self.cross)
        self.H, self.P, self.G = v[0] ** 2 + v[1] ** 2, self.cross[2], v[0] * a[0] + v[1] * a[1]
        self.P1 = v[0] * j[1] - v[1] * j[0]
        self.s, self.h = self.sqrt(self.S), self.sqrt(self.H)


def dot(x: list[Any], y: list[Any]) -> Any:
    """Return the scalar product of two vectors."""
    return sum(p * q for p, q in zip(x, y, strict=True))


def _bent(f: Forms) -> Any:
    """Return the derivative of the horizontal curvature P/√H³."""
    return (f.P1 * f.H - 3 * f.P * f.G) / (f.H**2 * f.h)


FORMULAS: dict[str, Callable[[Forms], Any]] = {
    "speed": lambda f: f.s,
    "acceleration": lambda f: f.sqrt(dot(f.a, f.a)),
    "jerk": lambda f: f.sqrt(dot(f.j, f.j)),
    "curvature": lambda f: f.sqrt(f.N) / (f.S * f.s),
    "torsion": lambda f: dot(f.cross, f.j) / f.N,
    "lateral_acceleration": lambda f: f.sqrt(f.N) / f.s,
    "longitudinal_acceleration": lambda f: f.B / f.s,
    "slope": lambda f: f.v[2] / f.h,
    "yaw_rate": lambda f: f.P / (f.s * f.h),
    "yaw_acceleration": lambda f: f.P1 / (f.s * f.h) - f.P * (f.B * f.H + f.S * f.G) / (f.S * f.H * f.s * f.h),
    "longitudinal_jerk": lambda f: ((dot(f.a, f.a) + dot(f.v, f.j)) * f.S - f.B**2) / (f.S * f.s),
    "lateral_jerk": lambda f: (f.P1 * f.H - f.P * f.G) / (f.H * f.h),
    "horizontal_curvature": lambda f: f.P / (f.H * f.h),
    "curvature_rate": _bent,
    "sharpness": lambda f: _bent(f) / f.h,
    "height": lambda f: f.r[2],
    "vertical_speed": lambda f: f.v[2],
    "vertical_acceleration": lambda f: f.a[2],
    "load_factor": lambda f: f.sqrt(f.a[0] ** 2 + f.a[1] ** 2 + (f.a[2] + G) ** 2) / G,
    "tilt": lambda f: f.arithmetic.atan2(f.sqrt(f.a[0] ** 2 + f.a[1] ** 2), f.a[2] + G),
    "bank_angle": lambda f: f.arithmetic.atan2(f.P * f.s, (f.a[2] + G) * f.H - f.v[2] * f.G),
    "steering_angle": lambda f: f.arithmetic.atan(WHEELBASE * f.P / (f.H * f.h)),
    "steering_rate": lambda f: WHEELBASE * _bent(f) / (1 + (WHEELBASE * f.P / (f.H * f.h)) ** 2),
}
"""The signed quantities, from their definitions; those of a steering angle are for the wheelbase above."""
