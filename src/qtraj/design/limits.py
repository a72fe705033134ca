"""Limits on path quantities, and the margins of a path."""

from __future__ import annotations  # so that `help` shows short names

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import equinox as eqx
from jaxtyping import Array, Float

from qtraj.design.along import Variable
from qtraj.design.bound import Bound, Limit, OneBound, Sides, bound_of, by_side, joined_sides, part_of
from qtraj.design.ellipse import Ellipse
from qtraj.design.limit_checks import forces_along, refuse_changing, refuse_unknown, require_needs, require_shapes
from qtraj.design.margins import margins_of, road_at, values_of
from qtraj.design.obstacles.body import Body, BodyInput, body_of
from qtraj.design.obstacles.keep_out import clearances_at, obstacles_of
from qtraj.design.obstacles.obstacle import AbstractObstacle
from qtraj.design.own_limits import OwnInput, OwnLimits, own_limits
from qtraj.design.regions import Regions
from qtraj.design.timing.constraints import NAMES
from qtraj.foundation.argument import require_type
from qtraj.foundation.document import storable
from qtraj.foundation.shown import shown, shown_html
from qtraj.foundation.types import Scalar, ScalarLike
from qtraj.path.hodograph import AbstractHodograph, require_path
from qtraj.path.own_name import OwnName
from qtraj.path.path_quantity import VEHICLE
from qtraj.path.quantity import LIMITED, quantity
from qtraj.path.road_parameters import RoadParameters
from qtraj.path.vehicle import Vehicle, fixed_parameters


