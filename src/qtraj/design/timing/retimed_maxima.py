"""Find the largest values of limited quantities on a retimed path."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from qtraj.design.ellipse import OfSpeed
from qtraj.design.timing.constraint_values import ratios, used
from qtraj.design.timing.constraints import listed, parts
from qtraj.design.timing.retimed_by_speed import OnCell
from qtraj.design.timing.retimed_cells import Cells, motion_at
from qtraj.design.timing.road_cells import at_parameters
from qtraj.design.timing.sided import value_of
from qtraj.design.timing.timing import RetimedPath
from qtraj.design.varying import Varying, at_places, varies
from qtraj.foundation.arrays import is_traced
from qtraj.path.road_on_path import RoadOnPath
from qtraj.path.road_parameters import RoadParameters

PLACES = 17
"""Number of equally spaced points in each cell at which quantities are evaluated."""

ZOOM_PLACES, ZOOMS = 65, 4
"""Number of points in each interval of the search for a maximum, and number of intervals.

The first interval is the cell. Each further interval is smaller, and its centre is the largest value so far."""

INSIDE = 1e-9
"""Smallest distance of a maximum from the ends of its cell, relative to the cell."""


class Limited(NamedTuple):
    """A retimed path with its cells, and its limits by name; `vehicle` is None without limits on friction or power.

    A limit may be an array with the values at both ends of each moving cell, or `Varying` if all values are concrete.
    """

    path: RetimedPath
    cells: Cells
    bounds: dict[str, Any]
    vehicle: RoadParameters | RoadOnPath | None

    @property
    def library(self) -> Any:
        """The array library of the values."""
        return jnp if is_traced(self) else np

    def usage(self, cell: Int[Any, " m"], place: Float[Any, " m"], names: tuple[str, ...]) -> Float[Any, "limits m"]:
        """Return the ratio of each quantity to its limit at the fraction `place` of each moving `cell`."""
        r, v = motion_at(self.path, self.cells, cell, place)
        one: Any = np.ones(())
        before_stop = self.library.asarray(self.cells.stops[1])[cell] & (place > 0.5)
        found = used(parts(r, one, self.bounds_at(cell, place), self._vehicle_at(cell, place), before_stop), v)
        rows = listed(self.bounds, self.vehicle is not None)
        return ratios(found, rows)[np.array([rows.index(name) for name in names])]

    def _vehicle_at(self, cell: Int[Any, " m"], place: Float[Any, " m"]) -> Any:
        """Return the parameters of the vehicle at the fraction `place` of each moving `cell`."""
        return at_parameters(self.vehicle, self._parameters(cell, place)) if self._on_road else self.vehicle

    @property
    def _on_road(self) -> bool:
        return isinstance(self.vehicle, RoadOnPath)

    def _parameters(self, cell: Int[Any, " m"], place: Float[Any, " m"]) -> Float[np.ndarray, " m"]:
        knots, at = np.asarray(self.path.timing.knots), np.asarray(self.cells.columns)[cell]
        return knots[at] + place * (knots[at + 1] - knots[at])

    def bounds_at(self, cell: Int[Any, " m"], place: Float[Any, " m"]) -> dict[str, Any]:
        """Return the limits at the fraction `place` of each moving `cell`."""
        if not varies(self.bounds):
            return at_places(self.bounds, cell, place)
        u = self._parameters(cell, place)
        return {name: x.at(u) if isinstance(x, Varying) else x for name, x in self.bounds.items()}


def values_in(
    limited: Limited,
    at: tuple[Int[Any, " limits"], Float[Any, " limits"]],
    largest: Float[Any, " limits"],
    names: tuple[str, ...],
) -> tuple[Float[Any, " limits"], Float[Any, " limits"]]:
    """Return the values of quantities with the ratios `largest` to their limits, and the limits.

    `at` is for each limit the cell of the timing, and the place in it.
    """
    xp, rows = limited.library, [limited.bounds] * len(names)
    if varies(limited.bounds) or any(np.ndim(x) for x in limited.bounds.values()):
        columns = np.searchsorted(limited.cells.columns, at[0])
        rows = [limited.bounds_at(k, z) for k, z in zip(columns, at[1], strict=True)]
    found = [
        _by_speed(limited, at, k, name)
        if isinstance(rows[k][name], OfSpeed)
        else (value_of(largest[k], name, _numbers(rows[k])), rows[k][name])
        for k, name in enumerate(names)
    ]
    values, limits = zip(*found, strict=True)
    return xp.stack(values), xp.stack(limits)


def _numbers(bounds: dict[str, Any]) -> dict[str, Any]:
    return {name: x for name, x in bounds.items() if not isinstance(x, OfSpeed)}


def _by_speed(limited: Limited, at: tuple[Any, Any], k: int, name: str) -> tuple[Any, Any]:
    """Return the value of a quantity and its limit, which depends on the speed, at the place `k`."""
    value, limit = _on_cell(limited, at[0][k], name).compared(at[1][k : k + 1])
    return value[0], limit[0]


def _on_cell(limited: Limited, cell: Any, name: str) -> OnCell:
    moving = int(np.searchsorted(limited.cells.columns, cell))
    return OnCell(limited.path, limited.cells, moving, name, limited.bounds[name])


def largest_per_cell(limited: Limited, names: tuple[str, ...]) -> Float[Any, "limits moving"]:
    """Return the largest sampled ratio of each quantity to its limit in each moving cell; undefined ratios are zero."""
    moving = limited.cells.grid.half.shape[0]
    xp, place = limited.library, np.broadcast_to(np.linspace(0.0, 1.0, PLACES), (moving, PLACES))
    usage = limited.usage(np.repeat(np.arange(moving), PLACES), place.ravel(), names)
    return xp.max(xp.where(xp.isnan(usage), 0.0, usage).reshape(-1, moving, PLACES), axis=-1)


def _unless_lost(found: Any, new: Any, stops: Any) -> Any:
    """Return the new places and ratios, or those found before where only these violate a limit, at an end of a cell."""
    (place, usage), (before, after) = found, stops
    lost = (usage > 1) & ~(new[1] > 1) & ~(before & (place == 0)) & ~(after & (place == 1))
    return tuple(np.where(lost, x, y) for x, y in zip(found, new, strict=True))


def largest_in(
    limited: Limited, cell: Int[Any, " limits"], names: tuple[str, ...]
) -> tuple[Float[Any, " limits"], Float[Any, " limits"], Float[Any, " limits"]]:
    """Return the time of the maximum of each quantity in its `cell`, its place in the cell, and the ratio to its limit.

    Each of `ZOOMS` steps samples `ZOOM_PLACES` values, and the next step samples closer to the largest value. Close to
    a stop, rounding errors dominate the direction of motion, so the search stays away from the stop.
    """
    timing, cells, count, xp = limited.path.timing, limited.cells, len(names), limited.library
    k = xp.searchsorted(xp.asarray(cells.columns), cell)  # a cell without motion is never the worst one
    before, after = (xp.asarray(stops)[k] for stops in cells.stops)
    width = 1 / (ZOOM_PLACES - 1)
    rows, around = np.arange(count), np.linspace(-1.0, 1.0, ZOOM_PLACES)[None]

    def zoom(step: Any, found: tuple[Any, Any]) -> tuple[Any, Any]:
        lowest = xp.where(before, xp.minimum(found[0], width), INSIDE)
        highest = xp.where(after, xp.maximum(found[0], 1 - width), 1 - INSIDE)
        near = found[0][:, None] + 0.5 * (2 * width) ** step * around
        near = xp.where(step == 0, near, xp.clip(near, lowest[:, None], highest[:, None]))
        usage = limited.usage(xp.repeat(k, ZOOM_PLACES), near.ravel(), names)
        usage = usage.reshape(count, count, ZOOM_PLACES)[rows, rows]
        best = xp.argmax(xp.where(xp.isnan(usage), -np.inf, usage), axis=1)
        return near[rows, best], usage[rows, best]

    place, usage = xp.full(count, 0.5), xp.zeros(count)
    if xp is jnp:
        place, usage = jax.lax.fori_loop(0, ZOOMS, zoom, (place, usage))
    else:
        with np.errstate(all="ignore"):  # a failed search ends with NaN
            for step in range(ZOOMS):
                place, usage = _unless_lost((place, usage), zoom(step, (place, usage)), (before, after))
    for row, name in enumerate(names):
        if isinstance(limited.bounds[name], OfSpeed):
            place[row] = _on_cell(limited, cell[row], name).worst()
    knots = xp.asarray(timing.knots)
    return timing.times_of(knots[cell] + place * (knots[cell + 1] - knots[cell])), place, usage
