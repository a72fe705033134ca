"""`retime` against TOPPRA on the same paths and limits: durations, run time, and what is exceeded between samples.

`python -m benchmarks.timing`, with `toppra` installed (extra `dev`). The limits are the speed, the lateral and the
longitudinal acceleration; the vehicle starts and ends at rest. TOPPRA gets as many grid intervals as `retime` has
cells, and ten times as many. Its squared path speed is linear between grid points; there the limits are evaluated at
64 places of each interval.
"""

import argparse
import time

import jax
import jax.numpy as jnp
import numpy as np
import toppra
from scipy.interpolate import CubicSpline
from toppra.algorithm import TOPPRA
from toppra.constraint import LinearConstraint
from toppra.interpolator import AbstractGeometricPath

import qtraj as qt

SPEED, LATERAL, LONGITUDINAL = 15.0, 3.0, 2.0
LIMITS = {"speed": SPEED, "lateral_acceleration": LATERAL, "longitudinal_acceleration": LONGITUDINAL}
PLACES = 64


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


def coefficients(rows):
    """The speed, the lateral acceleration per a, and (p, q) in the longitudinal acceleration p·a + q·a'/2."""
    _, r1, r2 = rows
    speed = np.linalg.norm(r1, axis=-1)
    return speed, np.linalg.norm(np.cross(r1, r2), axis=-1) / speed, np.sum(r1 * r2, axis=-1) / speed


class VehicleLimits(LinearConstraint):
    """The three limits, on x = u̇² and ü."""

    def compute_constraint_params(self, path, gridpoints, *args, **kwargs):
        """Coefficients as TOPPRA defines them."""
        speed, across, along = coefficients(path.rows(gridpoints))
        n = len(gridpoints)
        highest = np.minimum((SPEED / speed) ** 2, LATERAL / np.maximum(across, 1e-12))
        bounds = np.stack([np.zeros(n), highest], axis=1)
        sides, limits = np.tile([[[1.0], [-1.0]]], (n, 1, 1)), np.full((n, 2), LONGITUDINAL)
        return speed[:, None], along[:, None], np.zeros((n, 1)), sides, limits, None, bounds


def with_toppra(path, intervals):
    """Duration, run time and largest relative excess of a limit between the grid points."""
    own = Sampled(path)
    grid = np.linspace(0.0, own.duration, intervals + 1)
    fine = (grid[:-1, None] + np.diff(grid)[:, None] * (np.arange(PLACES) + 0.5) / PLACES).ravel()
    own.rows(grid), own.rows(fine)  # compiled before the clock starts
    start = time.perf_counter()
    problem = TOPPRA([VehicleLimits()], own, gridpoints=grid, solver_wrapper="seidel")
    _, speeds, _ = problem.compute_parameterization(0.0, 0.0)
    spent = time.perf_counter() - start
    a = speeds**2
    inner, slope = np.interp(fine, grid, a), np.repeat(np.diff(a) / np.diff(grid), PLACES)
    speed, across, along = coefficients(own.rows(fine))
    used = [
        speed * np.sqrt(inner) / SPEED,
        across * inner / LATERAL,
        np.abs(along * inner + 0.5 * speed * slope) / LONGITUDINAL,
    ]
    return np.sum(2 * np.diff(grid) / (speeds[1:] + speeds[:-1])), spent, max(np.max(x) for x in used) - 1


def paths(count):
    """Turns with polynomial angle, and splines of SciPy as routes; seeded."""
    rng = np.random.default_rng(0)
    for k in range(count):
        if k % 2:
            points = np.cumsum(rng.normal([12.0, 0, 0], [3.0, 6.0, 0.5], (8, 3)), axis=0)
            yield qt.Route.from_piecewise(CubicSpline(np.arange(8.0), points))
        else:
            start = qt.BoundaryState([rng.uniform(20, 40), 0, 0], [rng.normal(0, 2), 10.0, 0.5])
            end = qt.BoundaryState([0, rng.uniform(20, 40), 3], [-10.0, rng.normal(0, 2), 0.5])
            yield qt.SpiralHelix.hermite(start, end, rng.uniform(4, 6))


def main():
    """Print a row for each path."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--paths", type=int, default=20)
    parser.add_argument("--cells", type=int, default=256)
    options = parser.parse_args()
    toppra.setup_logging("ERROR")
    limits = qt.Limits(**LIMITS)
    print("path   retime: s, ms, proved | toppra: s, ms, excess | 10 × its grid: s, excess | retime / that − 1")
    rows = []
    for k, path in enumerate(paths(options.paths)):
        call = lambda path=path: qt.retime(path, limits, start_speed=0.0, end_speed=0.0, knots=options.cells)  # noqa: E731
        timed = call()
        start = time.perf_counter()
        jax.block_until_ready(call().duration)
        spent = time.perf_counter() - start
        same, finer = with_toppra(path, options.cells), with_toppra(path, 10 * options.cells)
        ratio = float(timed.duration) / finer[0] - 1
        rows.append((spent, same[1], same[2], finer[2], ratio, timed.certificate.holds))
        print(
            f"{k:4d}  {float(timed.duration):8.4f} {1e3 * spent:6.0f} {timed.certificate.holds!s:5} | {same[0]:8.4f} "
            f"{1e3 * same[1]:6.1f} {same[2]:8.1e} | {finer[0]:8.4f} {finer[2]:8.1e} | {ratio:+.1e}",
            flush=True,
        )
    spent, same, excess, finer, ratio, holds = (np.array(x) for x in zip(*rows, strict=True))
    print(
        f"median run time {1e3 * np.median(spent):.0f} ms against {1e3 * np.median(same):.1f} ms; proved {holds.sum()} "
        f"of {len(rows)}; largest excess between samples {excess.max():.1e} and {finer.max():.1e}; duration against "
        f"the finer grid {ratio.min():+.1e} to {ratio.max():+.1e}"
    )


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main()