@storable
class Limits(eqx.Module):
    """Bounds on path quantities; None means no limit.

    A number bounds the magnitude of a quantity. A pair (lower, upper), one of which may be None, bounds its signed
    value: for example, `longitudinal_acceleration=(-6, 2)` for braking and accelerating, or `speed=(5, 30)`.
    Certificates name the two sides with the endings `_min` and `_max`; the upper side of a quantity that is never
    negative, such as the speed, has no ending. Instead of a number, `Along` and `Regions` change along the way, and
    `BySpeed` depends on the speed.

    - `curvature`, `torsion` [1/m]; `speed` [m/s].
    - `acceleration` |r̈|, `lateral_acceleration` |ṙ×r̈|/|ṙ|, `longitudinal_acceleration` |ṙ·r̈|/|ṙ|; ṙ·r̈ is
      negative while braking [m/s²].
    - `slope`: rise over run, relative to the horizontal plane, positive uphill [-].
    - `angular_rate` [rad/s] and `angular_acceleration` [rad/s²] of the natural trihedral.
    - `jerk` |r⃛| [m/s³].
    - `yaw_rate` [rad/s] and `yaw_acceleration` [rad/s²] of the upright frame, about its own z axis, positive to the
      left.
    - `longitudinal_jerk` and `lateral_jerk` [m/s³], the rates of the longitudinal and of the horizontal lateral
      acceleration.
    - `horizontal_curvature` [1/m] of the projection of the path, positive in left turns; its `curvature_rate`
      [1/(m s)], and its change per horizontal distance, the `sharpness` [1/m²].
    - `height` [m], the world's z component of the position, which may be negative.
    - `vertical_speed` [m/s] and `vertical_acceleration` [m/s²], positive upwards.
    - `load_factor` |f|/g [-] of the specific force f = r̈ + g·up, its `tilt` [rad] from the vertical, and the
      `bank_angle` [rad] of a coordinated turn, positive in left turns; g is 9.80665 m/s² without a `vehicle`.
    - `combined_acceleration`: an `Ellipse`, which limits the longitudinal and the lateral acceleration together.

    With a `vehicle` that has a wheelbase: `steering_angle` [rad] and `steering_rate` [rad/s], positive to the left.

    With a `vehicle`, on a road that is level in the lateral direction or has the vehicle's bank angle:

    - `friction`: the fraction of the available grip that is used, √((F_τ/μ_τ)² + (F_n/μ_n)²)/F_b [-] (friction
      ellipse); 1 is the maximum grip.
    - `power` [W] of the drive against inertia, gravity, drag and rolling resistance. Braking power is negative: a
      number does not limit it, a pair does.
    - `longitudinal_force` |F_τ| along the direction of travel τ, `lateral_force` |F_n| across τ in the plane of the
      road, and `normal_load` F_b normal to the road [N].

    With a `vehicle` whose inertia has the principal axes τ, n and b of the natural trihedral:

    - `tangential_moment` |M_τ|, `normal_moment` |M_n| and `binormal_moment` |M_b| [N m]: the components of the moment
      that rotates the vehicle with the natural trihedral.

    A bank would roll the axes of inertia, so it must be zero, unless the moments of inertia about n and b are equal.
    This is not checked for traced values of inertia or bank. If the axes are then not principal axes, the findings on
    moments are "undecided" and their values are NaN.

    `own` contains limits on quantities of one's own, such as `own={climb: (-2.0, 3.0)}` (see `Quantity`).

    `keep_out` is a list of obstacles (`Ball`, `Cylinder`, `Ellipsoid`, `HalfSpace`, `ConvexPolygon`) that the `body`
    must not enter: a point, or a list of balls `(offset, radius)` [m]. An offset is in the direction of travel, or (3,)
    forwards, to the left and upwards.

    **Raises:** TypeError for the name of an unknown limit. ValueError for a limit that is neither a positive, finite
    number nor a pair of finite numbers in ascending order, for a pair for a moment, for a negative lower bound on a
    quantity that is never negative, for an angle that is too large, and for a limit without the vehicle, the inertia
    with these principal axes or the wheelbase that it needs.
    """

    curvature: Bound | None
    torsion: Bound | None
    speed: Bound | None
    acceleration: Bound | None
    lateral_acceleration: Bound | None
    longitudinal_acceleration: Bound | None
    slope: Bound | None
    angular_rate: Bound | None
    angular_acceleration: Bound | None
    jerk: Bound | None
    yaw_rate: Bound | None
    yaw_acceleration: Bound | None
    longitudinal_jerk: Bound | None
    lateral_jerk: Bound | None
    horizontal_curvature: Bound | None
    curvature_rate: Bound | None
    sharpness: Bound | None
    height: Bound | None
    vertical_speed: Bound | None
    vertical_acceleration: Bound | None
    load_factor: Bound | None
    tilt: Bound | None
    bank_angle: Bound | None
    steering_angle: Bound | None
    steering_rate: Bound | None
    longitudinal_force: Bound | None
    lateral_force: Bound | None
    normal_load: Bound | None
    friction: Bound | None
    power: Bound | None
    tangential_moment: Bound | None
    normal_moment: Bound | None
    binormal_moment: Bound | None
    combined_acceleration: Ellipse | None
    vehicle: Vehicle | None
    own: OwnLimits | None
    keep_out: tuple[AbstractObstacle, ...] | None
    body: Body | None

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
        longitudinal_jerk: Limit = None,
        lateral_jerk: Limit = None,
        horizontal_curvature: Limit = None,
        curvature_rate: Limit = None,
        sharpness: Limit = None,
        height: Limit = None,
        vertical_speed: Limit = None,
        vertical_acceleration: Limit = None,
        load_factor: Limit = None,
        tilt: Limit = None,
        bank_angle: Limit = None,
        steering_angle: Limit = None,
        steering_rate: Limit = None,
        longitudinal_force: Limit = None,
        lateral_force: Limit = None,
        normal_load: Limit = None,
        friction: Limit = None,
        power: Limit = None,
        tangential_moment: Limit = None,
        normal_moment: Limit = None,
        binormal_moment: Limit = None,
        combined_acceleration: Limit = None,
        vehicle: Vehicle | None = None,
        own: OwnInput = None,
        keep_out: Sequence[AbstractObstacle] | None = None,
        body: BodyInput = None,
        **unknown: Any,
    ):
        given = {name: limit for name, limit in locals().items() if name in LIMITED}
        refuse_unknown(unknown)
        for name, limit in given.items():
            setattr(self, name, bound_of(limit, name))
        self.vehicle, self.own = vehicle, own_limits(own)
        self.body = body_of(body)
        self.keep_out = obstacles_of(keep_out, self.body)
        require_needs(self._bounds(), vehicle)

    def __repr__(self) -> str:
        return shown(self, **{name: quantity(name).label for name in self._bounds()})

    _repr_html_ = shown_html

    def _bounds(self) -> dict[str, Bound]:
        """Return the limits that are set, by name."""
        values = {f.name: getattr(self, f.name) for f in dataclasses.fields(self) if f.name in LIMITED}
        own = {} if self.own is None else self.own.given()
        return {name: value for name, value in values.items() if value is not None} | own

    def given(self) -> dict[str, OneBound]:
        """Return the bounds that are set, by name; a limit with two sides has two names (see `qtraj.path.sides`)."""
        return {side: value for name, bound in self._bounds().items() for side, value in by_side(name, bound)}

    def constant(self) -> dict[str, Float[Array, "*batch"]]:
        """Return the bounds that are numbers, by name."""
        return {name: bound for name, bound in self.given().items() if not isinstance(bound, Variable)}

    def on_timing(self) -> Limits:
        """Return the limits that depend on the timing of a path, of those that `retime` supports."""
        own = [name for name in self.given() if isinstance(name, OwnName) and not quantity(name).of_shape]
        return self.only([*NAMES, *own])

    def on_shape(self) -> Limits:
        """Return the limits on quantities that depend only on the shape of a path, such as the curvature."""
        return self.only([name for name in self.given() if quantity(name).of_shape])

    def only(self, names: Collection[str]) -> Limits:
        """Return the bounds in `names`, with the vehicle if one of them uses it, and without obstacles."""
        kept: dict[str, Any] = {name: part_of(bound, name, names) for name, bound in self._bounds().items()}
        kept |= {"keep_out": None, "body": None}
        if not any(quantity(name).uses_vehicle for name, bound in kept.items() if bound is not None):
            kept["vehicle"] = None
        if self.own is not None:
            kept = {name: x for name, x in kept.items() if name not in self.own.names}
            kept["own"] = self.own.only(names)
        return eqx.tree_at(
            lambda x: [getattr(x, name) for name in kept],
            self,
            list(kept.values()),
            is_leaf=lambda x: x is None or type(x) is tuple or isinstance(x, _FIELDS),
        )

    @property
    def varying(self) -> list[str]:
        """The names of the bounds that change along the way or with the speed."""
        return [name for name, bound in self.given().items() if isinstance(bound, Variable)]

    def on(self, path: AbstractHodograph) -> Limits:
        """Return the limits on one path: those in `Regions` become limits along the way."""
        if not any(isinstance(bound, Regions) for bound in self.given().values()):
            return self
        own = {n: x.along(path, quantity(n).side) for n, x in self.given().items() if isinstance(x, Regions)}
        return limits_of(self.given() | own, self.vehicle, keep_out=self.keep_out, body=self.body)

    def require_constant(self, what: str, instead: str) -> None:
        """Raise a ValueError if a limit changes along the way or with the speed, which `what` does not support."""
        refuse_changing({name: self.given()[name] for name in self.varying}, what, instead)

    @property
    def uses_vehicle(self) -> bool:
        """Whether one of the limits that are set uses the parameters or the inertia of a vehicle."""
        return any(quantity(name).uses_vehicle for name in self.given())

    @property
    def on_forces(self) -> bool:
        """Whether one of the limits that are set bounds a force between the vehicle and the road."""
        return any(quantity(name).needs == VEHICLE for name in self.given())

    @property
    def along_road(self) -> list[str]:
        """The names of the bounds on forces of a road that changes along the way."""
        return forces_along(self.vehicle, self.given())

    def require_batch(self, batch: tuple[int, ...], what: str) -> None:
        """Raise a ValueError if limits or vehicle have another batch shape than () and `batch`, that of `what`."""
        require_shapes(self.constant(), self.vehicle, batch, what)

    def road(self, dtype: Any = None) -> RoadParameters:
        """Return the parameters of the vehicle, or default ones; those that no limit needs may be NaN on a road."""
        return fixed_parameters(self.vehicle, dtype, bool(self.along_road))

    def values(self, path: AbstractHodograph, t: ScalarLike) -> dict[str, Scalar]:
        """Return the limited quantities of `path` at one instant `t` [s], by name, each in the unit of its limit."""
        require_path(path)
        return values_of(self.given(), path, t, road_at(self, path, t))

    def margins(self, path: AbstractHodograph, t: ScalarLike) -> dict[str, Scalar]:
        """Return the distance of the value at one instant `t` [s] from each limit, by name; negative if violated.

        The two sides of a signed value have the endings `_min` and `_max`. For a limit that changes along the way, the
        distance to `t` is computed by quadrature.
        """
        require_path(path)
        own = {} if self.keep_out is None else clearances_at(self.keep_out, self.body, path, t)
        return margins_of(self.on(path).given(), path, t, road_at(self, path, t)) | own


_FIELDS = Sides | Variable | Vehicle | OwnLimits | Body
"""The kinds of fields of `Limits`, other than numbers."""


def limits_of(bounds: Mapping[str, Any], vehicle: Vehicle | None = None, **obstacles: Any) -> Limits:
    """Return the limits with these bounds, whose names are those of `Limits.given`; `obstacles` are further fields."""
    fields = joined_sides(bounds)
    others: Any = {name: bound for name, bound in fields.items() if isinstance(name, OwnName)}
    own = {name: x for name, x in fields.items() if name not in others}
    return Limits(**own, vehicle=vehicle, own=others, **obstacles)


def require_limits(limits: Limits) -> None:
    """Raise a ValueError if the argument `limits` is not a `Limits`."""
    require_type(limits, Limits, "limits", "a Limits, such as Limits(curvature=0.05)")
