"""Define the load factor, the tilt and the bank angle, as entries of the registry of quantities.

The specific force is f = r'' + g·up, with gravity g: what an accelerometer measures. With the horizontal acceleration
of the square Q and the vertical acceleration W, its upward component is u = W + g, and |f|² = Q + u². The tilt is the
angle from the vertical to f. In a coordinated turn the vehicle is banked until f has no component to its side: the bank
angle is the angle of f in the plane of the axes y (left) and z (up) of the upright frame, from z.

With the components c and s of a vector along and across an axis, tan(angle/2) = s/(√(c² + s²) + c), and its square is
(√(c² + s²) − c)/(√(c² + s²) + c). These formulas apply to all angles below a half turn.
"""

from typing import Any

from qtraj.foundation.namespace import xp
from qtraj.path.frenet import safe_root
from qtraj.path.path_quantity import FORCE, UPRIGHT_FORCE, Component, PathQuantity, ratio, squared


def _upwards(i: Any) -> Any:
    """Return the upward component of the specific force."""
    return i.W + i.gravity


def _square(i: Any) -> Any:
    """Return the square of the specific force."""
    return i.Q + squared(_upwards(i))


def _gravity_square(i: Any) -> Any:
    return i.gravity * i.gravity


def _tilt(i: Any) -> Any:
    return xp.arctan2(safe_root(i.Q), _upwards(i))


def _across(i: Any) -> Any:
    """Return v√H times the component of the specific force to the left."""
    return i.P * i.v


def bank_divisor(i: Any) -> tuple[Any, Any]:
    """Return v√H times |f| + f·z and 2|f|, with the components of the specific force f in the plane of y and z."""
    norm = _norm(i)
    return norm + i.upward_force, 2 * norm


def force_divisor(i: Any) -> tuple[Any, Any]:
    """Return the square of the specific force, and the largest square for this acceleration."""
    return _square(i), 2 * (i.Q + squared(i.W) + _gravity_square(i))


def _norm(i: Any) -> Any:
    """Return v√H times the norm of the components of the specific force to the left and up."""
    return i.root(squared(i.P) * i.S + squared(i.upward_force))


def _bank_angle(i: Any) -> Any:
    across, upwards = _across(i), i.upward_force
    somewhere = (across != 0) | (upwards != 0)  # the angle of a zero vector has no derivative
    return xp.where(somewhere, xp.arctan2(across, xp.where(somewhere, upwards, 1.0)), 0.0)


GRAVITY_QUANTITIES = (
    PathQuantity(
        "load_factor",
        "|f|/g",
        "1",
        2,
        "load factor: the specific force |r'' + g·up| in units of gravity; 1 in straight, level, steady motion",
        numerator=_square,
        denominator=_gravity_square,
        square=lambda i: ratio(_square(i), _gravity_square(i) + 0.0 * i.W),
        upright=True,
        bounds_speed=True,
        gravity=True,
    ),
    PathQuantity(
        "tilt",
        "θ",
        "rad",
        2,
        "angle from the vertical to the specific force r'' + g·up",
        numerator=lambda i: i.root(_square(i)) - _upwards(i),
        denominator=lambda i: i.root(_square(i)) + _upwards(i),
        square=lambda i: squared(_tilt(i)),
        divisor=FORCE,
        upright=True,
        gravity=True,
        tangent_of=2,
    ),
    PathQuantity(
        "bank_angle",
        "|β|",
        "rad",
        2,
        "magnitude of the bank angle of a coordinated turn, across the path",
        numerator=lambda i: _norm(i) - i.upward_force,
        denominator=lambda i: _norm(i) + i.upward_force,
        square=lambda i: squared(_bank_angle(i)),
        divisor="level",
        upright=True,
        gravity=True,
        output="bank_angle_magnitude",
        tangent_of=2,
        component=Component(
            "bank angle of a coordinated turn, across the path; positive in left turns",
            numerator=_across,
            denominator=lambda i: _norm(i) + i.upward_force,
            value=_bank_angle,
            divisor=UPRIGHT_FORCE,  # opposite to up, the angle is a half turn, and its sign is arbitrary
        ),
    ),
)
"""The quantities that contain gravity but need no vehicle, in the order in which they are displayed."""
