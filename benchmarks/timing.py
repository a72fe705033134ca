"""`retime` against TOPPRA on the same paths and limits: durations, run time, and excess between samples.

`python -m benchmarks.timing`, with `toppra` installed (extra `dev`). The limits are the speed, the lateral and the
longitudinal acceleration; the vehicle starts and ends at rest. The paths are circles and helices, whose least time has
a closed form; turns with a polynomial angle; splines of SciPy as routes; and overlapping parts of a recorded drive.
TOPPRA gets the cells of `retime` as grid intervals, and these divided into ten. Its squared path speed is linear
between grid points. On the first grid, the proof of `retime` is applied to TOPPRA's timing: see `timing_proof`. On the
finer grid the limits are evaluated at 64 places of each interval. At the end, both programs solve the two problems of
TOPPRA's own test suite that have a known optimum.

`--batch N` retimes N turns in blocks on all cores instead, and compares with TOPPRA on finer and finer
grids. `--drive` measures the whole recorded drive with a limit on the jerk.
"""

import argparse
import itertools
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import toppra
from scipy.interpolate import CubicSpline
from toppra import SplineInterpolator
from toppra.algorithm import TOPPRA
from toppra.constraint import JointAccelerationConstraint, JointVelocityConstraint

import qtraj as qt
from benchmarks.timing_proof import cells_of
from benchmarks.timing_toppra import (
    LATERAL,
    LIMITS,
    LONGITUDINAL,
    SPEED,
    Sampled,
    proved_excess,
    sampled_excess,
    with_toppra,
)
from qtraj.foundation import cores

FINER = 10
"""How many times finer the second grid of TOPPRA is."""
BLOCK, COMPARED, GRIDS = 128, 3, 7
"""Paths in a block of a batch; paths of the batch for TOPPRA, and number of its grids, each twice as fine."""
SUITE = {"two_points_1": (1.0, 0.2), "two_points_2": (1e-4, 0.002)}
"""Length [m] and optimal duration [s] of straight paths with two waypoints, in TOPPRA's robustness suite."""
SUITE_LIMIT = 100.0
"""Limit on the speed [m/s] and on the acceleration [m/s²] in that suite."""
DRIVE = Path(__file__).parents[1] / "examples" / "drive_8km.csv.gz"


def round_paths():
    """Circles and helices, seeded, each with its least time: constant acceleration up to the highest speed."""
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
    """Turns with a polynomial angle, seeded."""
    rng = np.random.default_rng(0)
    while True:
        start = qt.BoundaryState([rng.uniform(20, 40), 0, 0], [rng.normal(0, 2), 10.0, 0.5])
        end = qt.BoundaryState([0, rng.uniform(20, 40), 3], [-10.0, rng.normal(0, 2), 0.5])
        yield qt.SpiralHelix.hermite(start, end, rng.uniform(4, 6))


def splines():
    """Splines of SciPy as routes, seeded."""
    rng = np.random.default_rng(2)
    while True:
        points = np.cumsum(rng.normal([12.0, 0, 0], [3.0, 6.0, 0.5], (8, 3)), axis=0)
        yield qt.Route.from_piecewise(CubicSpline(np.arange(8.0), points))


def drives():
    """Parts of a recorded drive of which each has 60 segments and no slow motion."""
    route = qt.fit_route(qt.read_track(DRIVE)).path
    times = np.asarray(route.times)
    for first in range(0, times.size - 60, 20):
        inside = np.linspace(times[first], times[first + 60], 500)
        speeds = np.linalg.norm(np.asarray(jax.vmap(route.velocity)(jnp.asarray(inside))), axis=1)
        if speeds.min() > 1.0:
            yield route.window(times[first], times[first + 60])


def cases(count):
    """Yield (kind, path, closed form or NaN) for `count` paths, of all kinds in turn while there are any."""
    kinds = {"round": round_paths(), "turn": turns(), "spline": splines(), "drive": drives()}
    of_all = ((kind, found) for kind in itertools.cycle(kinds) if (found := next(kinds[kind], None)) is not None)
    for kind, found in itertools.islice(of_all, count):
        yield (kind, *found) if kind == "round" else (kind, found, np.nan)


