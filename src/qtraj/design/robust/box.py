"""Intervals of boundary states, of a vehicle, and of limits."""

from __future__ import annotations  # so that `help` shows short names

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import numpy as np

from qtraj.foundation.argument import require_type
from qtraj.foundation.arrays import as_float
from qtraj.foundation.document import storable
from qtraj.foundation.shown import shown, shown_html
from qtraj.foundation.types import ArrayInput
from qtraj.foundation.units import with_unit
from qtraj.path.quantity import quantity

Interval = tuple[float, float]


def _at_ends(**units: str) -> dict[str, str]:
    return {f"{end}_{name}": unit for end in ("start", "end") for name, unit in units.items()}


PATH_STATES = _at_ends(speed="m s-1", radial_speed="m s-1", axial_speed="m s-1", axial_position="m")
"""The parameters of the boundary states of a spiral-helix and their units."""

ROUTE_STATES = _at_ends(
    speed="m s-1", lateral_speed="m s-1", vertical_speed="m s-1", lateral_position="m", vertical_position="m"
)
"""The parameters of the states at the ends of a route and their units."""

STATES = {**PATH_STATES, **ROUTE_STATES}

VEHICLE = {"mass": "kg", "drag_area": "m2"}
"""The parameters of the vehicle and their units."""

UNITS = {**STATES, **VEHICLE}
"""All parameters and their units."""

MAX_PARAMETERS = 3
"""Maximum number of parameters with an interval; limits do not count."""

INSTEAD = {
    "friction": "pass limits={'friction': …}, the deviation of the limit on the friction",
    "duration": "the duration is fixed: call certify_box for each duration, or sweep over it",
    "position": "of a spiral-helix, only axial positions are possible, because the angular rate contains the inverse "
    "of the radius: pass start_axial_position or end_axial_position, or for a route start_lateral_position or "
    "start_vertical_position, or give standard deviations in a Spread",
    "velocity": "pass start_speed, for a spiral-helix start_radial_speed or start_axial_speed, for a route "
    "start_lateral_speed or start_vertical_speed, or those of the end",
    "radius": "the angular rate contains the inverse of the radius: give standard deviations in a Spread instead",
    "azimuth": "give standard deviations of the positions in a Spread instead",
    "drag": "pass drag_area, its deviation in m²",
    "wind": "at the speed v, a headwind w multiplies the drag by (1 + w/v)²: pass a drag_area that contains this for "
    "the lowest speed",
    "gain": "gains belong to a closed loop, not to a path: sweep over simulations with random gains",
    "bank": "the bank enters by its cosine and sine: prove the limits for each bank",
}
"""What to do for parameters that are not supported, by a part of their names."""


