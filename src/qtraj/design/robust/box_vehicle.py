"""The numbers of a vehicle that deviate in a box, as parameters of polynomials."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from qtraj.algebra.degrees import Degrees
from qtraj.algebra.exact import ExactPolynomial
from qtraj.design.limits import Limits
from qtraj.design.proof import units
from qtraj.design.robust.box import Box
from qtraj.path.road_parameters import RoadParameters

BITS = 36
"""Number of bits of an interval, so that its numbers at the nodes are exact floats."""

ROUNDING = 1e-15
"""Relative rounding error that exceeds those of a few products and quotients."""

INVERSE_MASS, DRAG_AREA, DRAG = "inverse_mass", "drag_area", "drag"
"""Names of parameters: 1/m, the drag area, and, for a mass that does not deviate, the `drag` of `RoadParameters`."""


class OutwardInterval(NamedTuple):
    """An interval of a number of a vehicle, with ends that are rounded outwards to `BITS` bits."""

    low: float
    high: float
    rounded: bool
    """Whether numbers were added, so that a violated limit may be one of these numbers only."""

    @classmethod
    def around(cls, low: float, high: float) -> OutwardInterval:
        """Return a slightly larger interval; its lowest number is zero if `low` is less than 2^-BITS times `high`."""
        unit = np.ldexp(1.0, int(np.frexp(high)[1]) - BITS)
        own = float(np.floor(low / unit) * unit), float(np.ceil(high / unit) * unit)
        return cls(*own, own != (low, high))

    def at(self, fractions: Any) -> Any:
        """Return the numbers at fractions of the interval that are nodes; nothing is rounded."""
        return self.low + (self.high - self.low) * fractions


class BoxVehicle(NamedTuple):
    """A vehicle, of which some numbers are in intervals.

    If the mass m deviates, forces are divided by it: in the formulas the mass is 1, limits on forces are multiplied by
    1/m, and the deceleration by air drag is ½ρA/m. All of them are polynomials in 1/m and in the drag area A.
    """

    road: RoadParameters
    intervals: Mapping[str, OutwardInterval]
    density: float = 0.0
    drag_area: float = 0.0

    @classmethod
    def of(cls, limits: Limits, box: Box) -> BoxVehicle:
        """Return the vehicle of some limits with the deviations of a box."""
        road, found = limits.road(float), {}
        mass, area = box.intervals.get("mass"), box.intervals.get("drag_area")
        if limits.vehicle is None or (mass is None and area is None):
            return cls(road, found)
        given: Any = limits.vehicle
        own, drag_area, density = (float(np.asarray(x)) for x in (given.mass, given.drag_area, given.air_density))
        if mass is not None:
            least, most = (1.0 / (own + x) for x in mass[::-1])
            found[INVERSE_MASS] = OutwardInterval.around(least * (1 - ROUNDING), most * (1 + ROUNDING))
        if area is not None:
            ends = [drag_area + x for x in area]
            if mass is None:
                least, most = (0.5 * density / own * x for x in ends)
                found[DRAG] = OutwardInterval.around(least * (1 - ROUNDING), most * (1 + ROUNDING))
            else:
                found[DRAG_AREA] = OutwardInterval.around(ends[0] * (1 - ROUNDING), ends[1] * (1 + ROUNDING))
        return cls(road, found, density, drag_area)

    @property
    def rounded(self) -> bool:
        """Whether the intervals contain numbers that are not in the box."""
        return any(x.rounded for x in self.intervals.values())

    def at(self, fractions: Sequence[Any]) -> dict[str, Any]:
        """Return the parameters at fractions of their intervals."""
        return {name: x.at(s) for (name, x), s in zip(self.intervals.items(), fractions, strict=True)}

    def with_numbers(
        self, own: Mapping[str, Any], constant: Callable[[Any], Any], road: RoadParameters, length: Any = 1.0
    ) -> tuple[RoadParameters, Any]:
        """Return the parameters of the formulas, and the factor of limits on forces, None for 1.

        `own` are the parameters that deviate, `constant` converts numbers to such ones, and `road` are all others in
        the unit of length `length` [m].
        """
        known = units.constants(road, constant)
        if INVERSE_MASS not in own:
            return known._replace(**own), None
        inverse, drag = own[INVERSE_MASS], 0
        if DRAG_AREA in own or self.drag_area != 0:
            area = own[DRAG_AREA] if DRAG_AREA in own else constant(self.drag_area)
            drag = constant(0.5 * self.density * length) * area * inverse
        return known._replace(mass=1, drag=drag), inverse

    def degrees(self, count: int) -> tuple[RoadParameters, Any]:
        """Return the same for degrees in all of `count` parameters, of which those of the vehicle are the last."""
        none = Degrees((0,) * count)
        first = count - len(self.intervals)
        own = {name: Degrees([int(k == j) for j in range(count)]) for k, name in enumerate(self.intervals, first)}
        return self.with_numbers(own, lambda x: none, self.road.each(lambda x: np.asarray(x, float)))

    def exactly(self, fractions: Sequence[float]) -> tuple[RoadParameters, Any]:
        """Return the same in exact integers, at fractions that are nodes."""
        own = {name: ExactPolynomial.of(x) for name, x in self.at(fractions).items()}
        return self.with_numbers(own, ExactPolynomial.of, self.road.each(lambda x: np.asarray(x, float)))

    def deviations(self, box: Box, fractions: Sequence[float], limits: Limits) -> np.ndarray:
        """Return the deviations of a box at fractions of all its parameters."""
        found = box.lowest + (box.highest - box.lowest) * np.asarray(fractions)
        if INVERSE_MASS in self.intervals:
            k = box.names.index("mass")
            mass: Any = limits.vehicle.mass  # pyright: ignore[reportOptionalMemberAccess]
            found[k] = 1.0 / self.intervals[INVERSE_MASS].at(fractions[k]) - float(np.asarray(mass))
        return np.clip(found, box.lowest, box.highest)
