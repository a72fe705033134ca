"""The forces, the use of the grip and the power of a vehicle along a path, as entries of the registry of quantities."""

from typing import Any

import jax.numpy as jnp

from qtraj.path import contact
from qtraj.path.path_quantity import LOAD, Division, PathQuantity, inverse_root, ratio, squared


def _friction_square(i: Any, by: Division) -> Any:
    """Infinite where the vehicle does not press on the road."""
    load = i.onto
    return jnp.where(
        load < 0, jnp.inf, ratio(contact.friction_numerator(i), squared(jnp.where(load < 0, 1.0, load)), by)
    )


def _normal_load(i: Any, by: Division) -> Any:
    return i.vehicle.mass * (i.onto * (inverse_root(i.S, by) * inverse_root(i.H, by)))


def _power(i: Any, by: Division) -> Any:
    p = i.vehicle
    return i.pace * (p.mass * (i.along + p.rolling * (i.onto * inverse_root(i.H, by))))


ROAD_QUANTITIES = (
    PathQuantity(
        "longitudinal_force",
        "|F_τ|",
        "N",
        2,
        "magnitude of the force of drive or brakes along the path, against inertia, gravity and drag",
        numerator=lambda i: i.vehicle.mass * (i.vehicle.mass * squared(i.along)),
        denominator=lambda i: i.S,
        divisor="speed",
        upright=True,
        needs_vehicle=True,
    ),
    PathQuantity(
        "lateral_force",
        "|F_n|",
        "N",
        2,
        "magnitude of the force across the path in the plane of the road",
        numerator=lambda i: i.vehicle.mass * (i.vehicle.mass * squared(i.across)),
        denominator=lambda i: i.S * i.H,
        divisor="level",
        upright=True,
        bounds_speed=True,
        needs_vehicle=True,
    ),
    PathQuantity(
        "normal_load",
        "F_b",
        "N",
        2,
        "force of the road on the vehicle, normal to the road; negative where it would have to pull",
        numerator=lambda i: i.vehicle.mass * i.onto,
        denominator=lambda i: i.v * i.h,
        divisor="level",
        upright=True,
        signed=_normal_load,
        needs_vehicle=True,
    ),
    PathQuantity(
        "friction",
        "μ/μ_max",
        "1",
        2,
        "use of the grip by the friction ellipse: 1 where the tyres begin to slide",
        numerator=contact.friction_numerator,
        denominator=lambda i: squared(i.onto),
        square=_friction_square,
        divisor=LOAD,
        upright=True,
        bounds_speed=True,
        needs_vehicle=True,
    ),
    PathQuantity(
        "power",
        "P",
        "W",
        2,
        "power of the drive, against inertia, gravity, drag and rolling resistance; negative while braking",
        numerator=contact.power_numerator,
        denominator=lambda i: i.h,
        divisor="level",
        upright=True,
        signed=_power,
        needs_vehicle=True,
    ),
)
"""The quantities that need a vehicle, in the order in which they are displayed."""
