"""Define forces, friction demand and power of a vehicle along a path, as entries of the registry of quantities."""

from typing import Any

from qtraj.algebra.cpu import inverse_root
from qtraj.foundation.namespace import xp
from qtraj.path import contact
from qtraj.path.path_quantity import LOAD, ROAD_FRAME, VEHICLE, Component, PathQuantity, ratio, squared


def _friction_square(i: Any) -> Any:
    """Return the square of the friction demand.

    It is infinite where the normal load is negative, or is zero although a force acts in the plane of the road.
    """
    load = i.contact.onto
    # Where the frame of the road is undefined, as on a vertical path, the load is zero, so any force along the path
    # makes the friction demand infinite.
    numerator = xp.where(i.contact.level_square > 0, contact.friction_numerator(i), squared(i.contact.along))
    return xp.where(load < 0, xp.inf, ratio(numerator, squared(xp.where(load < 0, 1.0, load))))


def _normal_load(i: Any) -> Any:
    return i.vehicle.mass * (i.contact.onto * (inverse_root(i.S) * _inverse_level(i)))


def _inverse_level(i: Any) -> Any:
    return inverse_root(i.contact.level_square)


def _power(i: Any) -> Any:
    p = i.vehicle
    return i.pace * (p.mass * (i.contact.along + p.rolling * (i.contact.onto * _inverse_level(i))))


ROAD_QUANTITIES = (
    PathQuantity(
        "longitudinal_force",
        "|F_τ|",
        "N",
        2,
        "magnitude of the net force of the road on the tyres along the path, against inertia, gravity and drag",
        numerator=lambda i: i.vehicle.mass * (i.vehicle.mass * squared(i.contact.along)),
        denominator=lambda i: i.S,
        divisor="speed",
        upright=True,
        needs=VEHICLE,
        gravity=True,
        output="longitudinal_force_magnitude",
        component=Component(
            "net force of the road on the tyres along the path, against inertia, gravity and drag; negative while "
            "braking",
            numerator=lambda i: i.vehicle.mass * i.contact.along,
            denominator=lambda i: i.v,
            value=lambda i: i.vehicle.mass * (i.contact.along * inverse_root(i.S)),
        ),
    ),
    PathQuantity(
        "lateral_force",
        "|F_n|",
        "N",
        2,
        "magnitude of the lateral force in the plane of the road",
        numerator=lambda i: i.vehicle.mass * (i.vehicle.mass * squared(i.contact.across)),
        denominator=lambda i: i.S * i.contact.level_square,
        divisor=ROAD_FRAME,
        upright=True,
        bounds_speed=True,
        needs=VEHICLE,
        gravity=True,
        output="lateral_force_magnitude",
        component=Component(
            "lateral force in the plane of the road; positive to the left",
            numerator=lambda i: i.vehicle.mass * i.contact.across,
            denominator=lambda i: i.v * i.contact.level,
            value=lambda i: i.vehicle.mass * (i.contact.across * (inverse_root(i.S) * _inverse_level(i))),
        ),
    ),
    PathQuantity(
        "normal_load",
        "F_b",
        "N",
        2,
        "force of the road on the vehicle, normal to the road; negative where the road would have to pull",
        numerator=lambda i: i.vehicle.mass * i.contact.onto,
        denominator=lambda i: i.v * i.contact.level,
        divisor=ROAD_FRAME,
        upright=True,
        signed=_normal_load,
        needs=VEHICLE,
        gravity=True,
    ),
    PathQuantity(
        "friction",
        "μ/μ_max",
        "1",
        2,
        "friction demand relative to the friction ellipse; 1 where the tyres begin to slide",
        numerator=contact.friction_numerator,
        denominator=lambda i: squared(i.contact.onto),
        square=_friction_square,
        divisor=LOAD,
        infinite=lambda i: i.contact.onto < 0,
        upright=True,
        bounds_speed=True,
        needs=VEHICLE,
        gravity=True,
    ),
    PathQuantity(
        "power",
        "P",
        "W",
        2,
        "drive power, against inertia, gravity, drag and rolling resistance; negative while braking",
        numerator=contact.power_numerator,
        denominator=lambda i: i.contact.level,
        divisor=ROAD_FRAME,
        upright=True,
        signed=_power,
        needs=VEHICLE,
        gravity=True,
    ),
)
"""The quantities that need a vehicle on a road, in the order in which they are displayed."""

FORCES = tuple(entry.name for entry in ROAD_QUANTITIES)
"""The names of `ROAD_QUANTITIES`."""