@storable
class Box(eqx.Module):
    """Intervals of the deviations from a path, for proofs and tunings that hold for all values in them.

    Each interval is a number b, which means from −b to b, or a pair (lowest, highest). All combinations of the
    deviations are possible. In contrast to a `Spread`, nothing is said about probabilities. Radial and axial deviations
    are for spiral-helices, lateral and vertical ones for routes, and all others for both.

    Args:
        start_speed: Deviation of the speed at the start [m/s]; the direction of the velocity is kept.
        start_radial_speed: Deviation of the velocity away from the axis of the path [m/s].
        start_axial_speed: Deviation of the velocity along the axis of the path [m/s].
        start_axial_position: Deviation of the position along the axis of the path [m].
        end_speed: As for the start.
        end_radial_speed: As for the start.
        end_axial_speed: As for the start.
        end_axial_position: As for the start.
        mass: Deviation of the mass of the vehicle in the limits [kg].
        drag_area: Deviation of its drag area [m²], also for wind: at the speed v, a headwind w multiplies the drag by
            (1 + w/v)².
        limits: Deviations of limits by name, in the unit of the limit, such as `{"friction": 0.05}`.
        start_lateral_speed: Deviation of the velocity to the left of the route, horizontally [m/s].
        start_vertical_speed: Deviation of the velocity upwards [m/s].
        start_lateral_position: Deviation of the position to the left of the route, horizontally [m].
        start_vertical_position: Deviation of the position upwards [m].
        end_lateral_speed: As for the start.
        end_vertical_speed: As for the start.
        end_lateral_position: As for the start.
        end_vertical_position: As for the start.
        intervals: More deviations of parameters by name, such as `{"start_speed": (-0.5, 0.5)}`; for `load`.

    Raises:
        ValueError: For an interval that is reversed or not finite, no deviation at all, more than three parameters
            besides limits, and parameters that are not supported, with what to do instead.

    Example:
        >>> Box(start_speed=(-0.5, 0.5), limits={"friction": 0.05}).intervals
        {'start_speed': (-0.5, 0.5)}
    """

    intervals: dict[str, Interval]
    limits: dict[str, Interval]

    def __init__(
        self,
        start_speed: ArrayInput | None = None,
        start_radial_speed: ArrayInput | None = None,
        start_axial_speed: ArrayInput | None = None,
        start_axial_position: ArrayInput | None = None,
        end_speed: ArrayInput | None = None,
        end_radial_speed: ArrayInput | None = None,
        end_axial_speed: ArrayInput | None = None,
        end_axial_position: ArrayInput | None = None,
        mass: ArrayInput | None = None,
        limits: Mapping[str, Any] | None = None,
        drag_area: ArrayInput | None = None,
        *,
        start_lateral_speed: ArrayInput | None = None,
        start_vertical_speed: ArrayInput | None = None,
        start_lateral_position: ArrayInput | None = None,
        start_vertical_position: ArrayInput | None = None,
        end_lateral_speed: ArrayInput | None = None,
        end_vertical_speed: ArrayInput | None = None,
        end_lateral_position: ArrayInput | None = None,
        end_vertical_position: ArrayInput | None = None,
        intervals: Mapping[str, Any] | None = None,
        **unknown: Any,
    ):
        for mapping, name, example in ((limits, "limits", "friction"), (intervals, "intervals", "start_speed")):
            expected = f"a dictionary of deviations by name, such as {{{example!r}: 0.05}}"
            require_type(mapping, Mapping | None, name, expected)  # pyright: ignore[reportArgumentType]
        own = {
            "start_speed": start_speed,
            "start_radial_speed": start_radial_speed,
            "start_axial_speed": start_axial_speed,
            "start_axial_position": start_axial_position,
            "end_speed": end_speed,
            "end_radial_speed": end_radial_speed,
            "end_axial_speed": end_axial_speed,
            "end_axial_position": end_axial_position,
            "start_lateral_speed": start_lateral_speed,
            "start_vertical_speed": start_vertical_speed,
            "start_lateral_position": start_lateral_position,
            "start_vertical_position": start_vertical_position,
            "end_lateral_speed": end_lateral_speed,
            "end_vertical_speed": end_vertical_speed,
            "end_lateral_position": end_lateral_position,
            "end_vertical_position": end_vertical_position,
            "mass": mass,
            "drag_area": drag_area,
        }
        given = {name: x for name, x in own.items() if x is not None} | dict(intervals or {})
        for name in (*unknown, *given):
            if name not in UNITS:
                raise ValueError(f"{name} is not a parameter of a Box: {_instead(name)}")
        found = {name: _interval(x, name) for name, x in given.items()}
        self.intervals = {name: found[name] for name in UNITS if name in found and found[name] != (0.0, 0.0)}
        self.limits = {str(name): _interval(x, f"limits[{name!r}]") for name, x in (limits or {}).items()}
        if not (self.intervals or any(x != (0.0, 0.0) for x in self.limits.values())):
            raise ValueError("every deviation is zero: pass at least one interval, or use certify or tune")
        if len(self.intervals) > MAX_PARAMETERS:
            raise ValueError(
                f"a Box has at most {MAX_PARAMETERS} parameters besides limits, but {', '.join(self.intervals)} were "
                "given: give standard deviations in a Spread instead"
            )

    def __repr__(self) -> str:
        return shown(self)

    _repr_html_ = shown_html

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the parameters that deviate."""
        return tuple(self.intervals)

    @property
    def lowest(self) -> np.ndarray:
        """The lowest deviations (n,)."""
        return np.array([low for low, _ in self.intervals.values()])

    @property
    def highest(self) -> np.ndarray:
        """The highest deviations (n,)."""
        return np.array([high for _, high in self.intervals.values()])


def _instead(name: str) -> str:
    for part, advice in INSTEAD.items():
        if part in name:
            return advice
    return f"its parameters are {', '.join(UNITS)} and limits"


def text_of(box: Box) -> str:
    """Return a description of a box, such as "start_speed -0.5 m/s to 0.5 m/s"."""
    rows = [(name, x, UNITS[name]) for name, x in box.intervals.items()]
    rows += [(f"limit on {name}", x, quantity(name).unit) for name, x in box.limits.items()]
    return ", ".join(f"{name} {with_unit(low, unit)} to {with_unit(high, unit)}" for name, (low, high), unit in rows)


def _has_truth_values(x: Any) -> bool:
    each = x if isinstance(x, list | tuple) else (x,)
    return any(np.asarray(value).dtype == bool for value in each)


def _interval(x: Any, name: str) -> Interval:
    try:
        array = np.full(3, np.nan) if _has_truth_values(x) else np.asarray(as_float(x))
    except (TypeError, ValueError):
        array = np.full(3, np.nan)
    if array.shape not in {(), (2,)} or not np.isfinite(array).all():
        raise ValueError(f"{name} must be a finite number b, for -b to b, or a pair (lowest, highest), not {x!r}")
    low, high = (-float(array), float(array)) if array.ndim == 0 else (float(array[0]), float(array[1]))
    if low > high:
        raise ValueError(f"{name} must be a number of 0 or more, or a pair (lowest, highest), not {x!r}")
    return low, high
