"""The fastest timing with a limit on the jerk as a nonlinear program for IPOPT, through CasADi.

The path parameter u has fixed nodes. The unknowns are u̇ and ü at the nodes, and the duration and the constant d³u/dt³
of every interval between them. So the motion is integrated exactly, every constraint is a polynomial, and nothing is
singular at rest. The limits on the speed, the lateral and the longitudinal acceleration are imposed at the nodes, and
the jerk at both ends. (If d³u/dt³ varies linearly in every interval, the solutions oscillate between
the nodes, where they exceed the limits many times over.) The path starts and ends at rest.

CasADi supplies exact, sparse first and second derivatives; IPOPT uses MUMPS. Every unknown is scaled by its first value
and every equation by its terms, because u̇ varies by many powers of ten along a path with near cusps.
"""

from typing import Any, NamedTuple

import casadi as ca
import numpy as np

INSIDE = 1e-9
"""Fraction of an interval by which its ends are moved inside, because derivatives may jump at a joint of the spline."""

LEAST = 1e-4
"""Smallest scale of u̇, relative to its maximum."""

SAMPLES = np.linspace(0.0, 1.0, 17)
"""Where the limits are evaluated in every interval, as fractions of its duration."""


class Ipopt(NamedTuple):
    """The duration [s], whether IPOPT converged, its steps, and the largest ratio of a quantity to its limit."""

    duration: float
    converged: bool
    steps: int
    usage: float


def with_ipopt(
    spline: Any,
    u: np.ndarray,
    a: np.ndarray,
    slope: np.ndarray,
    limits: dict[str, float],
    steps: int = 500,
    seconds: float = 60.0,
) -> Ipopt:
    """Return IPOPT's timing on the nodes `u`, which starts from u̇² = `a` and ü = `slope` / 2 there."""
    h, cells = np.diff(u), u.size - 1
    sides = [_Side(spline, u[:-1] + INSIDE * h), _Side(spline, u[1:] - INSIDE * h)]
    first = np.sqrt(np.maximum(a, 0.0)), slope / 2
    spans = 2 * h / (first[0][1:] + first[0][:-1])
    third = np.diff(first[1]) / spans
    v_unit = np.maximum(first[0], LEAST * first[0].max())
    c_unit = np.maximum(np.abs(first[1]), 1e-2 * limits["longitudinal_acceleration"] / _largest(sides, "pace"))
    j_unit = limits["jerk"] / np.maximum(sides[0].pace, sides[1].pace)
    units = [v_unit, c_unit, j_unit, spans]
    unknown = [ca.SX.sym(name, unit.size) for name, unit in zip("vcjt", units, strict=True)]
    v, c, j, t = (x * unit for x, unit in zip(unknown, units, strict=True))
    equal = [
        (v[:-1] * t + c[:-1] * t**2 / 2 + j * t**3 / 6 - h) / h,
        (v[1:] - v[:-1] - c[:-1] * t - j * t**2 / 2) / np.maximum(v_unit[1:], v_unit[:-1]),
        (c[1:] - c[:-1] - j * t) / np.maximum(c_unit[1:], c_unit[:-1]),
    ]
    rows: list[Any] = []
    for k, side in enumerate(sides):
        own, rate = v[k : cells + k], c[k : cells + k]
        along = (own**2 * side.along + rate * side.pace) / limits["longitudinal_acceleration"]
        parts = [
            (own**3 * side.third[:, i] + 3 * own * rate * side.second[:, i] + j * side.first[:, i]) / limits["jerk"]
            for i in range(3)
        ]
        rows += [along, -along, parts[0] ** 2 + parts[1] ** 2 + parts[2] ** 2]
    bounded, unit = ca.vertcat(*rows), float(spans.sum())
    problem = {"x": ca.vertcat(*unknown), "f": ca.sum1(t) / unit, "g": ca.vertcat(*equal, bounded)}
    options = {
        "print_level": 0,
        "sb": "yes",
        "max_iter": steps,
        "max_cpu_time": seconds,
        "tol": 1e-6,
        "mu_init": 1e-4,
        "bound_push": 1e-6,
        "bound_frac": 1e-6,
    }
    solver = ca.nlpsol("timing", "ipopt", problem, {"ipopt": options, "print_time": 0})
    start = np.concatenate([x / unit for x, unit in zip((*first, third, spans), units, strict=True)])
    low, high = np.full(start.size, -np.inf), np.full(start.size, np.inf)
    low[: cells + 1], high[: cells + 1] = 0.0, _highest(sides, limits) / v_unit
    high[[0, cells]] = 0.0
    low[-cells:] = 1e-3
    zero, one = np.zeros(3 * cells), np.ones(bounded.numel())
    found = solver(
        x0=start, lbx=low, ubx=high, lbg=np.concatenate([zero, -np.inf * one]), ubg=np.concatenate([zero, one])
    )
    parts = np.split(np.asarray(found["x"]).ravel(), np.cumsum([unit.size for unit in units])[:-1])
    v, c, j, t = ((x * unit)[:cells, None] for x, unit in zip(parts, units, strict=True))
    usage = _usage(spline, u, v, c, j, t, limits)
    stats = solver.stats()
    return Ipopt(unit * float(found["f"]), bool(stats["success"]), int(stats["iter_count"]), usage)


def _largest(sides: Any, name: str) -> np.ndarray:
    """Return the larger value of the two sides of each node."""
    left, right = getattr(sides[1], name), getattr(sides[0], name)
    return np.maximum(np.append(right, 0.0), np.append(0.0, left))


def _highest(sides: Any, limits: dict[str, float]) -> np.ndarray:
    """Return the highest u̇ at the nodes by the limits on the speed and the lateral acceleration."""
    across = np.maximum(_largest(sides, "across"), 1e-300)
    return np.minimum(limits["speed"] / _largest(sides, "pace"), np.sqrt(limits["lateral_acceleration"] / across))


def _usage(spline: Any, u: Any, v: Any, c: Any, j: Any, spans: Any, limits: dict[str, float]) -> float:
    """Return the largest ratio of a quantity to its limit within the intervals."""
    t = spans * SAMPLES
    ahead = v * t + c * t**2 / 2 + j * t**3 / 6
    h = np.diff(u)[:, None]
    side = _Side(spline, (u[:-1, None] + h * np.clip(ahead / h, INSIDE, 1 - INSIDE)).ravel())
    rate, bend, constant = (v + c * t + j * t**2 / 2).ravel(), (c + j * t).ravel(), (j + 0 * t).ravel()
    jerk = side.third * rate[:, None] ** 3 + 3 * side.second * (rate * bend)[:, None] + side.first * constant[:, None]
    values = {
        "speed": rate * side.pace,
        "lateral_acceleration": rate**2 * side.across,
        "longitudinal_acceleration": np.abs(rate**2 * side.along + bend * side.pace),
        "jerk": np.linalg.norm(jerk, axis=1),
    }
    return max(float(np.max(values[name])) / limit for name, limit in limits.items())


class _Side:
    """The derivatives of a spline, and what follows from them for u̇ = 1 or ü = 1."""

    def __init__(self, spline: Any, u: np.ndarray):
        self.first, self.second, self.third = (spline.derivative(k)(u) for k in (1, 2, 3))
        self.pace = np.linalg.norm(self.first, axis=1)
        self.along = np.sum(self.first * self.second, axis=1) / self.pace
        self.across = np.linalg.norm(np.cross(self.first, self.second), axis=1) / self.pace
