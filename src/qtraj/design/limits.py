"""Limits on path quantities, and the margins of a path."""

from __future__ import annotations  # so that `help` shows short names

import dataclasses
from typing import Any

import equinox as eqx
from jaxtyping import Array, Float

from qtraj.foundation.arrays import as_float, require_positive
from qtraj.foundation.document import storable
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Scalar, ScalarLike
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.quantity import quantity
from qtraj.path.values import value
from qtraj.path.vehicle import NO_VEHICLE, RoadParameters, Vehicle, require_vehicle

Limit = ArrayInput | None
"""The value of a limit; None means no limit."""


@storable
class Limits(eqx.Module):
    """Upper bounds on path quantities; None means no limit.

    - `curvature`, `torsion` [1/m]; `speed` [m/s].
    - `acceleration` |r̈|, `lateral_acceleration` |ṙ×r̈|/|ṙ|, `longitudinal_acceleration` |ṙ·r̈|/|ṙ| [m/s²].
    - `slope`: rise over run, relative to the horizontal plane [-].
    - `angular_rate` [rad/s] and `angular_acceleration` [rad/s²] of the natural trihedral.
    - `jerk` |r⃛| [m/s³].
    - `yaw_rate` [rad/s] and `yaw_acceleration` [rad/s²] of the upright frame, about its own z axis.

    With a `vehicle`, on a road that is level across or has the vehicle's bank angle:

    - `friction`: the use of the grip by the friction ellipse, √((F_τ/μ_τ)² + (F_n/μ_n)²)/F_b [-]; 1 is all of it.
    - `power` [W] of the drive, against inertia, gravity, drag and rolling resistance. Braking power is negative, and no
      limit on power bounds it.
    - `longitudinal_force` |F_τ|, `lateral_force` |F_n| and `normal_load` F_b [N], along τ, across it in the plane of
      the road, and normal to it.

    **Raises:** ValueError for a limit that is not a positive, finite number, or one of these five without a vehicle.
    """

    curvature: Scalar | None
    torsion: Scalar | None
    speed: Scalar | None
    acceleration: Scalar | None
    lateral_acceleration: Scalar | None
    longitudinal_acceleration: Scalar | None
    slope: Scalar | None
    angular_rate: Scalar | None
    angular_acceleration: Scalar | None
    jerk: Scalar | None
    yaw_rate: Scalar | None
    yaw_acceleration: Scalar | None
    longitudinal_force: Scalar | None
    lateral_force: Scalar | None
    normal_load: Scalar | None
    friction: Scalar | None
    power: Scalar | None
    vehicle: Vehicle | None

    def __init__(
        self,
        curvature: Limit = None,
        torsion: Limit = None,
        speed: Limit = None,
        acceleration: Limit = None,
        lateral_acceleration: Limit = None,
        longitudinal_acceleration: Limit = None,
        slope: Limit = None,
        angular_rate: Limit = None,
        angular_acceleration: Limit = None,
        jerk: Limit = None,
        yaw_rate: Limit = None,
        yaw_acceleration: Limit = None,
        longitudinal_force: Limit = None,
        lateral_force: Limit = None,
        normal_load: Limit = None,
        friction: Limit = None,
        power: Limit = None,
        vehicle: Vehicle | None = None,
    ):
        self.curvature = _limit(curvature, "curvature")
        self.torsion = _limit(torsion, "torsion")
        self.speed = _limit(speed, "speed")
        self.acceleration = _limit(acceleration, "acceleration")
        self.lateral_acceleration = _limit(lateral_acceleration, "lateral_acceleration")
        self.longitudinal_acceleration = _limit(longitudinal_acceleration, "longitudinal_acceleration")
        self.slope = _limit(slope, "slope")
        self.angular_rate = _limit(angular_rate, "angular_rate")
        self.angular_acceleration = _limit(angular_acceleration, "angular_acceleration")
        self.jerk = _limit(jerk, "jerk")
        self.yaw_rate = _limit(yaw_rate, "yaw_rate")
        self.yaw_acceleration = _limit(yaw_acceleration, "yaw_acceleration")
        self.longitudinal_force = _limit(longitudinal_force, "longitudinal_force")
        self.lateral_force = _limit(lateral_force, "lateral_force")
        self.normal_load = _limit(normal_load, "normal_load")
        self.friction = _limit(friction, "friction")
        self.power = _limit(power, "power")
        self.vehicle = vehicle
        needing = [name for name in self.given() if quantity(name).needs_vehicle]
        if needing or vehicle is not None:
            require_vehicle(vehicle, f"the limit {needing[0]}" if needing else "the field vehicle of Limits")

    def __repr__(self) -> str:
        return shown(self, **{name: quantity(name).label for name in self.given()})

    def given(self) -> dict[str, Float[Array, "*batch"]]:
        """The limits that are set, by name."""
        values = {f.name: getattr(self, f.name) for f in dataclasses.fields(self) if f.name != "vehicle"}
        return {name: value for name, value in values.items() if value is not None}

    @property
    def needs_vehicle(self) -> bool:
        """Whether one of the limits that are set depends on a vehicle."""
        return any(quantity(name).needs_vehicle for name in self.given())

    def road(self, dtype: Any = None) -> RoadParameters:
        """The numbers of the vehicle that the formulas use; without a vehicle, those of any."""
        return NO_VEHICLE if self.vehicle is None else self.vehicle.parameters(dtype)

    def values(self, path: AbstractHodograph, t: ScalarLike) -> dict[str, Scalar]:
        """The limited quantities of `path` at one instant `t` [s], by name, each in its limit's unit."""
        road = self.road(path.duration.dtype)
        return {name: value(path, t, name, road) for name in self.given()}

    def margins(self, path: AbstractHodograph, t: ScalarLike) -> dict[str, Scalar]:
        """The limit minus the value at one instant `t` [s], by name: negative where the limit is violated."""
        limits = self.given()
        return {name: limits[name] - value for name, value in self.values(path, t).items()}


def _limit(value: Limit, name: str) -> Scalar | None:
    if value is None:
        return None
    unit = quantity(name).label
    try:
        limit = as_float(value)
    except (TypeError, ValueError) as error:
        raise ValueError(f"the limit {name} must be a number [{unit}], but {value!r} was given") from error
    if limit.ndim != 0:
        raise ValueError(f"the limit {name} must be one number, but an array of shape {limit.shape} was given")
    require_positive(limit, f"the limit {name}", unit)
    return limit
