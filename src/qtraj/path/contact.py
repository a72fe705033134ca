"""Compute the forces between a vehicle and the road: tangential, lateral and normal (paper S, conclusions).

Let r' and r'' be the derivatives of the path, and `up` the unit vertical. The direction of motion τ is tangential to
the road. Without bank the road is level in the lateral direction. Then n = up×r'/√H, with H = |up×r'|², points to the
left, and b = τ×n points upwards. These are the axes of the upright frame. A bank β rotates n and b about τ. Let m be
the mass, g gravity, v = |r'| the speed, and m·k·v² the air drag. The force of the road on the vehicle is m·f, with the
specific force f = r'' + g·plumb, plus the drag along τ; `plumb` is opposite to gravity and equal to `up`, unless the
road has another axis: on a vertical loop, `up` is the vector to the left, n is then normal to the road and points down,
b is to the left, and β is less by a right angle (see `RoadParameters`). The components of the force are

        tangential:  X = m(f·τ + k v²),   lateral: Y = m(cos β f·n − sin β f·b),   normal: Z = m(cos β f·b + sin β f·n).

`Contact` computes X, Y and Z divided by the mass and multiplied by a factor that removes the denominators of τ, n and
b: v for X, and v√H for Y and Z. The results are polynomials in v and in the derivatives of the path. At a stop of the
path, `derivatives[1]` may be any vector in the direction of motion; the velocity is `pace` times this vector.

X is the net tangential force of the road on all tyres. Rolling resistance is a moment on each wheel. If all wheels are
driven, the drive torque balances this moment without using grip: the drive torque divided by the wheel radius is X +
C_rr·Z, with the coefficient of rolling resistance C_rr (Gillespie, Fundamentals of Vehicle Dynamics, chapter 4).
Rolling resistance then contributes to the power, but not to the friction demand.
"""

from functools import cached_property
from typing import Any

from qtraj.algebra.sparse import mul


class Contact:
    """The forces between a vehicle and the road, for invariants of any numeric type.

    Each force is computed at its first use. It is a function of the `frenet.Invariants` S, H, B, P, V, W, v = √S and h
    = √H, the `gravity`, the `pace`, and the parameters of the `vehicle`.
    """

    def __init__(self, invariants: Any):
        self.invariants = invariants

    @cached_property
    def along(self) -> Any:
        """The scaled tangential force X·v/m = r'·f + k·pace²·v³, with the symbols of this module."""
        i = self.invariants
        return i.B + i.gravity * i.plumb_ahead + i.vehicle.drag * mul(mul(i.pace, i.pace), i.S * i.v)

    @cached_property
    def across(self) -> Any:
        """The scaled lateral force Y·v√H/m, positive to the left, with the symbols of this module."""
        i = self.invariants
        return i.vehicle.cos * self.aside - i.vehicle.sin * i.upward_force

    @cached_property
    def onto(self) -> Any:
        """The scaled normal force Z·v√H/m, positive if the road pushes the vehicle, with the symbols of this module."""
        i = self.invariants
        return i.vehicle.cos * i.upward_force + i.vehicle.sin * self.aside

    @cached_property
    def aside(self) -> Any:
        """The scaled component of the specific force along n, (f·n)·v√H, with n√H = up×r'."""
        i = self.invariants
        return (i.P if i.plumb is None else i.P + i.gravity * i.plumb_aside) * i.v

    @property
    def level_square(self) -> Any:
        """H, which is zero where the frame of the road is undefined."""
        return self.invariants.H

    @property
    def level(self) -> Any:
        """√H, which is zero where the frame of the road is undefined."""
        return self.invariants.h


def upward_force(i: Any) -> Any:
    """Return the scaled component of the specific force along b, (f·b)·v√H, with the symbols of this module.

    The factor removes the root: b·v√H = S·up − V·r', with S = r'·r' and the climb rate V = r'·up.
    """
    return i.S * i.W - i.V * i.B + i.gravity * i.plumb_above


def friction_numerator(i: Any) -> Any:
    """Return ((X/μ_along)² + (Y/μ_across)²)·v²H/m², the numerator of the squared friction demand.

    μ_along and μ_across are the coefficients of friction; the module defines the other symbols.
    """
    p, x, y = i.vehicle, i.contact.along, i.contact.across
    return p.inv_long * (p.inv_long * (x * x * i.contact.level_square)) + p.inv_lat * (p.inv_lat * (y * y))


def power_numerator(i: Any) -> Any:
    """Return (X + C_rr·Z)·pace·v·√H, the drive power times √H, with the symbols of this module."""
    p = i.vehicle
    return mul(i.pace, p.mass * (i.contact.along * i.contact.level + p.rolling * i.contact.onto))
