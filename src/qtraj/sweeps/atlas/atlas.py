"""Compute an atlas: classify the corners of coarse cells, then divide the cells along the borders of the classes."""

from __future__ import annotations  # so that `help` shows short names

import numpy as np

from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.progress import Progress, Report
from qtraj.foundation.reporting import reporting
from qtraj.foundation.suggestion import suggestion
from qtraj.sweeps.atlas.axis import AtlasAxis
from qtraj.sweeps.atlas.classified import Classified, PointFunction, classify, joined
from qtraj.sweeps.atlas.outcome import FOLLOWED, Atlas
from qtraj.sweeps.atlas.quadtree import Point, Quadtree, as_arrays

BATCH = 1024
"""Default number of points in one call of the function."""

MAX_FINE = 2**61
"""Largest number of the finest cells in the whole plane, so that each has a number in 64 bits."""

MAX_EVALUATIONS = 100_000
"""Default maximum number of points."""


def atlas(
    function: PointFunction,
    x: AtlasAxis,
    y: AtlasAxis,
    *,
    follow: str = "feasible",
    batch: int = BATCH,
    max_evaluations: int = MAX_EVALUATIONS,
    progress: Report | bool | None = None,
) -> Atlas:
    """Return which points of a plane of two parameters are feasible, with a border that is known to a tolerance.

    The function is computed at the corners of coarse cells. Cells whose corners have different classes are divided into
    four until they are not wider than the tolerances of both axes; cells next to them are divided, too, if the border
    turns out to enter them between two corners. So the number of points grows with the length of the border, not with
    the area. A region of another class that contains no corner of a coarse cell and touches no other border may be
    missed: pass more `steps`.

    For three parameters, compute one atlas for each of a few values of the third: `{m: qt.atlas(partial(function,
    mass=m), x, y) for m in masses}`. `qtraj.viz.atlas_report.atlas_page` shows them on one page with a slider.

    Args:
        function: A function of two arrays (n,) with values of the parameters, such as the result of `tuned_points`. It
            returns booleans (n,), true where feasible, or a mapping: "status", booleans or the names of the classes
            "feasible", "sampled", "infeasible", "undecided" and "failed" (a numerical failure); optionally
            "first_limit", the names of the limits that are met first; and any other numbers (n,) by name.
        x: The first parameter: name, range, tolerance, number of coarse cells and unit.
        y: The second parameter.
        follow: The borders to follow: "feasible", between feasible points and all others; "status", between all
            classes; "limit", also between different limits.
        batch: Largest number of points in one call of the function.
        max_evaluations: Largest number of points. If it is reached, the borders are coarser than the tolerance, and
            `code` says so.
        progress: Called with a `Progress` after each call of the function; True displays the progress (extra `cli`).

    Returns:
        An `Atlas`, whose `result` says in words how large the classes are.

    Raises:
        ValueError: For axes with equal names, another `follow`, a batch below 1, more coarse cells than
            `max_evaluations`, tolerances so small that the plane would have more than 2⁶¹ cells, and results of the
            function with wrong shapes or classes.

    Example:
        >>> import qtraj as qt
        >>> radius = qt.AtlasAxis("radius", 10.0, 50.0, tolerance=0.2, unit="m")
        >>> speed = qt.AtlasAxis("speed", 2.0, 12.0, tolerance=0.05, unit="m/s")
        >>> found = qt.atlas(lambda r, v: v**2 / r <= 1.5, radius, speed)
        >>> [line] = found.border
        >>> bool(abs(line[:, 1] - (1.5 * line[:, 0]) ** 0.5).max() < 0.05)
        True
    """
    _require(x, y, follow, batch, max_evaluations)
    levels = max(x.levels, y.levels)
    cells = x.steps * 2**levels, y.steps * 2**levels
    tree, parts, limits = Quadtree((x.steps, y.steps), levels), [], {"": 0}
    with reporting(progress) as report:
        while points := tree.wanted():
            if len(tree.kinds) + len(points) > max_evaluations:
                break
            found = _computed(function, points, (x, y), cells, batch, (len(tree.kinds), report))
            _require_names(found, (x, y))
            parts.append(found)
            codes = np.array([limits.setdefault(name, len(limits)) for name in found.first_limit.tolist()], int)
            kinds = FOLLOWED[follow](found.status, codes)
            tree.divide(dict(zip(points, kinds.tolist(), strict=True)))
            if not tree.mixed:
                break
    everything = joined(parts)
    codes = [limits[name] for name in everything.first_limit.tolist()]
    code = ResultCode.tolerance_not_reached if tree.mixed else ResultCode.successful
    lattice, leaves = as_arrays(tree)
    return Atlas(x, y, lattice, leaves, everything.status, codes, [*limits], everything.values, follow, int(code))


def _computed(
    function: PointFunction,
    points: list[Point],
    axes: tuple[AtlasAxis, AtlasAxis],
    cells: tuple[int, int],
    batch: int,
    done: tuple[int, Report | None],
) -> Classified:
    """Classify points of the lattice in batches, and report the progress after each."""
    lattice = np.array(points)
    x, y = (axis.at(lattice[:, k], cells[k]) for k, axis in enumerate(axes))
    parts, (count, report) = [], done
    for first in range(0, len(points), batch):
        part = slice(first, first + batch)
        parts.append(classify(function, x[part], y[part]))
        if report is not None:
            report(Progress("points of the atlas", count + min(first + batch, len(points)), count + len(points)))
    return joined(parts)


def _require_names(found: Classified, axes: tuple[AtlasAxis, AtlasAxis]) -> None:
    """Raise a ValueError if a value has the name of an axis, because a dataset could not contain both."""
    if taken := [axis.name for axis in axes if axis.name in found.values]:
        raise ValueError(f"{taken[0]!r} is a value and an axis of the atlas: rename one of them")


def _require(x: AtlasAxis, y: AtlasAxis, follow: str, batch: int, max_evaluations: int) -> None:
    for axis in (x, y):
        if not isinstance(axis, AtlasAxis):
            raise ValueError(
                f"the axes of an atlas must be AtlasAxis(name, low, high, tolerance), but {axis!r} was given"
            )
    if x.name == y.name:
        raise ValueError(f"the two axes of an atlas must have different names, but both are {x.name!r}")
    if follow not in FOLLOWED:
        raise ValueError(f"follow={follow!r} is unknown: {suggestion(str(follow), [*FOLLOWED], 'choices')}")
    if batch < 1:
        raise ValueError(f"batch must be 1 or more, but {batch} was given")
    fine = (x.steps << max(x.levels, y.levels)) * (y.steps << max(x.levels, y.levels))
    if fine > MAX_FINE:
        raise ValueError(
            f"cells as fine as the tolerances of both axes would be {fine:.2g} for the whole plane, but at most "
            f"{MAX_FINE:.2g} can be numbered: pass larger tolerances or fewer steps"
        )
    coarse = (x.steps + 1) * (y.steps + 1)
    if coarse > max_evaluations:
        raise ValueError(
            f"the corners of the coarse cells alone are {coarse} points, but max_evaluations is {max_evaluations}: "
            "pass a larger one, or axes with fewer steps"
        )
