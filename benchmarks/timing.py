"""Compare `retime` with TOPPRA on the same paths and limits: durations, run times, and violations between samples.

Run `python -m benchmarks.timing`, with `toppra` installed (extra `dev`). The limits are on speed, lateral acceleration
and longitudinal acceleration; the vehicle starts and ends at rest. The paths are circles and helices, whose minimum
time has a closed form; turns with a polynomial angle; SciPy splines as routes; and parts of a recorded drive. TOPPRA
runs with as many grid intervals as `retime` has cells, and with ten times as many. Its squared path speed is linear
between grid points. The limits are evaluated at 64 points of each interval.

`--batch N` instead retimes N turns in blocks on all cores, and compares them with TOPPRA on successively finer grids.
`--drive` measures the whole recorded drive with a limit on the jerk.
"""

import argparse
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import toppra
from scipy.interpolate import CubicSpline
from toppra.algorithm import TOPPRA
from toppra.constraint import LinearConstraint
from toppra.interpolator import AbstractGeometricPath

import qtraj as qt
from qtraj.foundation import cores

SPEED, LATERAL, LONGITUDINAL = 15.0, 3.0, 2.0
LIMITS = {"speed": SPEED, "lateral_acceleration": LATERAL, "longitudinal_acceleration": LONGITUDINAL}
PLACES = 64
BLOCK, COMPARED, GRIDS = 32, 3, 7
"""Number of paths in a block, of paths that TOPPRA also retimes, and of its grids; each grid is twice as fine."""
DRIVE = Path(__file__).parents[1] / "examples" / "drive_8km.csv.gz"


class Sampled(AbstractGeometricPath):
    """A qtraj path with the interface of TOPPRA."""

    def __init__(self, path):
        self.evaluate = jax.jit(jax.vmap(lambda u: path.derivatives(u, 2)))
        self._duration = float(path.duration)

    def rows(self, u):
        """Return r, r' and r'' at many parameters."""
        return np.moveaxis(np.asarray(self.evaluate(jnp.asarray(np.atleast_1d(u), float))), 1, 0)

    def __call__(self, path_positions, order=0):
        found = self.rows(path_positions)[order]
        return found if np.ndim(path_positions) else found[0]

    dof = property(lambda self: 3)
    path_interval = property(lambda self: np.array([0.0, self._duration]))
    duration = property(lambda self: self._duration)
    waypoints = property(lambda self: (np.array([0.0, self._duration]), self(np.array([0.0, self._duration]))))


def coefficients(rows):
    """Return |r'|, c and p: the lateral acceleration is c·a, the longitudinal one is p·a + |r'|·a'/2, with a = u̇²."""
    _, r1, r2 = rows
    speed = np.linalg.norm(r1, axis=-1)
    return speed, np.linalg.norm(np.cross(r1, r2), axis=-1) / speed, np.sum(r1 * r2, axis=-1) / speed


class VehicleLimits(LinearConstraint):
    """The three limits as constraints on x = u̇² and ü."""

    def compute_constraint_params(self, path, gridpoints, *args, **kwargs):
        """Return the coefficients as defined by TOPPRA."""
        speed, across, along = coefficients(path.rows(gridpoints))
        n = len(gridpoints)
        highest = np.minimum((SPEED / speed) ** 2, LATERAL / np.maximum(across, 1e-12))
        bounds = np.stack([np.zeros(n), highest], axis=1)
        sides, limits = np.tile([[[1.0], [-1.0]]], (n, 1, 1)), np.full((n, 2), LONGITUDINAL)
        return speed[:, None], along[:, None], np.zeros((n, 1)), sides, limits, None, bounds


def with_toppra(path, intervals):
    """Return duration, run time, largest relative violation between grid points, and processor time."""
    own = Sampled(path)
    grid = np.linspace(0.0, own.duration, intervals + 1)
    fine = (grid[:-1, None] + np.diff(grid)[:, None] * (np.arange(PLACES) + 0.5) / PLACES).ravel()
    own.rows(grid), own.rows(fine)  # compiled before the clock starts
    start, used_before = time.perf_counter(), time.process_time()
    problem = TOPPRA([VehicleLimits()], own, gridpoints=grid, solver_wrapper="seidel")
    _, speeds, _ = problem.compute_parameterization(0.0, 0.0)
    spent, processor = time.perf_counter() - start, time.process_time() - used_before
    a = speeds**2
    inner, slope = np.interp(fine, grid, a), np.repeat(np.diff(a) / np.diff(grid), PLACES)
    speed, across, along = coefficients(own.rows(fine))
    used = [
        speed * np.sqrt(inner) / SPEED,
        across * inner / LATERAL,
        np.abs(along * inner + 0.5 * speed * slope) / LONGITUDINAL,
    ]
    return np.sum(2 * np.diff(grid) / (speeds[1:] + speeds[:-1])), spent, max(np.max(x) for x in used) - 1, processor


