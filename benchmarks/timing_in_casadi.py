"""The fastest timing with a limit on the jerk as a nonlinear program for IPOPT, through CasADi.

The unknowns are a = u̇² and b = ü at the nodes of a fine grid of the path parameter u. Between two nodes b is linear in
u, so a is quadratic. The limits on the speed, the lateral and the longitudinal acceleration are imposed at the nodes,
that on the jerk at both ends of every interval. The path starts and ends at rest.
"""

from typing import Any, NamedTuple

import casadi as ca
import numpy as np

INSIDE = 1e-9
"""Fraction of an interval by which its ends are moved inside, because derivatives may jump at a joint of the spline."""

LEAST = 1e-9
"""Smallest scale of a, relative to its maximum."""


class Ipopt(NamedTuple):
    """The duration [s], and whether IPOPT converged."""

    duration: float
    converged: bool


def with_ipopt(
    spline: Any, u: np.ndarray, a: np.ndarray, limits: dict[str, float], steps: int = 200, seconds: float = 20.0
) -> Ipopt:
    """Return IPOPT's timing on the nodes `u`; `a` is u̇² of a first iterate at the nodes."""
    h = np.diff(u)
    sides = [_Side(spline, u[:-1] + INSIDE * h), _Side(spline, u[1:] - INSIDE * h)]
    speed, across = np.zeros(u.size), np.zeros(u.size)
    for side, part in zip(sides, (slice(-1), slice(1, None)), strict=True):
        speed[part], across[part] = np.maximum(speed[part], side.pace), np.maximum(across[part], side.across)
    highest = np.minimum((limits["speed"] / speed) ** 2, limits["lateral_acceleration"] / np.maximum(across, 1e-300))
    scale = np.maximum(a, LEAST * a.max())
    bend = np.maximum(np.abs(np.gradient(a, u)) / 2, 1e-3 * limits["longitudinal_acceleration"] / speed)
    x, y = ca.SX.sym("x", u.size), ca.SX.sym("y", u.size)
    own, b = x * scale, y * bend
    slope = (b[1:] - b[:-1]) / h
    equal = (own[1:] - own[:-1] - h * (b[1:] + b[:-1])) / np.maximum(scale[1:], scale[:-1])
    rows: list[Any] = []
    for k, side in enumerate(sides):
        nodes = slice(k, u.size - 1 + k)
        along = (own[nodes] * side.along + b[nodes] * side.pace) / limits["longitudinal_acceleration"]
        parts = [
            (own[nodes] * side.third[:, i] + 3 * b[nodes] * side.second[:, i] + slope * side.first[:, i])
            / limits["jerk"]
            for i in range(3)
        ]
        rows += [along, -along, own[nodes] * (parts[0] ** 2 + parts[1] ** 2 + parts[2] ** 2)]
    bounded, root = ca.vertcat(*rows), ca.vertcat(0, ca.sqrt(own[1:-1]), 0)
    unit = float(np.sum(2 * h / (np.sqrt(a[1:]) + np.sqrt(a[:-1]))))
    time = ca.sum1(2 * h / (root[1:] + root[:-1])) / unit
    problem = {"x": ca.vertcat(x, y), "f": time, "g": ca.vertcat(equal, bounded)}
    options = {
        "print_level": 0,
        "max_iter": steps,
        "sb": "yes",
        "tol": 1e-6,
        "mu_init": 1e-4,
        "bound_push": 1e-6,
        "max_cpu_time": seconds,
    }
    solver = ca.nlpsol("timing", "ipopt", problem, {"ipopt": options, "print_time": 0})
    low, high = np.full(2 * u.size, -np.inf), np.full(2 * u.size, np.inf)
    low[: u.size], high[: u.size] = 1e-3, highest / scale
    rest = [0, u.size - 1]
    low[rest], high[rest] = 0.0, 0.0
    first = np.concatenate([np.clip(a / scale, low[: u.size], high[: u.size]), np.gradient(a, u) / 2 / bend])
    free, most = np.zeros(u.size - 1), np.ones(bounded.numel())
    found = solver(
        x0=first, lbx=low, ubx=high, lbg=np.concatenate([free, -np.inf * most]), ubg=np.concatenate([free, most])
    )
    return Ipopt(unit * float(found["f"]), bool(solver.stats()["success"]))


class _Side:
    """The derivatives of a spline, and what follows from them for u̇ = 1 or ü = 1."""

    def __init__(self, spline: Any, u: np.ndarray):
        self.first, self.second, self.third = (spline.derivative(k)(u) for k in (1, 2, 3))
        self.pace = np.linalg.norm(self.first, axis=1)
        self.along = np.sum(self.first * self.second, axis=1) / self.pace
        self.across = np.linalg.norm(np.cross(self.first, self.second), axis=1) / self.pace
