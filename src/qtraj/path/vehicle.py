"""Define the parameters of a vehicle and of the road, for forces, friction and power along a path."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra.inertia import inertia_matrix
from qtraj.foundation.arrays import concrete, require_positive
from qtraj.foundation.document import storable
from qtraj.foundation.namespace import xp
from qtraj.foundation.naming import naming
from qtraj.foundation.shown import shown, shown_html
from qtraj.foundation.types import ArrayInput
from qtraj.path.path_quantity import INERTIA, PARAMETERS, PRINCIPAL, VEHICLE, WHEELBASE
from qtraj.path.road import MAX_BANK, Road, Surface
from qtraj.path.road_parameters import GRAVITY, NO_VEHICLE, RoadParameters, about_left
from qtraj.path.vehicle_fields import friction_field, not_negative_field, require_road, scalar_field
from qtraj.path.vehicle_inertia import inertia_in_frame, principal_moments

AIR_DENSITY = 1.225
"""The density of air [kg/m³] at sea level in the International Standard Atmosphere."""

Number = Float[Array, "*batch"]


@storable
class Vehicle(eqx.Module):
    """A vehicle on a road, modelled as a point mass with tyre friction, resistance and, for moments, an inertia.

    - `mass` [kg].
    - `inertia` [kg m²]: None, a tensor (3, 3) in the vehicle's axes, principal moments (3,), or a scalar. The vehicle's
      axes are the axes of the frame, rolled by the bank about the first axis. For an upright frame they point forward,
      left, and normal to the road.
    - `drag_area`: drag coefficient times frontal area, C_d·A [m²]; the drag at the speed v is ½ρC_dA v².
    - `rolling_resistance`: the coefficient C_rr [-]; the resistance is C_rr times the normal load. It is a moment on
      each wheel, so it contributes to the power, but not to the forces of the road on the tyres.
    - `friction` (2,): the coefficients of friction μ [-] along and across the vehicle, which are the semi-axes of the
      friction ellipse. One number applies to both. With the default 1, the path quantity `friction` is the coefficient
      of friction that the path requires.
    - `bank` [rad]: the rotation of the road about the direction of motion. It is 0 if the road is level in the lateral
      direction, and positive if the left side is lower, as in a banked left turn. By the right-hand rule this is a
      negative rotation about the forward axis. In the opposite direction of travel, the same road has the opposite
      bank.
    - `air_density` ρ [kg/m³].
    - `gravity` g [m/s²], along −z of the world.
    - `wheelbase` [m]: the distance of the axles, for the steering angle and its rate; None if it is not known.
    - `road`: a `Road`, whose bank and friction change along the way, instead of `bank` and `friction`, or which has
      another direction than the horizontal, as on a vertical loop.

    All fields except `road` are arrays, so a different vehicle does not cause a recompilation. Fields with a batch
    dimension, created by `jax.vmap`, represent one vehicle for each path of a batch.

    **Raises:** ValueError for a mass or friction that is not positive, a negative resistance, density or gravity, a
    bank of a right angle or more, a wheelbase that is not positive, an invalid inertia, or a bank or friction that the
    road defines, too.
    """

    mass: Number
    inertia: Float[Array, "*batch 3 3"] | None
    drag_area: Number
    rolling_resistance: Number
    friction: Float[Array, "*batch 2"]
    bank: Number
    air_density: Number
    gravity: Number
    wheelbase: Number | None
    road: Road | None

    def __init__(
        self,
        mass: ArrayInput,
        inertia: ArrayInput | None = None,
        drag_area: ArrayInput = 0.0,
        rolling_resistance: ArrayInput = 0.0,
        friction: ArrayInput = (1.0, 1.0),
        bank: ArrayInput = 0.0,
        air_density: ArrayInput = AIR_DENSITY,
        gravity: ArrayInput = GRAVITY,
        wheelbase: ArrayInput | None = None,
        road: Road | None = None,
    ):
        self.mass = scalar_field(mass, "mass", "kg")
        require_positive(self.mass, "the mass of a vehicle", "kg")
        with naming("vehicle: "):
            self.inertia = None if inertia is None else inertia_matrix(inertia)
        self.drag_area = not_negative_field(drag_area, "drag area", "m²")
        self.rolling_resistance = not_negative_field(rolling_resistance, "rolling resistance", "-")
        self.friction = friction_field(friction)
        self.bank = scalar_field(bank, "bank", "rad")
        value = concrete(self.bank)
        if value is not None and not np.all(np.abs(value) < MAX_BANK):
            raise ValueError(
                "the bank of a road must be between -pi/2 and pi/2 rad (3 degrees are 0.0524 rad), but "
                f"{value.tolist()} rad was given"
            )
        self.air_density = not_negative_field(air_density, "air density", "kg/m³")
        self.gravity = not_negative_field(gravity, "gravity", "m/s²")
        self.wheelbase = None if wheelbase is None else scalar_field(wheelbase, "wheelbase", "m")
        if self.wheelbase is not None:
            require_positive(self.wheelbase, "the wheelbase of a vehicle", "m")
        self.road = road
        if road is not None:
            require_road(road, self.bank, self.friction)

    def __repr__(self) -> str:
        units = {"mass": "kg", "inertia": "kg m²", "drag_area": "m²", "bank": "rad", "air_density": "kg/m³"}
        return shown(self, **units, gravity="m/s²", wheelbase="m")

    _repr_html_ = shown_html

    @property
    def on_changing_road(self) -> bool:
        """Whether bank, friction or side of the road change along the way."""
        return self.road is not None and not self.road.is_constant

    @property
    def has_left(self) -> bool:
        """Whether the road has a direction to the left, instead of being level in the lateral direction."""
        return self.road is not None and self.road.left is not None

    def parameters(self, dtype: Any = None, surface: Surface | None = None) -> RoadParameters:
        """Return the parameters of the formulas, (*batch) each, as NumPy arrays or, inside a trace, as JAX arrays.

        With the `surface` of the road at some distances, the parameters that depend on it have the shape of these.

        **Raises:** ValueError for a road that changes along the way, unless its `surface` is given.
        """
        surface = self._surface("this function") if surface is None else surface
        bank = self.bank if surface is None or surface.bank is None else surface.bank
        friction, side, axis = self.friction, 1.0 if surface is None else surface.side, ()
        fields = (self.mass, self.gravity, self.drag_area, self.air_density, self.rolling_resistance, bank)
        known = (*fields, friction, self.inertia, self.wheelbase)
        is_concrete = all(concrete(x) is not None for x in known if x is not None)
        module: Any = np if is_concrete else jnp
        dtype = self.mass.dtype if dtype is None else dtype
        mass, gravity, area, density, rolling, bank = (module.asarray(x, dtype) for x in fields)
        inverse = 1 / module.asarray(friction, dtype)
        drag = 0.5 * density * area / mass
        cos, sin = module.cos(bank), module.sin(bank)
        about_tangent = about_binormal = module.zeros_like(mass)
        if self.inertia is not None and not bank.ndim > mass.ndim:
            inertia = inertia_in_frame(module.asarray(self.inertia, dtype), cos, sin, module)
            about_tangent, about_binormal = principal_moments(inertia, module)
        along, across = inverse[..., 0], inverse[..., 1]
        if surface is not None:
            side = module.asarray(side, dtype)
            cos, sin = side * cos, side * sin
            if surface.left is not None:
                cos, sin, axis = about_left(cos, sin, module.asarray(surface.left, dtype), module)
            if surface.along is not None:
                along, across = (1 / module.asarray(x, dtype) for x in (surface.along, surface.across))
        wheelbase = module.zeros_like(mass) if self.wheelbase is None else module.asarray(self.wheelbase, dtype)
        moments = about_tangent, about_binormal
        return RoadParameters(mass, gravity, drag, rolling, cos, sin, along, across, *moments, wheelbase, *axis)

    def inertia_in_frame(self) -> Float[Array, "*batch 3 3"]:
        """Return the inertia tensor in the axes of the frame, in which the bank rolls the vehicle about the first axis.

        **Raises:** ValueError for a vehicle without inertia, and for a bank that changes along the way.
        """
        inertia: Any = require_inertia(self, "the inertia in the axes of the frame").inertia
        surface = self._surface("a moment")
        bank = self.bank.astype(inertia.dtype) if surface is None or surface.bank is None else surface.bank
        return inertia_in_frame(inertia, xp.cos(bank), xp.sin(bank), xp)

    def _surface(self, what: str) -> Surface | None:
        """Return the surface of a road that is the same everywhere, or None without a road."""
        if self.road is None:
            return None
        if not self.road.is_constant:
            raise ValueError(
                f"the road of the vehicle changes along the way, which {what} does not support: pass a vehicle with a "
                "constant bank and friction, or use certify, retime or evaluate with outputs other than moments"
            )
        return self.road.at(np.zeros(()))


def fixed_parameters(vehicle: Vehicle | None, dtype: Any = None, strict: bool = False) -> RoadParameters:
    """Return the parameters of the vehicle, or default ones for None; those that change along the way are NaN.

    **Raises:** ValueError for a road that changes along the way, if `strict`.
    """
    if vehicle is None or strict or not vehicle.on_changing_road:
        return NO_VEHICLE if vehicle is None else vehicle.parameters(dtype)
    road: Any = vehicle.road
    start, nan = road.at(np.zeros(())), np.full((), np.nan)
    same = [x is None or len(set(x)) == 1 for x in (road.bank, road.friction, road.friction, road.inverted, road.left)]
    left = None if road.left is None else start.left if same[-1] else np.full(3, np.nan)
    known = [x if keeps else nan for x, keeps in zip(start[:4], same[:4], strict=True)]
    return vehicle.parameters(dtype, Surface(*known)._replace(left=left))


def require_vehicle(vehicle: Vehicle | None, what: str) -> Vehicle:
    """Return the vehicle, or raise an error if there is none.

    **Raises:** ValueError if `vehicle` is not a Vehicle; the message says that `what` needs one.
    """
    if not isinstance(vehicle, Vehicle):
        given = "none was given" if vehicle is None else f"{vehicle!r} was given"
        raise ValueError(f"{what} needs a vehicle, but {given}: pass vehicle=Vehicle(mass=...)")
    return vehicle


def require_inertia(vehicle: Vehicle | None, what: str) -> Vehicle:
    """Return the vehicle, or raise an error if it has no inertia.

    **Raises:** ValueError if there is no vehicle or no inertia; the message says that `what` needs it.
    """
    vehicle = require_vehicle(vehicle, what)
    if vehicle.inertia is None:
        raise ValueError(f"{what} needs an inertia: pass vehicle=Vehicle(mass=..., inertia=...)")
    return vehicle


def require_wheelbase(vehicle: Vehicle | None, what: str) -> Vehicle:
    """Return the vehicle, or raise an error if it has no wheelbase.

    **Raises:** ValueError if there is no vehicle or no wheelbase; the message says that `what` needs it.
    """
    if vehicle is None or (isinstance(vehicle, Vehicle) and vehicle.wheelbase is None):
        raise ValueError(f"{what} needs a wheelbase: pass vehicle=Vehicle(mass=..., wheelbase=...)")
    return require_vehicle(vehicle, what)


def require_principal_inertia(vehicle: Vehicle | None, what: str) -> Vehicle:
    """Return the vehicle, or raise an error if it has no inertia with principal axes along τ, n and b.

    **Raises:** ValueError if there is no vehicle, no inertia, or an inertia with other principal axes; the message says
    that `what` needs an inertia with these principal axes.
    """
    vehicle = require_inertia(vehicle, what)
    if has_principal_inertia(vehicle):
        return vehicle
    given = np.asarray(concrete(vehicle.inertia)).reshape(-1, 3, 3)
    diagonal = np.all(given == given * np.eye(3), axis=(1, 2))
    reason = "a bank that is not zero rotates its principal axes" if np.all(diagonal) else "it has products of inertia"
    raise ValueError(
        f"{what} needs an inertia whose principal axes are τ, n and b, but {given[np.argmin(diagonal)].tolist()} kg m² "
        f"was given: {reason}. The output 'moment' of evaluate accepts any inertia and bank."
    )


def has_principal_inertia(vehicle: Vehicle | None) -> bool:
    """Return whether the vehicle has an inertia with principal axes along τ, n and b; true for a traced inertia."""
    if vehicle is None or vehicle.inertia is None:
        return False
    known = concrete(fixed_parameters(vehicle).inertia_tangent)
    return known is None or not np.any(np.isnan(known))


REQUIREMENTS = {
    VEHICLE: require_vehicle,
    PARAMETERS: require_vehicle,
    INERTIA: require_inertia,
    PRINCIPAL: require_principal_inertia,
    WHEELBASE: require_wheelbase,
}


def require(vehicle: Vehicle | None, needs: str, what: str) -> Vehicle | None:
    """Return the vehicle, or raise an error if it does not satisfy the value `needs` of the quantity named `what`.

    **Raises:** ValueError, see the functions in `REQUIREMENTS`.
    """
    return REQUIREMENTS[needs](vehicle, what) if needs else vehicle