def round_paths():
    """Yield random circles and helices with their minimum times, from constant acceleration up to the highest speed."""
    rng = np.random.default_rng(1)
    while True:
        radius, rate, climb, duration = rng.uniform(15, 40), rng.uniform(0.1, 0.3), rng.uniform(0, 2), 20.0
        speed = np.hypot(radius * rate, climb)
        highest = min(SPEED, (LATERAL / (radius * rate**2 / speed**2)) ** 0.5)
        length, ramp = speed * duration, highest**2 / LONGITUDINAL
        least = length / highest + highest / LONGITUDINAL if ramp <= length else 2 * (length / LONGITUDINAL) ** 0.5
        rows = [[radius, 0, 0, 0], [0.0, rate, 0, 0], [0.0, climb, 0, 0]]
        yield qt.SpiralHelix(*(np.array(row) for row in rows), duration), least


def turns():
    """Yield random turns with a polynomial angle."""
    rng = np.random.default_rng(0)
    while True:
        start = qt.BoundaryState([rng.uniform(20, 40), 0, 0], [rng.normal(0, 2), 10.0, 0.5])
        end = qt.BoundaryState([0, rng.uniform(20, 40), 3], [-10.0, rng.normal(0, 2), 0.5])
        yield qt.SpiralHelix.hermite(start, end, rng.uniform(4, 6))


def splines():
    """Yield random SciPy splines as routes."""
    rng = np.random.default_rng(2)
    while True:
        points = np.cumsum(rng.normal([12.0, 0, 0], [3.0, 6.0, 0.5], (8, 3)), axis=0)
        yield qt.Route.from_piecewise(CubicSpline(np.arange(8.0), points))


def drives():
    """Yield parts of a recorded drive, each with 60 segments and without slow motion."""
    route = qt.fit_route(qt.read_track(DRIVE)).path
    times = np.asarray(route.times)
    for first in range(0, times.size - 60, 20):
        inside = np.linspace(times[first], times[first + 60], 500)
        speeds = np.linalg.norm(np.asarray(jax.vmap(route.velocity)(jnp.asarray(inside))), axis=1)
        if speeds.min() > 1.0:
            yield route.window(times[first], times[first + 60])


def cases(count):
    """Yield (kind, path, closed form or NaN), with the kinds in turn."""
    kinds = {"round": round_paths(), "turn": turns(), "spline": splines(), "drive": drives()}
    for k in range(count):
        kind = list(kinds)[k % len(kinds)]
        found = next(kinds[kind], None)
        if found is not None:
            yield (kind, *found) if kind == "round" else (kind, found, np.nan)


