"""The parameters of a vehicle and of the road under it, for forces, friction and power along a path."""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra.inertia import inertia_matrix
from qtraj.foundation.arrays import as_float, concrete, require_positive
from qtraj.foundation.document import storable
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput

GRAVITY, AIR_DENSITY = 9.80665, 1.225
"""Standard gravity [m/s²], and the density of air at sea level in the International Standard Atmosphere [kg/m³]."""

MAX_BANK = np.pi / 2

Number = Float[Array, "*batch"]


class RoadParameters(NamedTuple):
    """What the formulas of `contact` use, in any type of numbers.

    `drag` is ½ρC_dA/m [1/m]: the deceleration by the air is drag·v². `cos` and `sin` are those of the bank angle,
    `inv_long` and `inv_lat` the inverses of the coefficients of friction.
    """

    mass: Any
    gravity: Any
    drag: Any
    rolling: Any
    cos: Any
    sin: Any
    inv_long: Any
    inv_lat: Any


NO_VEHICLE = RoadParameters(1.0, GRAVITY, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0)
"""Numbers in place of those of a vehicle, where nothing depends on it."""


@storable
class Vehicle(eqx.Module):
    """A vehicle on a road: a point mass with the grip of its tyres, resistance and, for moments, an inertia.

    - `mass` [kg].
    - `inertia`: None, or the tensor (3, 3) in the vehicle's axes [kg m²]; a scalar or (3,) principal moments also do.
    - `drag_area`: drag coefficient times frontal area, C_d·A [m²]; the drag is ½ρC_dA v².
    - `rolling_resistance`: the coefficient C_rr [-]; the resistance is C_rr times the normal load.
    - `friction` (2,): the coefficients of friction μ along and across the vehicle [-], the semi-axes of the friction
      ellipse; one number stands for both. With the default 1 the use of the grip is the friction that the road needs.
    - `bank` [rad]: the angle by which the road is rolled about the direction of motion, from level across; positive
      where it leans to the left, as in a left turn.
    - `air_density` ρ [kg/m³], `gravity` g [m/s²], along −z.

    All numbers are data: other vehicles do not recompile anything. Fields with a batch dimension, as from `jax.vmap`,
    are one vehicle for each path of a batch.

    **Raises:** ValueError for a mass or friction that is not positive, a negative resistance, density or gravity, a
    bank of a right angle or more, or an invalid inertia.
    """

    mass: Number
    inertia: Float[Array, "*batch 3 3"] | None
    drag_area: Number
    rolling_resistance: Number
    friction: Float[Array, "*batch 2"]
    bank: Number
    air_density: Number
    gravity: Number

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
    ):
        self.mass = _scalar(mass, "mass", "kg")
        require_positive(self.mass, "the mass of a vehicle", "kg")
        self.inertia = None if inertia is None else inertia_matrix(inertia)
        self.drag_area = _not_negative(drag_area, "drag area", "m²")
        self.rolling_resistance = _not_negative(rolling_resistance, "rolling resistance", "-")
        self.friction = _friction(friction)
        self.bank = _scalar(bank, "bank", "rad")
        value = concrete(self.bank)
        if value is not None and not np.all(np.abs(value) < MAX_BANK):
            raise ValueError(f"the bank of a road must be less than a right angle, but {value.tolist()} rad was given")
        self.air_density = _not_negative(air_density, "air density", "kg/m³")
        self.gravity = _not_negative(gravity, "gravity", "m/s²")

    def __repr__(self) -> str:
        return shown(self, mass="kg", inertia="kg m²", drag_area="m²", bank="rad", air_density="kg/m³", gravity="m/s²")

    def parameters(self, dtype: Any = None) -> RoadParameters:
        """The numbers that the formulas use, (*batch) each: NumPy arrays where the fields are known."""
        fields = (self.mass, self.gravity, self.drag_area, self.air_density, self.rolling_resistance, self.bank)
        is_concrete = all(concrete(x) is not None for x in (*fields, self.friction))
        xp: Any = np if is_concrete else jnp
        dtype = self.mass.dtype if dtype is None else dtype
        mass, gravity, area, density, rolling, bank = (xp.asarray(x, dtype) for x in fields)
        inverse = 1 / xp.asarray(self.friction, dtype)
        drag = 0.5 * density * area / mass
        return RoadParameters(
            mass, gravity, drag, rolling, xp.cos(bank), xp.sin(bank), inverse[..., 0], inverse[..., 1]
        )


def require_vehicle(vehicle: Vehicle | None, what: str) -> Vehicle:
    """The vehicle.

    **Raises:** ValueError, saying `what` needs it, if there is none.
    """
    if not isinstance(vehicle, Vehicle):
        given = "none was given" if vehicle is None else f"{vehicle!r} was given"
        raise ValueError(f"{what} needs a vehicle, but {given}: pass vehicle=Vehicle(mass=...)")
    return vehicle


def _scalar(value: ArrayInput, name: str, unit: str) -> Array:
    try:
        number = as_float(value)
    except (TypeError, ValueError) as error:
        raise ValueError(f"the {name} of a vehicle must be a number [{unit}], but {value!r} was given") from error
    if number.ndim != 0:
        raise ValueError(
            f"the {name} of a vehicle must be one number, but an array of shape {number.shape} was given; "
            "jax.vmap makes many vehicles"
        )
    if not np.all(np.isfinite(0.0 if (known := concrete(number)) is None else known)):
        raise ValueError(f"the {name} of a vehicle must be finite [{unit}], but {value!r} was given")
    return number


def _not_negative(value: ArrayInput, name: str, unit: str) -> Array:
    number = _scalar(value, name, unit)
    known = concrete(number)
    if known is not None and np.any(known < 0):
        raise ValueError(f"the {name} of a vehicle must not be negative [{unit}], but {known.tolist()} was given")
    return number


def _friction(value: ArrayInput) -> Array:
    try:
        friction = as_float(value)
    except (TypeError, ValueError) as error:
        raise ValueError(f"the friction of a vehicle must be one or two numbers, but {value!r} was given") from error
    if friction.shape not in ((), (2,)):
        raise ValueError(
            "the friction of a vehicle must be one number or two, along and across, but an array of shape "
            f"{friction.shape} was given"
        )
    require_positive(friction, "the friction of a vehicle", "-")
    return jnp.broadcast_to(friction, (2,)) if friction.ndim == 0 else friction
