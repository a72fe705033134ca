"""`retime` with a limit on the jerk against TOPP3-SOCP of COPP, on the same paths and limits, in three dimensions.

`python -m benchmarks.timing_jerk`, with `copp-py` 0.2.3 installed. The limits are the speed, the lateral and the
longitudinal acceleration, and the jerk. COPP has linear constraints only, so in its problem the ball of the jerks is a
polyhedron around this ball: `--sides` directions on a sphere, the same at each grid point, and at each grid point the
directions of the jerk in `retime`'s solution and in COPP's earlier solutions. COPP's limit is thus weaker, but hardly
where it matters. COPP gets the cells of `retime` as intervals, and the speeds and the accelerations at both ends of
`retime`'s solution. It starts from this solution, and solves its problem three times, each time linearised at its last
solution. Its u̇² is quadratic between grid points. The proof of `retime` is applied to this timing: see `timing_proof`.
"""

import argparse
import time

import copp_py as copp  # pyright: ignore[reportMissingImports]
import jax
import jax.numpy as jnp
import numpy as np
from copp_py.solver import topp3_socp  # pyright: ignore[reportMissingImports]

import qtraj as qt
from benchmarks.timing_proof import cells_of, exceeded
from benchmarks.timing_toppra import LATERAL, LONGITUDINAL, SPEED, coefficients

JERK, END_SPEED, ROUNDS, SIDES = 1.5, 6.0, 3, 64
NAMES = ("speed", "lateral_acceleration", "longitudinal_acceleration", "jerk")
LIMITS = qt.Limits(**dict(zip(NAMES, (SPEED, LATERAL, LONGITUDINAL, JERK), strict=True)))


def paths(count):
    """Climbing turns, seeded."""
    rng = np.random.default_rng(4)
    for _ in range(count):
        start = qt.BoundaryState([rng.uniform(40, 60), 0, 0], [rng.normal(0, 1), 10.0, rng.normal(0, 1)])
        end = qt.BoundaryState([0, rng.uniform(40, 60), rng.uniform(5, 12)], [-10.0, rng.normal(0, 1), 1.0])
        yield qt.SpiralHelix.hermite(start, end, rng.uniform(6, 9))


def rows_of(path):
    """A function that returns r', r'' and r''' at many parameters."""
    evaluate = jax.jit(jax.vmap(lambda u: path.derivatives(u, 3)[1:]))
    return lambda u: np.moveaxis(np.asarray(evaluate(jnp.asarray(u))), 1, 0)


def sphere(count):
    """Return directions that cover a sphere evenly, (count, 3): a spiral with equal steps along the axis."""
    k = np.arange(count) + 0.5
    z, angle = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    return np.stack([np.sqrt(1 - z * z) * np.cos(angle), np.sqrt(1 - z * z) * np.sin(angle), z], axis=1)


def jerks(rows, a, b, slope):
    """Return the jerk divided by √a, for a = u̇², b = ü and its derivative `slope`."""
    r1, r2, r3 = rows
    return a[:, None] * r3 + 3 * b[:, None] * r2 + slope[:, None] * r1


def directions(rows, a, b, grid):
    """Return the directions of the jerk at the grid points from both sides, (points, 2, 3)."""
    slope = np.diff(b) / np.diff(grid)
    both = [jerks(rows, a, b, slope[k]) for k in (np.r_[0, : slope.size], np.r_[: slope.size, slope.size - 1])]
    both = np.stack(both, axis=1)
    return both / np.maximum(np.linalg.norm(both, axis=-1, keepdims=True), 1e-12)


def limited(rows, grid, normals):
    """Return COPP's constraints, with the jerk limited in the directions `normals` (points, directions, 3)."""
    r1, r2, r3 = rows
    speed, across, along = coefficients((None, r1, r2))
    problem = copp.Constraints(3, capacity=grid.size)
    problem.append_s(grid)
    highest = np.minimum((SPEED / speed) ** 2, LATERAL / np.maximum(across, 1e-12))
    problem.add_constraint_1st(highest[:, None], 0)
    for sign in (1.0, -1.0):
        bound = np.full((grid.size, 1), LONGITUDINAL)
        problem.add_constraint_2nd(sign * along[:, None], sign * speed[:, None], bound, 0)
    forms = [factor * np.einsum("nk,nmk->nm", r, normals) for factor, r in ((1.0, r3), (3.0, r2), (1.0, r1))]
    problem.add_constraint_3rd(*forms, np.zeros_like(forms[0]), np.full_like(forms[0], JERK), 0)
    return problem


def with_copp(rows, grid, own, sides):
    """Return the durations of all rounds, the processor time [s] of the last, and the powers of its u̇² in each cell.

    `own` are u̇² and ü of the solution of `retime` at the grid points.
    """
    at, b, times, found, spent = *own, [], None, 0.0
    ends = {"a_boundary": tuple(at[[0, -1]]), "b_boundary": tuple(b[[0, -1]]), "num_stationary_max": 0}
    normals = np.broadcast_to(sphere(sides), (grid.size, sides, 3))
    for _ in range(ROUNDS):
        normals = np.concatenate([normals, directions(rows, at, b, grid)], axis=1)
        problem = limited(rows, grid, normals)
        start = time.process_time()
        found = topp3_socp.solve(topp3_socp.Problem(problem, at, **ends))
        spent = time.process_time() - start
        at, b = np.asarray(found.a), np.asarray(found.b)
        times.append(copp.interpolation.s_to_t_topp3(grid, found)[0])
    h = np.diff(grid)
    return times, spent, np.stack([at[:-1], 2 * b[:-1] * h, np.diff(b) * h, 0 * h], axis=1)


def repeated(call, count=10):
    """Return the mean processor time and the smallest elapsed time of several calls [s]."""
    start, elapsed = time.process_time(), []
    for _ in range(count):
        began = time.perf_counter()
        call()
        elapsed.append(time.perf_counter() - began)
    return (time.process_time() - start) / count, min(elapsed)


def main():
    """Print a row for each path."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--paths", type=int, default=4)
    parser.add_argument("--cells", type=int, default=256)
    parser.add_argument("--sides", type=int, default=SIDES)
    options = parser.parse_args()
    print(
        "retime: s, ms of processor time, ms of the fastest call, proved | COPP: s (each round), ms of processor time, "
        "status and excess (v, lateral, longitudinal, jerk) | retime / COPP"
    )
    for path in paths(options.paths):
        call = lambda path=path: jax.block_until_ready(  # noqa: E731
            qt.retime(path, LIMITS, start_speed=END_SPEED, end_speed=END_SPEED, knots=options.cells)
        )
        timed = call()
        spent, best = repeated(call)
        cells = cells_of(path, options.cells)
        powers, length = np.asarray(timed.timing.coefficients), np.diff(cells.knots)
        a = np.append(powers[:, 0], powers[-1].sum())
        slope = np.append(powers[:, 1] / length, (powers[-1] @ [0, 1, 2, 3]) / length[-1])
        rows = rows_of(path)(cells.knots)
        times, other, theirs = with_copp(rows, cells.knots, (a, slope / 2), options.sides)
        over = exceeded(cells, theirs, (False, False), LIMITS)
        print(
            f"{float(timed.duration):.5f} {1e3 * spent:5.0f} {1e3 * best:5.1f} {timed.certificate.holds!s:5} | "
            f"{' '.join(f'{x:.5f}' for x in times)} {1e3 * other:6.0f} "
            f"{' '.join(f'{over[name][0]} {over[name][1]:.1e}' for name in NAMES)} | "
            f"{float(timed.duration) / times[-1] - 1:+.2e}",
            flush=True,
        )


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main()
