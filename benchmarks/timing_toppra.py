"""Solve the problem of `retime` with TOPPRA, for limits on the speed and on the lateral and longitudinal acceleration.

TOPPRA's squared path speed is linear between its grid points.
"""

import time
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from toppra.algorithm import TOPPRA
from toppra.constraint import LinearConstraint
from toppra.interpolator import AbstractGeometricPath

import qtraj as qt
from benchmarks.timing_proof import Cells, exceeded

SPEED, LATERAL, LONGITUDINAL = 15.0, 3.0, 2.0
LIMITS = {"speed": SPEED, "lateral_acceleration": LATERAL, "longitudinal_acceleration": LONGITUDINAL}
PLACES = 64
"""Number of places in each interval at which the limits are evaluated."""


class Sampled(AbstractGeometricPath):
    """A path of qtraj for TOPPRA."""

    def __init__(self, path):
        self.evaluate = jax.jit(jax.vmap(lambda u: path.derivatives(u, 2)))
        self._duration = float(path.duration)

    def rows(self, u):
        """r, r' and r'' at many parameters."""
        return np.moveaxis(np.asarray(self.evaluate(jnp.asarray(np.atleast_1d(u), float))), 1, 0)

    def __call__(self, path_positions, order=0):
        found = self.rows(path_positions)[order]
        return found if np.ndim(path_positions) else found[0]

    dof = property(lambda self: 3)
    path_interval = property(lambda self: np.array([0.0, self._duration]))
    duration = property(lambda self: self._duration)
    waypoints = property(lambda self: (np.array([0.0, self._duration]), self(np.array([0.0, self._duration]))))


class OfSpline(AbstractGeometricPath):
    """A spline of SciPy for TOPPRA."""

    def __init__(self, spline):
        self._orders = spline, spline.derivative(1), spline.derivative(2)

    def rows(self, u):
        """r, r' and r'' at many parameters."""
        return np.stack([p(np.atleast_1d(u)) for p in self._orders])

    def __call__(self, path_positions, order=0):
        return self._orders[order](path_positions)

    dof = property(lambda self: 3)
    path_interval = property(lambda self: self._orders[0].x[[0, -1]])
    duration = property(lambda self: float(self._orders[0].x[-1]))
    waypoints = property(lambda self: (self.path_interval, self(self.path_interval)))


def coefficients(rows):
    """The speed, the lateral acceleration per a, and (p, q) in the longitudinal acceleration p·a + q·a'/2."""
    _, r1, r2 = rows
    speed = np.linalg.norm(r1, axis=-1)
    return speed, np.linalg.norm(np.cross(r1, r2), axis=-1) / speed, np.sum(r1 * r2, axis=-1) / speed


class VehicleLimits(LinearConstraint):
    """The three limits, on x = u̇² and ü."""

    def __init__(self, limits):
        super().__init__()
        self._limits = limits

    def compute_constraint_params(self, path, gridpoints, *args, **kwargs):
        """Coefficients as TOPPRA defines them."""
        speed, across, along = coefficients(path.rows(gridpoints))
        n = len(gridpoints)
        most, lateral, longitudinal = (self._limits[name] for name in LIMITS)
        highest = np.minimum((most / speed) ** 2, lateral / np.maximum(across, 1e-12))
        bounds = np.stack([np.zeros(n), highest], axis=1)
        sides, limits = np.tile([[[1.0], [-1.0]]], (n, 1, 1)), np.full((n, 2), longitudinal)
        return speed[:, None], along[:, None], np.zeros((n, 1)), sides, limits, None, bounds


class Solution(NamedTuple):
    """TOPPRA's u̇² at its grid points, its duration [s], and its run time and processor time [s]."""

    grid: np.ndarray
    squares: np.ndarray
    duration: float
    spent: float
    processor: float


def with_toppra(own, grid, limits=LIMITS):
    """Solve the problem for a path on a grid of parameters; the duration is NaN without a solution."""
    own.rows(grid)  # compiled before the clock starts
    start, used_before = time.perf_counter(), time.process_time()
    problem = TOPPRA([VehicleLimits(limits)], own, gridpoints=grid, solver_wrapper="seidel")
    _, speeds, _ = problem.compute_parameterization(0.0, 0.0)
    spent, processor = time.perf_counter() - start, time.process_time() - used_before
    if speeds is None:
        return Solution(grid, np.full(len(grid), np.nan), np.nan, spent, processor)
    duration = float(np.sum(2 * np.diff(grid) / (speeds[1:] + speeds[:-1])))
    return Solution(grid, speeds**2, duration, spent, processor)


def sampled_excess(own, solution, limits=LIMITS):
    """Return the largest relative excess of a limit at `PLACES` places of each interval."""
    grid, a = solution.grid, solution.squares
    fine = (grid[:-1, None] + np.diff(grid)[:, None] * (np.arange(PLACES) + 0.5) / PLACES).ravel()
    inner, slope = np.interp(fine, grid, a), np.repeat(np.diff(a) / np.diff(grid), PLACES)
    speed, across, along = coefficients(own.rows(fine))
    most, lateral, longitudinal = (limits[name] for name in LIMITS)
    used = [
        speed * np.sqrt(inner) / most,
        across * inner / lateral,
        np.abs(along * inner + 0.5 * speed * slope) / longitudinal,
    ]
    return max(np.max(x) for x in used) - 1


def proved_excess(cells: Cells, solution):
    """Return the status and the proved excess of each limit, for a solution on the knots of `cells`."""
    a = solution.squares
    powers = np.stack([a[:-1], np.diff(a), 0 * a[1:], 0 * a[1:]], axis=1)
    return exceeded(cells, powers, (True, True), qt.Limits(**LIMITS))
