"""Forces between a vehicle and the road: along it, across it, and onto it (paper S, conclusions).

The road contains the direction of motion τ. Without bank it is level across: n = up×r'/√H points to the left and
b = τ×n upwards, the axes of the upright frame. A bank β rolls n and b about τ. The force by which the road moves the
vehicle is m(r'' + g·up), plus the drag along τ: with the specific force f = r'' + g·up and v² = S,

    along τ:  X = m(f·τ + k v²),   across: Y = m(cos β f·n − sin β f·b),   onto the road: Z = m(cos β f·b + sin β f·n).

`Contact` has X, Y and Z over the mass, times the speeds by which τ, n and b are normalized: v, and v√H. All are
polynomials in the derivatives and in v = √S. Where a path stops, `derivatives[1]` may be any vector in the direction of
the velocity, which is `pace` times as long.
"""

from functools import cached_property
from typing import Any

from qtraj.algebra.sparse import mul


class Contact:
    """The forces between a vehicle and the road, for invariants of any type of numbers, each computed at its first use.

    The invariants are S, H, B, P, V and W of `frenet`, v = √S and h = √H, the `pace`, and the numbers of the `vehicle`.
    """

    S: Any
    H: Any
    B: Any
    P: Any
    V: Any
    W: Any
    v: Any
    h: Any
    pace: Any
    vehicle: Any

    def compute(self) -> None:
        """Compute the forces now: branches that are traced after this share them."""
        _ = self.along, self.across, self.onto, self.S, self.H, self.v, self.h

    @cached_property
    def along(self) -> Any:
        """X·v/m = r'·f + k v³: the specific power of the force along the path."""
        p = self.vehicle
        return self.B + p.gravity * self.V + p.drag * mul(mul(self.pace, self.pace), self.S * self.v)

    @cached_property
    def across(self) -> Any:
        """Y·v√H/m, to the left."""
        p = self.vehicle
        return p.cos * (self.P * self.v) - p.sin * self._upwards

    @cached_property
    def onto(self) -> Any:
        """Z·v√H/m: positive where the vehicle presses on the road."""
        p = self.vehicle
        return p.cos * self._upwards + p.sin * (self.P * self.v)

    @cached_property
    def _upwards(self) -> Any:
        """f·b times v√H, with b√(SH) = S·up − V·r'."""
        return self.S * self.W - self.V * self.B + self.vehicle.gravity * self.H


def friction_numerator(i: Contact) -> Any:
    """((X/μ_along)² + (Y/μ_across)²)·SH/m²: the demand by the friction ellipse, times the load."""
    p, x, y = i.vehicle, i.along, i.across
    return p.inv_long * (p.inv_long * (x * x * i.H)) + p.inv_lat * (p.inv_lat * (y * y))


def power_numerator(i: Contact) -> Any:
    """(X + C_rr·Z)·v times √H: the power of the drive, against inertia, gravity, drag and rolling resistance."""
    p = i.vehicle
    return mul(i.pace, p.mass * (i.along * i.h + p.rolling * i.onto))
