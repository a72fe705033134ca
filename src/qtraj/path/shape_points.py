"""Prepare the points of a shape: check them, merge repeated ones, and recognise whether the curve is closed."""

import warnings
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.foundation.argument import described
from qtraj.foundation.types import ArrayInput

REPEATED = 1e-3
"""Consecutive points nearer than this fraction of the median spacing count as one point."""

GAP = 2.0
"""The ends of a closed curve are at most this multiple of the larger adjacent spacing apart."""

LARGEST_TURN = np.cos(np.radians(61.0))
"""Smallest cosine of the angle by which a curve that is recognised as closed turns at each of its ends."""


LARGEST = 1e50
"""Largest absolute coordinate [m]: powers of larger numbers overflow."""


class Points(NamedTuple):
    """Points (n, 3) [m], widths (n, 2) [m] or None; the last point of a closed curve repeats the first one."""

    positions: Float[np.ndarray, "n 3"]
    widths: Float[np.ndarray, "n 2"] | None
    closed: bool


def prepared(points: ArrayInput, widths: ArrayInput | None, closed: bool | None) -> Points:
    """Return the points of a curve; points that repeat their predecessor are merged with a UserWarning.

    **Raises:** ValueError for wrong shapes, numbers that are not finite, or too few different points.
    """
    given = _positions(points)
    own = None if widths is None else checked_widths(widths, len(given))
    kept = _different(given)
    if count := int(len(given) - kept.sum()):
        warnings.warn(
            f"{count} of {len(given)} points of the shape repeat the point before them, and were merged with it",
            stacklevel=4,
        )
    given, own = given[kept], None if own is None else own[kept]
    return _closed(given, own, closed)


def checked_widths(widths: ArrayInput, count: int) -> Float[np.ndarray, "n 2"]:
    """Return widths (count, 2) [m]: distances to the right and to the left edge.

    **Raises:** ValueError for a wrong shape, or widths that are negative or not finite.
    """
    found = _numbers(widths, "the widths of a shape")
    if found.shape != (count, 2):
        raise ValueError(
            f"the widths of a shape must have shape ({count}, 2), the distances to the right and to the left edge at "
            f"each point, but an array of shape {found.shape} was given"
        )
    if not (np.isfinite(found).all() and (found >= 0).all()):
        k = int(np.flatnonzero(~(np.isfinite(found) & (found >= 0)).all(axis=1))[0])
        raise ValueError(
            f"the widths of a shape must be finite and at least 0 [m], but point {k} has {found[k].tolist()}: correct "
            "them, or omit the widths"
        )
    return found


def _positions(points: ArrayInput) -> Float[np.ndarray, "n 3"]:
    found = _numbers(points, "the points of a shape")
    if found.ndim != 2 or found.shape[1] not in (2, 3):
        raise ValueError(
            "the points of a shape must have shape (n, 3), or (n, 2) for a curve with z = 0, but an array of shape "
            f"{found.shape} was given"
        )
    if not np.isfinite(found).all():
        k = int(np.flatnonzero(~np.isfinite(found).all(axis=1))[0])
        raise ValueError(f"the points of a shape must be finite, but point {k} is {found[k].tolist()}: remove it")
    if (large := (np.abs(found) > LARGEST).any(axis=1)).any():
        k = int(np.flatnonzero(large)[0])
        raise ValueError(
            f"the coordinates of a shape must be at most {LARGEST:g} m, but point {k} is {found[k].tolist()}: "
            "use other units"
        )
    return np.pad(found, [(0, 0), (0, 3 - found.shape[1])])


def _numbers(values: Any, what: str) -> np.ndarray:
    try:
        return np.asarray(values, float)
    except (TypeError, ValueError):
        raise ValueError(f"{what} must be an array of numbers [m], but {described(values)} was given") from None


def _different(points: Float[np.ndarray, "n 3"]) -> np.ndarray:
    """Return a mask of the points that differ from the point kept before them."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if not (steps > 0).any():
        raise ValueError(f"a shape needs at least two different points, but {len(points)} equal ones were given")
    least = REPEATED * float(np.median(steps[steps > 0]))
    kept, last = np.ones(len(points), bool), 0
    for k in range(1, len(points)):
        kept[k] = steps[k - 1] > least or bool(np.linalg.norm(points[k] - points[last]) > least)
        last = k if kept[k] else last
    return kept


def _closed(points: Float[np.ndarray, "n 3"], widths: Any, closed: bool | None) -> Points:
    least = REPEATED * float(np.median(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    repeated = len(points) > 2 and bool(np.linalg.norm(points[-1] - points[0]) <= least)
    if closed is None:
        closed = len(points) > 3 and (repeated or _ends_meet(points))
    if not closed:
        return Points(points, widths, False)
    distinct = len(points) - repeated
    if distinct < 3:
        raise ValueError(f"a closed shape needs at least three different points, but {distinct} were given")
    rows = np.append(np.arange(distinct), 0)
    return Points(points[rows], None if widths is None else widths[rows], True)


def _ends_meet(points: Float[np.ndarray, "n 3"]) -> bool:
    """Return whether the last point is followed by the first one: near it, and in the direction of travel."""
    first, last, across = points[1] - points[0], points[-1] - points[-2], points[0] - points[-1]
    before, after, gap = (float(np.linalg.norm(x)) for x in (last, first, across))
    if gap > GAP * max(before, after):
        return False
    turns = (float(x @ across) / (size * gap) for x, size in ((last, before), (first, after)))
    return all(cosine > LARGEST_TURN for cosine in turns)
