"""Frenet formulas: scalar products of a path's derivatives, and the rates of its natural trihedral.

The one home of these formulas. They are written over any arithmetic whose vectors `components.dot` and
`components.cross` know: numbers (3,), triples of arrays over many instants, polynomials in Bernstein form. The
derivatives may stand in any orthonormal basis; what refers to the vertical needs it as `up`, or as the third axis.
"""

from functools import cached_property
from typing import Any

from qtraj.path.components import cross, dot


class Invariants:
    """Scalar products of r', r'', r''' and r'''', each formed when it is first asked for (paper S).

    With c = r'×r'' and c' = r'×r''': speed² = S, curvature² = N/S³, torsion = T/N. Against the vertical: V is the
    climb rate, H the square of the horizontal speed, P = c·up.
    """

    def __init__(self, derivatives: Any, up: Any = None):
        """`derivatives[k]` is the k-th derivative, from 1 on; `up` is the vertical, the third axis if None."""
        self.r = derivatives
        self.up = up

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
        """r'·r''', the derivative of B less A."""
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
        """What has the scalar products of the horizontal part of v."""
        return v[:2] if self.up is None else cross(v, self.up)


def natural_rate(i: Any, inv_speed: Any, inv_cross_norm: Any, torsion: Any) -> tuple[Any, Any]:
    """The components of ω⁰ = (vχ, 0, vκ) [rad/s] that are not zero, along τ and along b: vκ = |c|/v².

    `inv_speed` = 1/v, `inv_cross_norm` = 1/|c| and `torsion` χ = T/N. Where one of them does not exist, any finite
    number in its place gives finite results and derivatives.
    """
    return i.S * inv_speed * torsion, i.N * inv_cross_norm * inv_speed**2


def natural_acceleration(i: Any, inv_speed: Any, inv_cross_norm: Any, torsion: Any) -> tuple[Any, Any]:
    """The same of ε⁰ [rad/s²], the derivative of ω⁰ (paper S, with its errata mended)."""
    inv_N, inv_S = inv_cross_norm**2, inv_speed**2
    torsion_rate = i.D * inv_N - 2 * i.T * i.E * inv_N**2
    speed, cross_norm = i.S * inv_speed, i.N * inv_cross_norm
    along = i.B * inv_speed * torsion + speed * torsion_rate
    return along, i.E * inv_cross_norm * inv_S - 2 * cross_norm * i.B * inv_S**2


def yaw(i: Any, inv_speed: Any, inv_level: Any) -> tuple[Any, Any]:
    """ω_z [rad/s] and ε_z [rad/s²] of the upright frame about its own z axis: ω_z = P/(v√H).

    `inv_level` = 1/√H is one over the horizontal speed; where an inverse does not exist, as in `natural_rate`.
    """
    rate = i.P * inv_speed * inv_level
    return rate, i.P1 * inv_speed * inv_level - rate * (i.B * inv_speed**2 + i.G * inv_level**2)


def upright_rates(i: Any, inv_speed: Any, inv_level: Any) -> tuple[tuple, tuple]:
    """ω [rad/s] and ε [rad/s²] of the upright frame in its own axes, with n = up×r'/√H and b = (S·up − V·r')/(v√H).

    ω = (VP/(vH), (VB − SW)/(S√H), P/(v√H)), and ε is its derivative.
    """
    stretch, widening = i.B * inv_speed**2, i.G * inv_level**2  # the logarithmic derivatives of v and √H
    rolls, pitches = inv_speed * inv_level**2, inv_speed**2 * inv_level
    roll, pitch = i.V * i.P * rolls, (i.V * i.B - i.S * i.W) * pitches
    rate, acceleration = yaw(i, inv_speed, inv_level)
    return (roll, pitch, rate), (
        (i.W * i.P + i.V * i.P1) * rolls - roll * (stretch + 2 * widening),
        (i.V * (i.A + i.C) - i.B * i.W - i.S * i.X) * pitches - pitch * (2 * stretch + widening),
        acceleration,
    )