def batch(count, cells):
    """Retime `count` turns, with proofs, and some of them with TOPPRA on grids up to one with the same error.

    Blocks of `BLOCK` turns are distributed over the cores. The error is that of the duration; the exact duration is
    extrapolated from TOPPRA's two finest grids, because its error is proportional to the length of the intervals.
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
        f"batch of {count}, {cells} cells: {own:.2f} ms for each path ({used:.2f} ms of processor time), proved "
        f"{np.sum(codes == qt.ResultCode.successful)}; first call {compiled:.0f} s of processor time",
        flush=True,
    )
    grids = cells * 2 ** np.arange(GRIDS)
    rows = np.array([[_row(path, n) for n in grids] for path in many[:COMPARED]])
    exact = 2 * rows[:, -1, 0] - rows[:, -2, 0]
    error = np.median(np.abs(durations[: len(exact)] / exact - 1))
    others = np.median(np.abs(rows[..., 0] / exact[:, None] - 1), axis=0)
    print(f"error of the duration (median of {len(exact)} paths): {error:.1e}")
    for n, other, row in zip(grids, others, np.moveaxis(rows, 1, 0), strict=True):
        spent, processor = 1e3 * np.median(row[:, [1, 3]], axis=0)
        print(
            f"TOPPRA, {n:6d} intervals: error {other:.1e}, excess up to {np.max(row[:, 2]):.1e}, {spent:5.0f} ms "
            f"({processor:.0f} ms of processor time): {spent / own:.1f} times as long ({processor / used:.1f} times)",
            flush=True,
        )
        if other <= error:
            break


def _row(path, intervals):
    """Return duration, run time, sampled excess and processor time of TOPPRA on a uniform grid."""
    own = Sampled(path)
    found = with_toppra(own, np.linspace(0.0, own.duration, intervals + 1))
    return found.duration, found.spent, sampled_excess(own, found), found.processor


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


def suite(cells):
    """Solve the problems of TOPPRA's suite: a straight path from rest to rest, whose velocity is zero at both ends."""
    limits = qt.Limits(speed=SUITE_LIMIT, acceleration=SUITE_LIMIT)
    joints = np.tile([-SUITE_LIMIT, SUITE_LIMIT], (3, 1))
    constraints = [JointVelocityConstraint(joints), JointAccelerationConstraint(joints)]
    for name, (length, best) in SUITE.items():
        points = np.array([[0.0, 0, 0], [0, length, 0]])
        path = qt.Route.from_piecewise(CubicSpline([0.0, 1.0], points, bc_type="clamped"))
        timed = qt.retime(path, limits, start_speed=0.0, end_speed=0.0, knots=cells)
        other = SplineInterpolator([0.0, 1.0], points, bc_type="clamped")
        found = TOPPRA(constraints, other, gridpoints=np.linspace(0.0, 1.0, cells + 1), solver_wrapper="seidel")
        theirs = found.compute_trajectory(0.0, 0.0)
        own = float(timed.duration)
        print(
            f"{name}: optimum {best} s, retime {own:.8f} s ({own / best - 1:+.1e}), "
            f"proved {timed.certificate.holds}; TOPPRA "
            + (
                "finds no solution"
                if theirs is None
                else f"{theirs.duration:.8f} s ({theirs.duration / best - 1:+.1e})"
            ),
            flush=True,
        )


def compared(path, cells):
    """Return the result of `retime`, its run time [s], TOPPRA on both grids, and the excess on both."""
    limits = qt.Limits(**LIMITS)
    call = lambda: jax.block_until_ready(  # noqa: E731
        qt.retime(path, limits, start_speed=0.0, end_speed=0.0, knots=cells)
    )
    timed = call()
    start = time.perf_counter()
    call()
    spent = time.perf_counter() - start
    own, of_path = Sampled(path), cells_of(path, cells)
    knots = of_path.knots
    finer = np.append((knots[:-1, None] + np.diff(knots)[:, None] * (np.arange(FINER) / FINER)).ravel(), knots[-1])
    same, fine = with_toppra(own, knots), with_toppra(own, finer)
    return timed, spent, same, fine, proved_excess(of_path, same), sampled_excess(own, fine)


def main():
    """Print a row for each path."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--paths", type=int, default=20)
    parser.add_argument("--cells", type=int, help="by default 512, and 64 with --batch")
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
    cells = options.cells or 512
    print(
        "path    retime: s, ms, proved | toppra: s, ms, limits broken, excess (v, lateral, longitudinal) | "
        f"{FINER} × its grid: s, sampled excess | retime / that, closed form"
    )
    rows = []
    for kind, path, least in cases(options.paths):
        timed, spent, same, fine, found, sampled = compared(path, cells)
        duration = float(timed.duration)
        broken = sum(status == "broken" for status, _ in found.values())
        excess = [found[name][1] for name in LIMITS]
        ratio, closed = (duration / x - 1 for x in (fine.duration, least))
        rows.append((spent, same.spent, fine.spent, broken, *excess, sampled, ratio, closed, timed.certificate.holds))
        print(
            f"{kind:6s}  {duration:8.4f} {1e3 * spent:6.0f} {timed.certificate.holds!s:5} | {same.duration:8.4f} "
            f"{1e3 * same.spent:6.1f} {broken} {' '.join(f'{x:7.1e}' for x in excess)} | {fine.duration:8.4f} "
            f"{sampled:8.1e} | {ratio:+.1e} {closed:+.1e}",
            flush=True,
        )
    summary(np.array(rows, float))
    suite(cells)


def summary(rows):
    """Print the ranges of the columns of `main`."""
    spent, same, slower, broken, speed, lateral, longitudinal, finer, ratio, closed, holds = rows.T
    largest = " ".join(f"{x.max():.1e}" for x in (speed, lateral, longitudinal))
    print(
        f"median run time {1e3 * np.median(spent):.0f} ms against {1e3 * np.median(same):.1f} ms and "
        f"{1e3 * np.median(slower):.0f} ms with the finer grid; proved {int(holds.sum())} of {len(rows)}; TOPPRA's "
        f"timing broken on {np.count_nonzero(broken)}, largest proved excess (v, lateral, longitudinal) {largest}, "
        f"median of the longitudinal excess {np.median(longitudinal):.1e}; with the finer grid {finer.min():.1e} to "
        f"{finer.max():.1e}; duration against the finer grid {ratio.min():+.1e} to {ratio.max():+.1e}, against closed "
        f"forms {np.nanmin(closed):+.1e} to {np.nanmax(closed):+.1e}"
    )


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main()
