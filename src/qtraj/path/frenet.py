"""Frenet formulas: scalar products of the derivatives of a path, and the rates of its frames.

These formulas are defined only in this module. They apply to every type of vector that `components.dot` and
`components.cross` accept: vectors (3,), triples of arrays over many instants, and polynomials. The derivatives may be
given in any orthonormal basis. Formulas with the vertical use `up`, or the third axis by default. Forces on a road with
another axis than the vertical use this axis as `up`, and only gravity is vertical.
"""

from collections.abc import Callable
from fractions import Fraction
from functools import cached_property
from typing import Any

from qtraj.foundation.namespace import xp
from qtraj.path.components import cross, dot
from qtraj.path.contact import Contact, upward_force
from qtraj.path.road_parameters import GRAVITY


def safe_root(x: Any) -> Any:
    """Return √x, with derivative 0 where x is 0."""
    zero = x <= 0
    return xp.where(zero, 0.0, xp.sqrt(xp.where(zero, 1.0, x)))


class Invariants:
    """Scalar products of r', r'', r''' and r'''' (paper S), each computed at its first use.

    Let c = r'×r''; its derivative is c' = r'×r'''. With S = r'·r', N = c·c and T = c·r''', the speed is √S, the
    curvature is √(N/S³), and the torsion is T/N. The formulas with the vertical contain the climb rate V = r'·up, the
    squared horizontal speed H, and P = c·up.
    """

    def __init__(
        self,
        derivatives: Any,
        up: Any = None,
        vehicle: Any = None,
        root: Callable[[Any], Any] = safe_root,
        pace: Any = 1,
        plumb: Any = None,
    ):
        """Store the derivatives; `derivatives[k]` is the k-th derivative of the path.

        `derivatives[0]` is the position, or None if no formula contains it. `up` is the vertical, by default the third
        axis. `vehicle` contains the `RoadParameters` for quantities that need them, and `root` computes the square root
        of a number. If `derivatives[1]` has only the direction of the velocity, `pace` is the velocity divided by
        `derivatives[1]`. `plumb` is opposite to gravity, if `up` is not.
        """
        self.r, self.up, self.plumb = derivatives, up, plumb
        self.vehicle, self.root, self.pace = vehicle, root, pace
        self.references: Any = None  # the squares to which S and N are compared (`regularity`), computed once

    @property
    def gravity(self) -> Any:
        """Gravity g [m/s²], of the vehicle if there is one, otherwise standard gravity."""
        return GRAVITY if self.vehicle is None else self.vehicle.gravity

    def number(self, x: Fraction) -> Any:
        """Return a rational number in the arithmetic of the formulas."""
        return float(x)

    @cached_property
    def v(self) -> Any:
        """The speed v = |r'|."""
        return self.root(self.S)

    @cached_property
    def h(self) -> Any:
        """The horizontal speed h, the norm of the horizontal component of r'."""
        return self.root(self.H)

    @cached_property
    def on_road(self) -> "Invariants":
        """The invariants about the axis of the road: about `up`, unless the road has another axis.

        The derivatives of a path on a road with another axis must be in world axes.
        """
        axis = None if self.vehicle is None else self.vehicle.axis
        if axis is None:
            return self
        return Invariants(self.r, axis, self.vehicle, self.root, self.pace, (0, 0, 1))

    @cached_property
    def contact(self) -> Contact:
        """The forces between the vehicle and the road."""
        return Contact(self.on_road)

    @cached_property
    def plumb_ahead(self) -> Any:
        """The component of r' opposite to gravity; the climb rate V if `up` is opposite to gravity."""
        return self.V if self.plumb is None else dot(self.r[1], self.plumb)

    @cached_property
    def plumb_aside(self) -> Any:
        """The component of up×r' opposite to gravity; 0 if `up` is opposite to gravity."""
        return 0 if self.plumb is None else dot(cross(self.up, self.r[1]), self.plumb)

    @cached_property
    def plumb_above(self) -> Any:
        """The component of S·up − V·r' opposite to gravity; H if `up` is opposite to gravity."""
        return self.H if self.plumb is None else self.S * dot(self.up, self.plumb) - self.V * self.plumb_ahead

    @cached_property
    def c(self) -> Any:
        """The cross product r'×r''."""
        return cross(self.r[1], self.r[2])

    @cached_property
    def c1(self) -> Any:
        """The cross product c' = r'×r'''."""
        return cross(self.r[1], self.r[3])

    @cached_property
    def S(self) -> Any:
        """The squared speed r'·r'."""
        return dot(self.r[1], self.r[1])

    @cached_property
    def A(self) -> Any:
        """The squared acceleration r''·r''."""
        return dot(self.r[2], self.r[2])

    @cached_property
    def J(self) -> Any:
        """The squared jerk r'''·r'''."""
        return dot(self.r[3], self.r[3])

    @cached_property
    def B(self) -> Any:
        """The scalar product r'·r'', half the derivative of S = r'·r'."""
        return dot(self.r[1], self.r[2])

    @cached_property
    def C(self) -> Any:
        """The scalar product r'·r''', which equals (r'·r'')' − r''·r''."""
        return dot(self.r[1], self.r[3])

    @cached_property
    def N(self) -> Any:
        """The squared norm of the cross product c = r'×r''."""
        return dot(self.c, self.c)

    @cached_property
    def T(self) -> Any:
        """The triple product c·r''', with c = r'×r''."""
        return dot(self.c, self.r[3])

    @cached_property
    def E(self) -> Any:
        """The scalar product c·c', with c = r'×r''; it is half the derivative of N = c·c."""
        return dot(self.c, self.c1)

    @cached_property
    def D(self) -> Any:
        """The scalar product c·r'''', with c = r'×r''; it is the derivative of T = c·r'''."""
        return dot(self.c, self.r[4])

    @cached_property
    def Z(self) -> Any:
        """The height, the vertical component of the position."""
        return self.vertical(self.r[0])

    @cached_property
    def V(self) -> Any:
        """The climb rate r'·up."""
        return self.vertical(self.r[1])

    @cached_property
    def W(self) -> Any:
        """The vertical acceleration r''·up, the derivative of the climb rate."""
        return self.vertical(self.r[2])

    @cached_property
    def Q(self) -> Any:
        """The squared horizontal acceleration, that is, the squared norm of the horizontal component of r''."""
        return self.level_square(self.r[2])

    @cached_property
    def X(self) -> Any:
        """The vertical jerk r'''·up, the derivative of the vertical acceleration."""
        return self.vertical(self.r[3])

    @cached_property
    def H(self) -> Any:
        """The squared horizontal speed, that is, the squared norm of the horizontal component of r'."""
        return self.level_square(self.r[1])

    @cached_property
    def G(self) -> Any:
        """The scalar product of the horizontal components of r' and r'', half the derivative of H.

        H is the squared horizontal speed.
        """
        return dot(self._level(self.r[1]), self._level(self.r[2]))

    @cached_property
    def P(self) -> Any:
        """The vertical component of the cross product c = r'×r''."""
        return self.vertical(self.c)

    @cached_property
    def P1(self) -> Any:
        """The vertical component of c' = r'×r''', the derivative of P = (r'×r'')·up."""
        return self.vertical(self.c1)

    @cached_property
    def upward_force(self) -> Any:
        """The specific force along the third axis of the upright frame, times v√H."""
        return upward_force(self)

    def vertical(self, v: Any) -> Any:
        """Return the vertical component of a vector."""
        return v[2] if self.up is None else dot(v, self.up)

    def level_square(self, v: Any) -> Any:
        """Return the squared norm of the horizontal component of a vector."""
        level = self._level(v)
        return dot(level, level)

    def _level(self, v: Any) -> Any:
        """Return a vector with the same scalar products as the horizontal component of v."""
        return v[:2] if self.up is None else cross(v, self.up)


