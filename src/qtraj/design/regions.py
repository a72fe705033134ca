"""Limits inside areas of the horizontal plane, which become limits along the way on a given path."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float

from qtraj.design.along import Along, Changing, numbers_of
from qtraj.foundation.argument import described
from qtraj.foundation.arrays import as_array, as_float
from qtraj.foundation.document import storable, stored_as
from qtraj.foundation.namespace import in_numpy
from qtraj.foundation.types import ArrayInput
from qtraj.path.distances import Distances, distances
from qtraj.path.hodograph import AbstractHodograph

PARTS, LEVELS = 16, 9
"""Intervals in which a path crosses the edge of an area are divided into `PARTS` intervals, at most `LEVELS` times."""


def _fields(regions: Any) -> dict[str, Any]:
    return {"polygons": regions.polygons, "values": regions.values}


def _built(polygons: Sequence[ArrayInput], values: ArrayInput) -> Any:
    """Return the regions that are stored; the last value is that outside of them."""
    *inside, outside = np.asarray(values, float).tolist()
    return Regions(list(zip(polygons, inside, strict=True)), outside)


@stored_as(_fields, _built)
@storable
class Regions(Changing):
    """A limit inside areas of the horizontal plane.

    Where areas overlap, the strictest value holds. On a given path, the limit is an `Along` with steps: `certify` and
    `retime` find the distances at which the path crosses the edges of the areas. `tune` and `tune_route` do so for each
    path that they certify.

        Limits(speed=Regions([(school_zone, 8.3), (village, 13.9)]))

    Args:
        regions: pairs of a polygon and a value. A polygon is (m, 2) [m], its corners in order, in world coordinates;
            the last corner is joined to the first one. The value is in the unit of the limit, or a pair (lower, upper)
            for a limit with two sides.
        outside: the value outside all areas; None means no limit.

    Raises:
        ValueError: For no area, a polygon of a wrong shape, with fewer than three corners or with numbers that are not
            finite, and for values that are not all numbers or all pairs.
    """

    polygons: tuple[Float[Array, "m 2"], ...]
    values: Float[Array, " n *sides"]

    def __init__(self, regions: Sequence[tuple[ArrayInput, Any]], outside: Any = None):
        try:
            pairs = [(polygon, value) for polygon, value in regions]
        except (TypeError, ValueError) as error:
            raise ValueError(
                f"regions must be a list of pairs (polygon, value), but {described(regions)} was given"
            ) from error
        if not pairs:
            raise ValueError("regions must contain at least one pair (polygon, value)")
        self.polygons = tuple(_polygon(polygon, k) for k, (polygon, _) in enumerate(pairs))
        values = [value for _, value in pairs]
        absent = (None, None) if outside is None and isinstance(values[0], tuple | list) else outside
        self.values = numbers_of([*values, absent])
        if self.values.shape not in ((len(pairs) + 1,), (len(pairs) + 1, 2)):
            raise ValueError("the values of regions must be numbers, or pairs (lower, upper)")

    def __repr__(self) -> str:
        return f"Regions({len(self.polygons)} areas)"

    def along(self, path: AbstractHodograph, side: int = 1) -> Along:
        """Return the limit as steps along one path with concrete values; `side` is −1 for a lower bound."""
        on = distances(path)
        ends = np.unique(np.concatenate([_crossings(path, on, np.asarray(x)) for x in self.polygons]))
        at = np.unique(np.concatenate([[0.0], on.at(ends)]))
        middle = on.parameters(0.5 * (at + np.append(at[1:], on.length)))
        inside = np.stack([_inside(_positions(path, middle), np.asarray(x)) for x in self.polygons])
        *values, outside = side * np.asarray(self.values, float)
        found = np.min(np.where(inside, np.array(values)[:, None], np.inf), axis=0)
        return Along(at, side * np.where(inside.any(axis=0), found, outside))


def _polygon(given: ArrayInput, k: int) -> Array:
    try:
        found = np.asarray(as_float(given))
    except (TypeError, ValueError) as error:
        raise ValueError(f"polygon {k} must contain numbers [m], but {described(given)} was given") from error
    if found.ndim != 2 or found.shape[1:] != (2,) or len(found) < 3 or not np.isfinite(found).all():
        raise ValueError(
            f"polygon {k} must contain at least three corners (x, y) with finite numbers [m], but its shape is "
            f"{found.shape}"
        )
    return as_float(found)


def _crossings(path: AbstractHodograph, on: Distances, polygon: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, " k"]:
    """Return parameters at which a path crosses the edges of an area."""
    low, high = on.ends[:-1], on.ends[1:]
    for _ in range(LEVELS):
        u = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, PARTS + 1)
        points = _positions(path, u.ravel()).reshape(*u.shape, 2)
        crossed = _crosses(points[:, :-1], points[:, 1:], polygon)
        low, high = u[:, :-1][crossed], u[:, 1:][crossed]
        if not low.size or (on.at(high) - on.at(low)).max() < on.uncertainty:
            break
    return 0.5 * (low + high)


def _crosses(a: np.ndarray, b: np.ndarray, polygon: Float[np.ndarray, "m 2"]) -> Bool[np.ndarray, "*shape"]:
    """Return whether the lines from `a` to `b` (*shape, 2) touch an edge of the polygon."""
    p, q = polygon, np.roll(polygon, -1, axis=0)
    a, b = a[..., None, :], b[..., None, :]
    return np.any((_side(a, b, p) * _side(a, b, q) <= 0) & (_side(p, q, a) * _side(p, q, b) <= 0), axis=-1)


def _side(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Return on which side of the line through a and b the point c is: positive to the left."""
    return (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])


def _inside(points: Float[np.ndarray, "n 2"], polygon: Float[np.ndarray, "m 2"]) -> Bool[np.ndarray, " n"]:
    """Return whether points are inside a polygon, by the even-odd rule."""
    p, q = polygon, np.roll(polygon, -1, axis=0)
    x, y = points[:, :1], points[:, 1:]
    between = (p[:, 1] > y) != (q[:, 1] > y)
    rise = np.where(q[:, 1] != p[:, 1], q[:, 1] - p[:, 1], 1.0)
    return np.sum(between & (x < p[:, 0] + (y - p[:, 1]) / rise * (q[:, 0] - p[:, 0])), axis=1) % 2 == 1


def _positions(path: AbstractHodograph, u: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 2"]:
    compute = in_numpy(_sampled) if path.supports_numpy else _compiled
    return np.asarray(compute(path, as_array(u, path.duration.dtype)))[:, :2]


def _sampled(path: AbstractHodograph, u: Any) -> Any:
    return path.sampled(u, 0)[0]


_compiled = eqx.filter_jit(_sampled)