def batch(count, cells):
    """Retime `count` turns, with proofs, and some of them with TOPPRA on finer grids until its error is as small.

    Blocks of `BLOCK` turns are distributed over the cores. The error is the relative error of the duration. The exact
    duration is extrapolated from TOPPRA's two finest grids, because TOPPRA's error is proportional to the length of the
    intervals.
    """
    source = turns()
    many = [next(source) for _ in range(count)]
    stacked, limits = jax.tree.map(lambda *x: np.stack(x), *many), qt.Limits(**LIMITS)

    def retimed(path):
        found = qt.retime(path, limits, start_speed=0.0, end_speed=0.0, knots=cells)
        return found.duration, found.code

    call = jax.jit(jax.vmap(retimed))
    blocks = cores.split(np.arange(count), BLOCK)
    arguments = [(cores.take(stacked, block, BLOCK),) for block in blocks]
    start = time.process_time()
    list(cores.map_blocks(call, arguments[:1]))
    compiled = time.process_time() - start
    start, used = time.perf_counter(), time.process_time()
    found = list(cores.map_blocks(call, arguments))
    own, used = (1e3 * x / count for x in (time.perf_counter() - start, time.process_time() - used))
    durations, codes = (np.concatenate(x)[:count] for x in zip(*found, strict=True))
    print(
        f"batch of {count}, {cells} cells: {own:.2f} ms for each path ({used:.2f} ms of processor time), proved: "
        f"{np.sum(codes == qt.ResultCode.successful)}; first call {compiled:.0f} s of processor time",
        flush=True,
    )
    grids = cells * 2 ** np.arange(GRIDS)
    rows = np.array([[with_toppra(path, n) for n in grids] for path in many[:COMPARED]])
    exact = 2 * rows[:, -1, 0] - rows[:, -2, 0]
    error = np.median(np.abs(durations[: len(exact)] / exact - 1))
    others = np.median(np.abs(rows[..., 0] / exact[:, None] - 1), axis=0)
    print(f"error of the duration (median of {len(exact)} paths): {error:.1e}")
    for n, other, row in zip(grids, others, np.moveaxis(rows, 1, 0), strict=True):
        spent, processor = 1e3 * np.median(row[:, [1, 3]], axis=0)
        print(
            f"TOPPRA, {n:6d} intervals: error {other:.1e}, violation up to {np.max(row[:, 2]):.1e}, {spent:5.0f} ms "
            f"({processor:.0f} ms of processor time): {spent / own:.1f} times as long ({processor / used:.1f} times)",
            flush=True,
        )
        if other <= error:
            break


def whole_drive():
    """Retime the recorded drive with a limit on the jerk, in processor time."""
    route, limits = qt.fit_route(qt.read_track(DRIVE)).path, qt.Limits(**LIMITS, jerk=0.9)
    for call in ("first", "second"):
        start = time.process_time()
        timed = jax.block_until_ready(qt.retime(route, limits))
        print(
            f"{call} call: {time.process_time() - start:.1f} s of processor time; {float(timed.duration):.2f} s, "
            f"{timed.usage.shape[1]} cells, {int(timed.iterations)} steps, proved {timed.certificate.holds}",
            flush=True,
        )


def main():
    """Print a row for each path."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--paths", type=int, default=20)
    parser.add_argument("--cells", type=int, help="default: 512, or 64 with --batch")
    parser.add_argument("--batch", type=int, default=0)
    parser.add_argument("--drive", action="store_true")
    options = parser.parse_args()
    toppra.setup_logging("ERROR")
    if options.drive:
        whole_drive()
        return
    if options.batch:
        batch(options.batch, options.cells or 64)
        return
    limits, cells = qt.Limits(**LIMITS), options.cells or 512
    print(
        "path    retime: s, ms, proved | toppra: s, ms, violation | finer grid: s, violation | ratio to it, closed form"
    )
    rows = []
    for kind, path, least in cases(options.paths):
        call = lambda path=path: qt.retime(path, limits, start_speed=0.0, end_speed=0.0, knots=cells)  # noqa: E731
        timed = call()
        start = time.perf_counter()
        jax.block_until_ready(call().duration)
        spent = time.perf_counter() - start
        same, finer = with_toppra(path, cells), with_toppra(path, 10 * cells)
        ratio, closed = (float(timed.duration) / x - 1 for x in (finer[0], least))
        rows.append((spent, same[1], finer[1], same[2], finer[2], ratio, closed, timed.certificate.holds))
        print(
            f"{kind:6s}  {float(timed.duration):8.4f} {1e3 * spent:6.0f} {timed.certificate.holds!s:5} | "
            f"{same[0]:8.4f} {1e3 * same[1]:6.1f} {same[2]:8.1e} | {finer[0]:8.4f} {finer[2]:8.1e} | "
            f"{ratio:+.1e} {closed:+.1e}",
            flush=True,
        )
    spent, same, slower, excess, finer, ratio, closed, holds = (np.array(x) for x in zip(*rows, strict=True))
    print(
        f"median run time {1e3 * np.median(spent):.0f} ms against {1e3 * np.median(same):.1f} ms and "
        f"{1e3 * np.median(slower):.0f} ms with the finer grid; proved {holds.sum()} of {len(rows)}; violations "
        f"between samples {excess.min():.1e} to {excess.max():.1e}, "
        f"with the finer grid {finer.min():.1e} to {finer.max():.1e}; "
        f"duration against the finer grid {ratio.min():+.1e} to {ratio.max():+.1e}, against closed forms "
        f"{np.nanmin(closed):+.1e} to {np.nanmax(closed):+.1e}"
    )


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main()
