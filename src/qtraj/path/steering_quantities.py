"""Define the steering angle and its rate, as entries of the registry of quantities.

In the kinematic single-track model, a vehicle with the wheelbase L follows a path of the horizontal curvature κ if its
front wheels have the steering angle δ = atan(Lκ). With the invariants of `frenet`, κ = P/√H³ and its derivative is
κ' = K/√H⁵, K = P'H − 3PG. So δ' = Lκ'/(1 + L²κ²) = LK√H/(H³ + L²P²).
"""

from typing import Any

from qtraj.algebra.cpu import inverse_root
from qtraj.foundation.namespace import xp
from qtraj.path.motion_quantities import curvature_growth
from qtraj.path.path_quantity import WHEELBASE, Component, PathQuantity, cubed, squared


def _bend(i: Any) -> Any:
    """Return √H³ times the tangent Lκ of the steering angle."""
    return i.vehicle.wheelbase * i.P


def _steering_angle(i: Any) -> Any:
    return xp.arctan(_bend(i) * inverse_root(i.H) ** 3)


def _steering_rate(i: Any) -> Any:
    inv_level = inverse_root(i.H)
    rate = i.vehicle.wheelbase * (curvature_growth(i) * inv_level**5)
    return rate / (1 + squared(_bend(i) * inv_level**3))


def _growth(i: Any) -> Any:
    """Return LK, with the symbols of this module."""
    return i.vehicle.wheelbase * curvature_growth(i)


def _divisor(i: Any) -> Any:
    """Return H³ + L²P², with the symbols of this module."""
    return cubed(i.H) + squared(_bend(i))


STEERING_QUANTITIES = (
    PathQuantity(
        "steering_angle",
        "|δ|",
        "rad",
        2,
        "magnitude of the steering angle of a vehicle with this wheelbase",
        numerator=lambda i: squared(_bend(i)),
        denominator=lambda i: cubed(i.H),
        square=lambda i: squared(_steering_angle(i)),
        divisor="level",
        upright=True,
        needs=WHEELBASE,
        output="steering_angle_magnitude",
        tangent_of=1,
        component=Component(
            "steering angle of a vehicle with this wheelbase; positive in left turns",
            numerator=_bend,
            denominator=lambda i: i.H * i.h,
            value=_steering_angle,
        ),
    ),
    PathQuantity(
        "steering_rate",
        "|δ̇|",
        "rad s-1",
        3,
        "magnitude of the rate of the steering angle",
        numerator=lambda i: squared(_growth(i)) * i.H,
        denominator=lambda i: squared(_divisor(i)),
        square=lambda i: squared(_steering_rate(i)),
        divisor="level",
        upright=True,
        needs=WHEELBASE,
        output="steering_rate_magnitude",
        component=Component(
            "rate of the steering angle; positive to the left",
            numerator=lambda i: _growth(i) * i.h,
            denominator=_divisor,
            value=_steering_rate,
        ),
    ),
)
"""The quantities that need a wheelbase, in the order in which they are displayed."""