def natural_rate(i: Any, inv_speed: Any, inv_cross_norm: Any, torsion: Any) -> tuple[Any, Any]:
    """Return the components along τ and b of the angular rate ω⁰ [rad/s] of the natural trihedral.

    In the trihedral's own axes, ω⁰ = (vχ, 0, vκ), with the speed v and the curvature κ. With c = r'×r'', vκ = |c|/v².
    `inv_speed` is 1/v, `inv_cross_norm` is 1/|c|, and `torsion` is χ = c·r'''/|c|². Where one of these values is
    undefined, pass any finite number to obtain finite results and derivatives.
    """
    return i.S * inv_speed * torsion, i.N * inv_cross_norm * inv_speed**2


def natural_acceleration(i: Any, inv_speed: Any, inv_cross_norm: Any, torsion: Any) -> tuple[Any, Any]:
    """Return the components along τ and b of the angular acceleration [rad/s²] of the natural trihedral.

    The component along n is zero. The formulas are from paper S, with corrected errata; the arguments are the same as
    for `natural_rate`.
    """
    inv_N = inv_cross_norm**2
    torsion_rate = i.D * inv_N - 2 * i.T * i.E * inv_N**2
    along = i.B * inv_speed * torsion + i.S * inv_speed * torsion_rate
    return along, binormal_acceleration(i, inv_speed, inv_cross_norm)


