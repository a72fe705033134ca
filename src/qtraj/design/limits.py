"""Limits on path quantities, and the margins of a path."""

import dataclasses

import equinox as eqx
from jaxtyping import Array, Float

from qtraj.foundation.arrays import as_float, require_positive
from qtraj.foundation.document import storable
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Scalar, ScalarLike
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.quantity import quantity
from qtraj.path.values import value


@storable
class Limits(eqx.Module):
    """Upper bounds on path quantities; None means no limit.

    - `curvature`, `torsion` [1/m]; `speed` [m/s].
    - `acceleration` |r̈|, `lateral_acceleration` |ṙ×r̈|/|ṙ|, `longitudinal_acceleration` |ṙ·r̈|/|ṙ| [m/s²].
    - `slope`: rise over run, with respect to the world's z axis [-].
    - `angular_rate` [rad/s] and `angular_acceleration` [rad/s²] of the natural trihedral.
    - `jerk` |r⃛| [m/s³].
    - `yaw_rate` [rad/s] and `yaw_acceleration` [rad/s²] of the upright frame, about its own z axis.

    **Raises:** ValueError for a limit that is not a positive, finite number.
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

    def __init__(
        self,
        curvature: ArrayInput | None = None,
        torsion: ArrayInput | None = None,
        speed: ArrayInput | None = None,
        acceleration: ArrayInput | None = None,
        lateral_acceleration: ArrayInput | None = None,
        longitudinal_acceleration: ArrayInput | None = None,
        slope: ArrayInput | None = None,
        angular_rate: ArrayInput | None = None,
        angular_acceleration: ArrayInput | None = None,
        jerk: ArrayInput | None = None,
        yaw_rate: ArrayInput | None = None,
        yaw_acceleration: ArrayInput | None = None,
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

    def __repr__(self) -> str:
        return shown(self, **{name: quantity(name).label for name in self.given()})

    def given(self) -> dict[str, Float[Array, "*batch"]]:
        """The limits that are set, by name."""
        values = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        return {name: value for name, value in values.items() if value is not None}

    def values(self, path: AbstractHodograph, t: ScalarLike) -> dict[str, Scalar]:
        """The limited quantities of `path` at one instant `t` [s], by name, each in its limit's unit."""
        return {name: value(path, t, name) for name in self.given()}

    def margins(self, path: AbstractHodograph, t: ScalarLike) -> dict[str, Scalar]:
        """The limit minus the value at one instant `t` [s], by name: negative where the limit is violated."""
        limits = self.given()
        return {name: limits[name] - value for name, value in self.values(path, t).items()}


def _limit(value: ArrayInput | None, name: str) -> Scalar | None:
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
