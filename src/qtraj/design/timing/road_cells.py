"""A road that changes along the way, in the cells of a timing: for searches at points, and for proofs in whole cells.

In a cell, a limit on friction or power is proved for several variants of the road, whose cosines and sines of the bank
are the corners of a convex set that contains those of the road (see `proof.on_road`). Where the road changes in steps,
the variants are those before and after the step, so that the stricter one holds in the cell.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from qtraj.design.timing.grid import Shape
from qtraj.design.timing.tables import Tables
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.road_on_path import CORNERS, ROUNDING, RoadOnPath, road_on
from qtraj.path.road_parameters import RoadParameters, about_left
from qtraj.path.vehicle import Vehicle

NEAR = 2
"""Linear pieces of a road may meet closer to an end of a cell than this multiple of the uncertainty."""


FRAME = ("cos", "sin", "axis_x", "axis_y", "axis_z")
"""The parameters that define the frame of the road."""


class Variants(NamedTuple):
    """Parameters at both ends of cells, linear between them, for each corner; `rough` where they are not exact."""

    ends: list[tuple[RoadParameters, RoadParameters]]
    rough: Bool[np.ndarray, " cells"]


def variants(on: RoadOnPath, low: Float[np.ndarray, " cells"], high: Float[np.ndarray, " cells"]) -> Variants:
    """Return the variants of a road in cells between parameters of the path."""
    s0, s1, error = on.on.at(low), on.on.at(high), on.on.uncertainty
    first, last = (_sections(on, x) for x in (s0 - error, s1 + error))
    alone = first == last
    if on.road.kind == "linear":  # pieces that meet next to an end of a cell are within the error of the lines
        inner = [_sections(on, x) for x in (s0 + NEAR * error, s1 - NEAR * error)]
        same = (inner[0] == inner[1]) & (_frames(on, first) == _frames(on, last)).all(axis=0)
        first, alone = np.where(same, inner[0], first), alone | same
    lines = on.lines(low, high, first)
    corners = [lines.corner(*x) for x in CORNERS]
    if not alone.all():
        others = _straddling(on, first, last, s0 - error, s1 + error)
        corners = [(_chosen(alone, x, z), _chosen(alone, y, z)) for (x, y), z in zip(corners, others, strict=True)]
    varied = (lines.error > 0) | ~alone
    changes = np.any([x != y for x, y in zip(lines.start.numbers, lines.end.numbers, strict=True)], axis=0)
    return Variants(corners if varied.any() else corners[:1], varied | changes)


def _straddling(
    on: RoadOnPath, first: Int[np.ndarray, " n"], last: Int[np.ndarray, " n"], s0: np.ndarray, s1: np.ndarray
) -> list[RoadParameters]:
    """Return constant variants in cells that contain several sections."""
    before, after = (on.at_distances(x, k) for x, k in ((s0, first), (s1, last)))
    start = before._replace(
        inv_long=np.maximum(before.inv_long, after.inv_long), inv_lat=np.maximum(before.inv_lat, after.inv_lat)
    )
    if on.road.friction is not None:
        for name, values in zip(("inv_long", "inv_lat"), np.array(on.road.friction).T, strict=True):
            most = _inside(np.maximum, 1 / values[: on.starts.size], first, last, 0.0)
            start = start._replace(**{name: np.maximum(getattr(start, name), most) * (1 + ROUNDING)})
    if (on.road.kind == "step" or on.road.bank is None) and (last <= first + 1).all():
        return [start, start._replace(**{name: getattr(after, name) for name in FRAME})] * 2
    banks = np.zeros(on.starts.size) if on.road.bank is None else np.array(on.road.bank)[: on.starts.size]
    ends = [on.banks(x, k) for x, k in ((s0, first), (s1, last))]
    lowest = np.minimum(np.minimum(*ends), _inside(np.minimum, banks, first, last, np.inf))
    highest = np.maximum(np.maximum(*ends), _inside(np.maximum, banks, first, last, -np.inf))
    middle, error = 0.5 * (lowest + highest), 0.5 * (highest - lowest) + ROUNDING
    own, frames = _frames(on, first), _frames(on, np.arange(on.starts.size))
    inner = [[_inside(x, row, first, last, np.nan) for row in frames] for x in (np.minimum, np.maximum)]
    turned = ((inner[0] < own) | (inner[1] > own)).any(axis=0)
    error = np.where(turned, 2.0, error)  # never proved
    cos, sin = own[0] * np.cos(middle), own[0] * np.sin(middle)
    if on.road.left is not None:
        cos, sin, _ = about_left(cos, sin, own[1:].T, np)
    return [start._replace(cos=cos + x * error, sin=sin + y * error) for x, y in CORNERS]


def _inside(extreme: np.ufunc, values: np.ndarray, first: np.ndarray, last: np.ndarray, absent: float) -> np.ndarray:
    """Return the extreme value of the sections after the `first` up to the `last` one, `absent` without any."""
    found = extreme.reduceat(np.append(values, absent), np.stack([first + 1, last + 1], axis=1).ravel())[::2]
    return np.where(last > first, found, absent)


def _sections(on: RoadOnPath, s: np.ndarray) -> Int[np.ndarray, " n"]:
    return np.minimum(on.road.sections(s), on.starts.size - 1)


def _frames(on: RoadOnPath, sections: np.ndarray) -> Float[np.ndarray, "_ n"]:
    """Return the side of the road in sections, and its direction to the left if it has one, as rows."""
    found = on.road.at(np.zeros(sections.shape), sections)
    return found.side[None] if found.left is None else np.concatenate([found.side[None], found.left.T])


def _chosen(where: np.ndarray, x: RoadParameters, y: RoadParameters) -> RoadParameters:
    return RoadParameters(*(np.where(where, a, b) for a, b in zip(x.numbers, y.numbers, strict=True)))


def at_parameters(vehicle: Any, u: Any) -> Any:
    """Return the parameters of a vehicle; on a road that changes, those at parameters of the path."""
    return vehicle.at(np.asarray(u, float)) if isinstance(vehicle, RoadOnPath) else vehicle


def at_parameters_of(vehicle: Vehicle | None, path: AbstractHodograph, u: Float[np.ndarray, " n"]) -> Any:
    """Return the parameters of a vehicle at `n` parameters of a path, each (n,); None for None."""
    if vehicle is None:
        return None
    known = road_on(vehicle, path).at(u) if vehicle.on_changing_road else vehicle.parameters(u.dtype)
    return known.each(lambda x: np.broadcast_to(np.asarray(x, u.dtype), u.shape))


def road_of(limits: Any, path: AbstractHodograph, traced: bool) -> RoadParameters | RoadOnPath:
    """Return the parameters of the vehicle of limits; those of a road that changes along the path.

    **Raises:** ValueError for such a road if a value is `traced`, and for a direction of the road to the left on a path
    that is polynomial only in a basis that rotates with it.
    """
    vehicle: Vehicle | None = limits.vehicle
    if vehicle is not None and vehicle.has_left and path.polynomials() is not None:
        raise ValueError(
            "retime supports the direction of a road to the left on routes: pass a route, such as "
            "qtraj.Route.from_path(path), or a vehicle without Road(left=...)"
        )
    if not limits.along_road:
        return limits.road(path.duration.dtype)
    if traced:
        raise ValueError("a road that changes along the way needs concrete values: call retime outside jit and grad")
    return road_on(limits.vehicle, path)


def fixed(vehicle: Any) -> Any:
    """Return the parameters of a vehicle; those that change along the way are NaN."""
    return vehicle.fixed if isinstance(vehicle, RoadOnPath) else vehicle


def at_points(vehicle: Any, t: Tables, shape: Shape) -> Any:
    """Return the parameters at the points of `t`, with the strictest friction in a cell, at a knot in both cells."""
    if not isinstance(vehicle, RoadOnPath):
        return vehicle
    u = np.asarray(shape.start + t.grid.knots * shape.per_cell)
    found = vehicle.at(u[t.cell] + t.place * (u[t.cell + 1] - u[t.cell]))
    ends, knots = variants(vehicle, u[:-1], u[1:]).ends, slice(1, t.grid.cells)
    for name in ("inv_long", "inv_lat"):
        start, end = (np.asarray(getattr(x, name)) for x in ends[0])
        own = start[t.cell] + t.place * (end - start)[t.cell]
        own[knots] = np.maximum(own[knots], end[:-1])
        found = found._replace(**{name: own})
    return found