def binormal_acceleration(i: Any, inv_speed: Any, inv_cross_norm: Any) -> Any:
    """Return the component along b [rad/s²] of the angular acceleration of the natural trihedral.

    It depends on the first three derivatives of the path. The arguments are the same as for `natural_rate`.
    """
    inv_S = inv_speed**2
    return i.E * inv_cross_norm * inv_S - 2 * (i.N * inv_cross_norm) * i.B * inv_S**2


def tangential_numerator(i: Any) -> Any:
    """Return vN² times the component of `natural_acceleration` along τ; the product is a polynomial.

    v = |r'| is the speed, and N = |r'×r''|².
    """
    return i.B * (i.T * i.N) + i.S * (i.D * i.N - 2 * (i.T * i.E))


def binormal_numerator(i: Any) -> Any:
    """Return |r'×r''| v⁴ times the component of `natural_acceleration` along b; the product is a polynomial.

    v = |r'| is the speed.
    """
    return i.E * i.S - 2 * (i.N * i.B)


def yaw(i: Any, inv_speed: Any, inv_level: Any) -> tuple[Any, Any]:
    """Return the rate ω_z [rad/s] and the acceleration ε_z [rad/s²] of the upright frame about its own z axis.

    ω_z = P/(v√H), with P = (r'×r'')·up, the speed v and the squared horizontal speed H, and ε_z is the derivative of
    ω_z. `inv_speed` is 1/v, and `inv_level` is 1/√H. For undefined inverses see `natural_rate`.
    """
    rate = i.P * inv_speed * inv_level
    return rate, i.P1 * inv_speed * inv_level - rate * (i.B * inv_speed**2 + i.G * inv_level**2)


def upright_rates(i: Any, inv_speed: Any, inv_level: Any) -> tuple[tuple, tuple]:
    """Return the angular rate ω [rad/s] and acceleration ε [rad/s²] of the upright frame in its own axes τ, n and b.

    Let v be the speed, and S, V, W, B, P and H as in `Invariants`. The axes are τ = r'/v, n = up×r'/√H and b = (S·up −
    V·r')/(v√H). ω = (VP/(vH), (VB − SW)/(S√H), P/(v√H)), and ε is the derivative of ω. The arguments are the same as
    for `yaw`.
    """
    log_speed_rate, log_level_rate = i.B * inv_speed**2, i.G * inv_level**2  # logarithmic derivatives of v and √H
    roll_factor, pitch_factor = inv_speed * inv_level**2, inv_speed**2 * inv_level
    roll, pitch = i.V * i.P * roll_factor, (i.V * i.B - i.S * i.W) * pitch_factor
    rate, acceleration = yaw(i, inv_speed, inv_level)
    return (roll, pitch, rate), (
        (i.W * i.P + i.V * i.P1) * roll_factor - roll * (log_speed_rate + 2 * log_level_rate),
        (i.V * (i.A + i.C) - i.B * i.W - i.S * i.X) * pitch_factor - pitch * (2 * log_speed_rate + log_level_rate),
        acceleration,
    )
