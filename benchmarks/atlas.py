"""Compare the atlas of a bus turn with a fine grid: the position of the border, and the number of tunings.

    python -m benchmarks.atlas                  64 × 64 cells, 4 225 tunings of the grid; this takes some minutes
    python -m benchmarks.atlas --cells 128      a finer grid

A bus enters a corner of 90° at some radius with some speed, and may leave it with any speed. Every point of a grid that
is as fine as the tolerance of the atlas is tuned. The command fails if a feasible and an infeasible point of the grid
are on the same side of the border of the atlas and further than a tolerance from it, or if the atlas needs more than
5 % of the tunings of the grid.
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


def measure(cells, say=print):
    """Return whether the border of the atlas is that of the grid, at a small share of its tunings."""
    tuned = qt.tuned_points(corner, motion="hermite", fixed=KEPT, starts=1)
    began = time.process_time()
    found = qt.atlas(tuned, *axes(cells))
    middle = time.process_time()
    lines = [np.linspace(axis.low, axis.high, cells + 1) for axis in (found.x_axis, found.y_axis)]
    x, y = (values.ravel() for values in np.meshgrid(*lines, indexing="ij"))
    feasible = np.concatenate([tuned(x[k : k + 1024], y[k : k + 1024])["status"] for k in range(0, len(x), 1024)])
    feasible = np.isin(feasible, ("feasible", "sampled"))
    seconds = middle - began, time.process_time() - middle
    inside = np.isin(found.at(x, y)["status"], ("feasible", "sampled"))
    wrong = feasible != inside
    furthest = float(distances(found, x[wrong], y[wrong]).max()) if wrong.any() else 0.0
    share = found.evaluations / len(x)
    say(f"atlas: {found.evaluations} tunings, {seconds[0]:.1f} s of CPU time")
    say(f"grid: {len(x)} tunings, {seconds[1]:.1f} s of CPU time")
    say(f"the atlas needs {100 * share:.2f} % of the tunings of the grid (at most {100 * MOST_TUNINGS:.0f} % accepted)")
    say(
        f"{wrong.sum()} of {len(x)} points of the grid have another class in the atlas; {100 * feasible.mean():.1f} % "
        f"of the grid are feasible"
    )
    say(f"the furthest of them is {furthest:.2f} tolerances from the border of the atlas (at most 1 accepted)")
    return furthest <= 1.0 and share <= MOST_TUNINGS and 0 < feasible.mean() < 1


def main():
    """Run the comparison."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, default=64, help=f"cells along each axis, {COARSE} times a power of two")
    cells = parser.parse_args().cells
    if cells < COARSE or cells & (cells - 1):
        parser.error(f"--cells must be a power of two of at least {COARSE}, but {cells} was given")
    jax.config.update("jax_enable_x64", True)
    return 0 if measure(cells) else 1


if __name__ == "__main__":
    sys.exit(main())
