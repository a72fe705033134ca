"""Compare the atlas of a bus turn with a fine grid: the position of the border, and the number of tunings.

    python -m benchmarks.atlas                            256 × 256 cells; this takes many minutes
    python -m benchmarks.atlas --cells 64 --others 100    a coarser grid
    python -m benchmarks.atlas --cells 64 --all           all points of the grid

A bus enters a corner of 90° at some radius with some speed, and may leave it with any speed. The grid is as fine as the
tolerance of the atlas. Its points within two tolerances of the border of the atlas are tuned, and a random sample of
the others; `--all` tunes all of them. Points that the atlas has tuned are not tuned again. The command fails if a point
of the grid has another class than in the atlas and is further than a tolerance from the border of the atlas, or if the
atlas needs more than 5 % of the tunings of the grid.
"""

import argparse
import sys
import time

import jax
import numpy as np

import qtraj as qt

COARSE = 8
"""Number of coarse cells along each axis."""

MOST_TUNINGS = 0.05
"""Largest accepted number of tunings, as a share of those of the grid."""

NEAR = 2.0
"""Distance from the border, in tolerances, up to which all points of the grid are tuned."""

FEASIBLE = ("feasible", "sampled")

RADII, SPEEDS = (8.0, 40.0), (3.0, 9.0)  # [m], [m/s]
KEPT = ["start.V_rho", "start.V_phi", "start.V_h", "end.V_rho", "end.V_h"]


def corner(radius, speed):
    """Return the states and the limits of a turn of a bus."""
    start = qt.BoundaryState([radius, 0, 0], [0, speed, 0])
    end = qt.BoundaryState([0, radius, 0], [-speed, 0, 0])
    return start, end, qt.Limits(lateral_acceleration=1.5, curvature=1 / 12)


def axes(cells):
    """Return the axes of an atlas that is as fine as a grid of `cells` × `cells`."""
    return tuple(
        qt.AtlasAxis(name, low, high, tolerance=(high - low) / cells, steps=COARSE, unit=unit)
        for name, (low, high), unit in (("radius", RADII, "m"), ("speed", SPEEDS, "m/s"))
    )


def distances(found, x, y):
    """Return the distances of points (n,) from the border of an atlas, in tolerances along the axes (largest one)."""
    tolerance = np.array([found.x_axis.tolerance, found.y_axis.tolerance])
    points = np.stack([x, y], axis=1) / tolerance
    nearest = np.full(len(points), np.inf)
    for line in found.border:
        for a, b in zip(line[:-1] / tolerance, line[1:] / tolerance, strict=True):
            along = np.clip((points - a) @ (b - a) / max((b - a) @ (b - a), 1e-30), 0.0, 1.0)
            nearest = np.minimum(nearest, np.abs(points - a - along[:, None] * (b - a)).max(axis=1))
    return nearest


def chosen(found, x, y, others):
    """Return which points of the grid are tuned: those near the border of an atlas, and some of the others."""
    scale = np.array([found.x_axis.tolerance, found.y_axis.tolerance]) * 1e-3
    own = {tuple(row) for row in np.rint(np.stack([found.x, found.y], axis=1) / scale).astype(int).tolist()}
    keys = np.rint(np.stack([x, y], axis=1) / scale).astype(int).tolist()
    known = np.array([tuple(row) in own for row in keys])
    near = (distances(found, x, y) <= NEAR) & ~known
    rest = np.flatnonzero(~near & ~known)
    near[np.random.default_rng(0).permutation(rest)[:others]] = True
    return np.flatnonzero(near)


def measure(cells, others):
    """Return whether the border of the atlas is that of the grid, at a small share of its tunings."""
    tuned = qt.tuned_points(corner, motion="hermite", fixed=KEPT, starts=1)
    began = time.process_time()
    found = qt.atlas(tuned, *axes(cells))
    seconds, middle = time.process_time() - began, time.process_time()
    share = found.evaluations / (cells + 1) ** 2
    print(f"atlas: {found.evaluations} tunings, {seconds:.1f} s of CPU time; {found.result}")
    print(
        f"the atlas needs {100 * share:.2f} % of the {(cells + 1) ** 2} tunings of the grid, at most 5 % are accepted",
        flush=True,
    )
    lines = [np.linspace(axis.low, axis.high, cells + 1) for axis in (found.x_axis, found.y_axis)]
    x, y = (values.ravel() for values in np.meshgrid(*lines, indexing="ij"))
    at = chosen(found, x, y, others)
    x, y = x[at], y[at]
    feasible = np.concatenate([tuned(x[k : k + 1024], y[k : k + 1024])["status"] for k in range(0, len(x), 1024)])
    feasible = np.isin(feasible, FEASIBLE)
    wrong = feasible != np.isin(found.at(x, y)["status"], FEASIBLE)
    furthest = float(distances(found, x[wrong], y[wrong]).max()) if wrong.any() else 0.0
    print(f"grid: {len(x)} other points, {time.process_time() - middle:.1f} s of CPU time, {feasible.sum()} feasible")
    print(f"{wrong.sum()} of them have another class in the atlas")
    print(f"the furthest of these is {furthest:.2f} tolerances from the border of the atlas (at most 1)")
    return furthest <= 1.0 and share <= MOST_TUNINGS and 0 < feasible.mean() < 1


def main():
    """Run the comparison."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, default=256, help=f"cells along each axis, {COARSE} times a power of two")
    parser.add_argument("--others", type=int, default=300, help="number of tuned points far from the border")
    parser.add_argument("--all", action="store_true", help="tune all points of the grid")
    given = parser.parse_args()
    cells = given.cells
    if cells < COARSE or cells & (cells - 1):
        parser.error(f"--cells must be a power of two of at least {COARSE}, but {cells} was given")
    jax.config.update("jax_enable_x64", True)
    return 0 if measure(cells, (cells + 1) ** 2 if given.all else given.others) else 1


if __name__ == "__main__":
    sys.exit(main())
