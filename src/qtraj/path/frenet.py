"""Frenet formulas: scalar products of a path's derivatives, and the rates of its frames.

These formulas are defined only here. They work for every type of vector that `components.dot` and `components.cross`
accept: vectors (3,), triples of arrays over many instants, polynomials. The derivatives may be in any orthonormal
basis; formulas with the vertical take it as `up`, or use the third axis.
"""

from collections.abc import Callable
from functools import cached_property
from typing import Any

import jax.numpy as jnp

from qtraj.path.components import cross, dot
from qtraj.path.contact import Contact


def safe_root(x: Any) -> Any:
    """√x, with derivative 0 where x is 0."""
    zero = x <= 0
    return jnp.where(zero, 0.0, jnp.sqrt(jnp.where(zero, 1.0, x)))


class Invariants(Contact):
    """Scalar products of r', r'', r''' and r'''' (paper S), each computed at its first use.

    With c = r'×r'' and c' = r'×r''': speed² = S, curvature² = N/S³, torsion = T/N. With the vertical: V is the climb
    rate, H the square of the horizontal speed, P = c·up.
    """

    def __init__(
        self,
        derivatives: Any,
        up: Any = None,
        vehicle: Any = None,
        root: Callable[[Any], Any] = safe_root,
        pace: Any = 1,
    ):
        """`derivatives[k]` is the k-th derivative, k ≥ 1; `up` is the vertical, by default the third axis.

        `vehicle` are the `RoadParameters` for quantities that need them, and `root` is the square root of numbers. If
        `derivatives[1]` has only the direction of the velocity, `pace` is the velocity over it.
        """
        self.r = derivatives
        self.up = up
        self.vehicle = vehicle
        self.root = root
        self.pace = pace

    @cached_property
    def v(self) -> Any:
        """The speed √S."""
        return self.root(self.S)

    @cached_property
    def h(self) -> Any:
        """The horizontal speed √H."""
        return self.root(self.H)

    @cached_property
    def c(self) -> Any:
        """r'×r''."""
        return cross(self.r[1], self.r[2])

    @cached_property
    def c1(self) -> Any:
        """c' = r'×r'''."""
        return cross(self.r[1], self.r[3])

    @cached_property
    def S(self) -> Any:
        """r'·r'."""
        return dot(self.r[1], self.r[1])

    @cached_property
    def A(self) -> Any:
        """r''·r''."""
        return dot(self.r[2], self.r[2])

    @cached_property
    def J(self) -> Any:
        """r'''·r'''."""
        return dot(self.r[3], self.r[3])

    @cached_property
    def B(self) -> Any:
        """r'·r'', half the derivative of S."""
        return dot(self.r[1], self.r[2])

    @cached_property
    def C(self) -> Any:
        """r'·r''', the derivative of B minus A."""
        return dot(self.r[1], self.r[3])

    @cached_property
    def N(self) -> Any:
        """c·c."""
        return dot(self.c, self.c)

    @cached_property
    def T(self) -> Any:
        """c·r'''."""
        return dot(self.c, self.r[3])

    @cached_property
    def E(self) -> Any:
        """c·c', half the derivative of N."""
        return dot(self.c, self.c1)

    @cached_property
    def D(self) -> Any:
        """c·r'''', the derivative of T."""
        return dot(self.c, self.r[4])

    @cached_property
    def V(self) -> Any:
        """r'·up."""
        return self._vertical(self.r[1])

    @cached_property
    def W(self) -> Any:
        """r''·up, the derivative of V."""
        return self._vertical(self.r[2])

    @cached_property
    def X(self) -> Any:
        """r'''·up, the derivative of W."""
        return self._vertical(self.r[3])

    @cached_property
    def H(self) -> Any:
        """The square of the horizontal part of r'."""
        level = self._level(self.r[1])
        return dot(level, level)

    @cached_property
    def G(self) -> Any:
        """The scalar product of the horizontal parts of r' and r'', half the derivative of H."""
        return dot(self._level(self.r[1]), self._level(self.r[2]))

    @cached_property
    def P(self) -> Any:
        """c·up."""
        return self._vertical(self.c)

    @cached_property
    def P1(self) -> Any:
        """c'·up, the derivative of P."""
        return self._vertical(self.c1)

    def _vertical(self, v: Any) -> Any:
        return v[2] if self.up is None else dot(v, self.up)

    def _level(self, v: Any) -> Any:
        """A vector with the same scalar products as the horizontal part of v."""
        return v[:2] if self.up is None else cross(v, self.up)


def natural_rate(i: Any, inv_speed: Any, inv_cross_norm: Any, torsion: Any) -> tuple[Any, Any]:
    """The nonzero components, along τ and b, of ω⁰ = (vχ, 0, vκ) [rad/s], with vκ = |c|/v².

    `inv_speed` = 1/v, `inv_cross_norm` = 1/|c| and `torsion` χ = T/N. Where one of them is undefined, pass any finite
    number: results and derivatives are then finite.
    """
    return i.S * inv_speed * torsion, i.N * inv_cross_norm * inv_speed**2


def natural_acceleration(i: Any, inv_speed: Any, inv_cross_norm: Any, torsion: Any) -> tuple[Any, Any]:
    """The nonzero components, along τ and b, of ε⁰ = dω⁰/dt [rad/s²] (paper S, errata corrected)."""
    inv_N, inv_S = inv_cross_norm**2, inv_speed**2
    torsion_rate = i.D * inv_N - 2 * i.T * i.E * inv_N**2
    speed, cross_norm = i.S * inv_speed, i.N * inv_cross_norm
    along = i.B * inv_speed * torsion + speed * torsion_rate
    return along, i.E * inv_cross_norm * inv_S - 2 * cross_norm * i.B * inv_S**2


def yaw(i: Any, inv_speed: Any, inv_level: Any) -> tuple[Any, Any]:
    """ω_z [rad/s] and ε_z [rad/s²] of the upright frame about its own z axis: ω_z = P/(v√H).

    `inv_level` = 1/√H is the inverse of the horizontal speed. For undefined inverses see `natural_rate`.
    """
    rate = i.P * inv_speed * inv_level
    return rate, i.P1 * inv_speed * inv_level - rate * (i.B * inv_speed**2 + i.G * inv_level**2)


def upright_rates(i: Any, inv_speed: Any, inv_level: Any) -> tuple[tuple, tuple]:
    """ω [rad/s] and ε [rad/s²] of the upright frame in its own axes, with n = up×r'/√H and b = (S·up − V·r')/(v√H).

    ω = (VP/(vH), (VB − SW)/(S√H), P/(v√H)), and ε is its derivative.
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
