"""The parameters of a vehicle on a road that changes along one path, as functions of the parameter of this path.

In an interval of the parameter, the cosine and the sine of the bank and the inverses of the coefficients of friction
are replaced by lines. The distance is not linear in the parameter, and the cosine not in the distance, so a line has an
error. The lines of the inverses are nowhere below them, which is the strict side of a limit on friction. The cosine and
the sine differ from their lines by at most `Lines.error`.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from qtraj.foundation.arrays import is_traced
from qtraj.path.chords import chord_gaps
from qtraj.path.distances import Distances, distances
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.road import Road
from qtraj.path.road_parameters import RoadParameters
from qtraj.path.vehicle import Vehicle, fixed_parameters

BEYOND = 8
"""An interval may extend beyond the ends of its section by less than this multiple of the uncertainty."""

ROUNDING = 2.0**-48
"""Fraction of a value that exceeds the rounding errors of its interpolation."""

LINEAR = ("cos", "sin", "inv_long", "inv_lat")
"""The parameters that change along the way."""

CORNERS = ((1, 1), (1, -1), (-1, 1), (-1, -1))
"""The corners of a square around the cosine and the sine."""


class Lines(NamedTuple):
    """Parameters at both ends of intervals, linear between them, and the error of the cosine and the sine."""

    start: RoadParameters
    end: RoadParameters
    error: Float[np.ndarray, " n"]

    def corner(self, cos: int, sin: int) -> tuple[RoadParameters, RoadParameters]:
        """Return the parameters with cosine and sine changed by their errors in the given directions."""
        start, end = (
            x._replace(cos=x.cos + cos * self.error, sin=x.sin + sin * self.error) for x in (self.start, self.end)
        )
        return start, end


class Cut(NamedTuple):
    """Intervals of the parameter from `low` to `high`: each is a part of the interval `owner` in one section."""

    owner: Int[np.ndarray, " m"]
    low: Float[np.ndarray, " m"]
    high: Float[np.ndarray, " m"]
    section: Int[np.ndarray, " m"]


class RoadOnPath:
    """A vehicle on a road that changes along one path with concrete values."""

    def __init__(self, vehicle: Vehicle, on: Distances):
        self.vehicle, self.on = vehicle, on
        self.road: Road = vehicle.road  # pyright: ignore[reportAttributeAccessIssue]
        at = np.array(self.road.distance)
        at = at[: max(1, int(np.searchsorted(at, on.length - on.uncertainty)))]
        self.starts = at

    @cached_property
    def _ends(self) -> tuple[np.ndarray, np.ndarray]:
        """The parameters at the starts and the ends of the sections, which overlap."""
        on, at = self.on, self.starts
        low, high = on.parameters(at - on.uncertainty), on.parameters(np.append(at[1:], on.length) + on.uncertainty)
        low[0], high[-1] = on.ends[0], on.ends[-1]
        return low, high

    def at(self, u: Float[np.ndarray, "*n"], sections: np.ndarray | None = None) -> RoadParameters:
        """Return the parameters at parameters of the path; by default in the sections that contain them."""
        return self.at_distances(self.on.at(np.ravel(u)).reshape(np.shape(u)), sections)

    def changes(self) -> Float[np.ndarray, " m"]:
        """Return the distances [m] on the path at which a section ends."""
        return self.starts[1:]

    @property
    def fixed(self) -> RoadParameters:
        """The parameters; those that change along the way are NaN."""
        return fixed_parameters(self.vehicle, np.float64)

    def at_distances(self, s: Float[np.ndarray, "*n"], sections: np.ndarray | None = None) -> RoadParameters:
        """Return the parameters at distances [m]; by default in the sections that contain them."""
        found = self.vehicle.parameters(np.float64, self.road.at(s, sections))
        return found.each(lambda x: np.broadcast_to(np.asarray(x, float), np.shape(s)))

    def banks(self, s: Float[np.ndarray, "*n"], sections: np.ndarray) -> Float[np.ndarray, "*n"]:
        """Return the banks [rad] at distances [m] in sections."""
        bank: Any = self.vehicle.bank if self.road.bank is None else self.road.at(s, sections).bank
        return np.broadcast_to(np.asarray(bank, float), np.shape(s))

    def cut(self, low: Float[np.ndarray, " n"], high: Float[np.ndarray, " n"]) -> Cut:
        """Return the parts of intervals in each section; sections overlap by the uncertainty of the distance."""
        starts, ends = self._ends
        first = np.searchsorted(ends, low, side="right")
        first = np.minimum(first, starts.size - 1)
        last = np.maximum(np.searchsorted(starts, high, side="left") - 1, first)
        count = last - first + 1
        owner = np.repeat(np.arange(low.size), count)
        section = first[owner] + np.arange(owner.size) - np.repeat(np.cumsum(count) - count, count)
        start, end = np.maximum(low[owner], starts[section]), np.minimum(high[owner], ends[section])
        return Cut(owner, start, np.maximum(start, end), section)

    def lines(self, low: np.ndarray, high: np.ndarray, sections: Int[np.ndarray, " n"]) -> Lines:
        """Return lines between parameters of the path, which are nowhere less strict for limits on friction."""
        first, last = self.on.at(low), self.on.at(high)
        start, end = self.at_distances(first, sections), self.at_distances(last, sections)
        road, error = self.road, np.zeros(low.size)
        if road.kind == "step":
            return Lines(start, start, error)
        away = chord_gaps(self.on, low, high) + BEYOND * self.on.uncertainty
        if road.bank is not None:
            bank = np.array(road.bank)
            slope = road.steepest(bank, sections)
            banks: Any = [road.at(x, sections).bank for x in (first, last)]
            difference = np.abs(banks[1] - banks[0])
            bent = np.where(slope > 0, slope * np.where(slope > 0, away, 0.0) + ROUNDING, 0.0)
            error = np.minimum(bent + difference**2 / 8, 2.0)
        if road.friction is None:
            return Lines(start, end, error)
        columns = np.array(road.friction).T
        found = {}
        for name, values in zip(("inv_long", "inv_lat"), columns, strict=True):
            # 1/μ is convex in μ, so it is below its chord; its slope is that of μ divided by μ².
            smallest = self._smallest(values, sections)
            slope = road.steepest(values, sections) / smallest**2
            above = np.where(slope > 0, slope * np.where(slope > 0, away, 0.0), 0.0)
            own = [np.asarray(getattr(x, name)) for x in (start, end)]
            lifted = [np.where(slope > 0, (x + above) * (1 + ROUNDING), x) for x in own]
            found[name] = [np.where(np.isfinite(above), x, (1 + ROUNDING) / smallest) for x in lifted]
        start, end = (x._replace(**{n: y[k] for n, y in found.items()}) for k, x in enumerate((start, end)))
        return Lines(start, end, error)

    @staticmethod
    def _smallest(values: np.ndarray, sections: np.ndarray) -> np.ndarray:
        """Return the smallest values at the ends of sections and of those next to them."""
        padded = np.concatenate([values[:1], values, values[-1:], values[-1:]])
        return np.min([padded[sections + k] for k in range(4)], axis=0)


def road_on(vehicle: Vehicle, path: AbstractHodograph) -> RoadOnPath:
    """Return a vehicle with a road that changes along one path.

    **Raises:** ValueError for traced values, and for a batch of paths or vehicles.
    """
    if is_traced(path, vehicle) or np.ndim(path.duration) or np.ndim(vehicle.mass):
        raise ValueError(
            "a road that changes along the way is supported for one path and one vehicle with concrete values: call "
            "this outside jit, grad and vmap, once for each path"
        )
    return RoadOnPath(vehicle, distances(path))
