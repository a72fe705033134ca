"""Compare `retime` with a limit on the jerk with TOPP3-SOCP of COPP, on the same paths and limits.

Run `python -m benchmarks.timing_jerk`, with `copp-py` 0.2.3 installed. The limits are on speed, lateral acceleration,
longitudinal acceleration and jerk. COPP supports only linear constraints. For a plane path, the jerk limit is a disc,
which COPP's problem replaces by a circumscribed regular polygon with `--sides` sides. This relaxes the limit by up to
1/cos(π/sides). COPP uses as many intervals as `retime` has cells. The speeds and accelerations at both ends are those
of the solution of `retime`. COPP starts from this solution and solves its problem twice, each time linearised at the
previous solution. Its u̇² is quadratic between grid points. The limits are evaluated at 16 points of each interval.
"""

import argparse
import time

import copp_py as copp  # pyright: ignore[reportMissingImports]
import jax
import jax.numpy as jnp
import numpy as np
from copp_py.solver import topp3_socp  # pyright: ignore[reportMissingImports]

import qtraj as qt
from benchmarks.timing import LATERAL, LONGITUDINAL, SPEED, coefficients

JERK, END_SPEED, PLACES, ROUNDS, SIDES = 1.5, 6.0, 16, 2, 32
LIMITS = qt.Limits(speed=SPEED, lateral_acceleration=LATERAL, longitudinal_acceleration=LONGITUDINAL, jerk=JERK)


def paths(count):
    """Yield random plane turns."""
    rng = np.random.default_rng(4)
    for _ in range(count):
        start = qt.BoundaryState([rng.uniform(40, 60), 0, 0], [rng.normal(0, 1), 10.0, 0])
        end = qt.BoundaryState([0, rng.uniform(40, 60), 0], [-10.0, rng.normal(0, 1), 0])
        yield qt.SpiralHelix.hermite(start, end, rng.uniform(6, 9))


def rows_of(path):
    """Return a function that computes r', r'' and r''' at many parameters."""
    evaluate = jax.jit(jax.vmap(lambda u: path.derivatives(u, 3)[1:]))
    return lambda u: np.moveaxis(np.asarray(evaluate(jnp.asarray(u))), 1, 0)


def with_copp(rows, grid, own, sides):
    """Return the durations of all rounds, the time of the last [s], and the largest violations between grid points.

    `own` contains u̇² and ü of the solution of `retime` at the grid points.
    """
    r1, r2, r3 = rows(grid)
    n = grid.size
    speed, across, along = coefficients((None, r1, r2))
    angles = 2 * np.pi * np.arange(sides) / sides
    normals = np.stack([np.cos(angles), np.sin(angles), 0 * angles])
    problem = copp.Constraints(3, capacity=n)
    problem.append_s(grid)
    highest = np.minimum((SPEED / speed) ** 2, LATERAL / np.maximum(across, 1e-12))
    problem.add_constraint_1st(highest[:, None], 0)
    for sign in (1.0, -1.0):
        problem.add_constraint_2nd(sign * along[:, None], sign * speed[:, None], np.full((n, 1), LONGITUDINAL), 0)
    jerks = [factor * r @ normals for factor, r in ((1.0, r3), (3.0, r2), (1.0, r1))]
    problem.add_constraint_3rd(*jerks, np.zeros((n, sides)), np.full((n, sides), JERK), 0)
    ends = {"a_boundary": tuple(own[0][[0, -1]]), "b_boundary": tuple(own[1][[0, -1]]), "num_stationary_max": 0}
    at, times, found, spent = own[0], [], None, 0.0
    for _ in range(ROUNDS):
        start = time.process_time()
        found = topp3_socp.solve(topp3_socp.Problem(problem, at, **ends))
        spent = time.process_time() - start
        at = np.asarray(found.a)
        times.append(copp.interpolation.s_to_t_topp3(grid, found)[0])
    places = (np.arange(PLACES) + 0.5) / PLACES
    assert found is not None
    a, b, h = np.asarray(found.a), np.asarray(found.b), np.diff(grid)
    fine = (grid[:-1, None] + h[:, None] * places).ravel()
    bend = (np.diff(b) / h)[:, None]
    step = h[:, None] * places
    values = [a[:-1, None] + 2 * b[:-1, None] * step + bend * step**2, b[:-1, None] + bend * step, bend + 0 * step]
    return times, spent, excess(rows(fine), [x.ravel() for x in values])


def excess(rows, values):
    """Return the largest relative violations by speed, lateral acceleration, longitudinal acceleration and jerk."""
    (r1, r2, r3), (a, b, c) = rows, values
    speed, across, along = coefficients((None, r1, r2))
    jerk = np.sqrt(a)[:, None] * (a[:, None] * r3 + 3 * b[:, None] * r2 + c[:, None] * r1)
    used = [
        speed * np.sqrt(a) / SPEED,
        across * a / LATERAL,
        np.abs(along * a + speed * b) / LONGITUDINAL,
        np.linalg.norm(jerk, axis=1) / JERK,
    ]
    return [float(np.max(x)) - 1 for x in used]


def main():
    """Print a row for each path."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--paths", type=int, default=4)
    parser.add_argument("--cells", type=int, default=256)
    parser.add_argument("--sides", type=int, default=SIDES)
    options = parser.parse_args()
    print("retime: s, ms of processor time, proved | COPP: s (each round), ms, violations (speed, lat., long., jerk)")
    for path in paths(options.paths):
        call = lambda path=path: jax.block_until_ready(  # noqa: E731
            qt.retime(path, LIMITS, start_speed=END_SPEED, end_speed=END_SPEED, knots=options.cells)
        )
        timed = call()
        start = time.process_time()
        call()
        spent = time.process_time() - start
        grid = np.linspace(0.0, float(path.duration), options.cells + 1)
        powers = np.asarray(timed.timing.coefficients)
        length = np.diff(np.asarray(timed.timing.knots))
        a = np.append(powers[:, 0], powers[-1].sum())
        slope = np.append(powers[:, 1] / length, (powers[-1] @ [0, 1, 2, 3]) / length[-1])
        times, other, over = with_copp(rows_of(path), grid, (a, slope / 2), options.sides)
        print(
            f"{float(timed.duration):.5f} {1e3 * spent:5.0f} {timed.certificate.holds!s:5} | "
            f"{' '.join(f'{x:.5f}' for x in times)} {1e3 * other:6.0f} {' '.join(f'{x:+.1e}' for x in over)} | "
            f"{float(timed.duration) / times[-1] - 1:+.2e}",
            flush=True,
        )


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main()
