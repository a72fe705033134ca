"""Forces between a vehicle and the road: along it, across it, and onto it (paper S, conclusions).

The road contains the direction of motion τ. Without bank it is level across: n = up×r'/√H points to the left and
b = τ×n upwards, the axes of the upright frame. A bank β rolls n and b about τ. The force by which the road moves the
vehicle is m(r'' + g·up), plus the drag along τ: with the specific force f = r'' + g·up and v² = S,

    along τ:  X = m(f·τ + k v²),   across: Y = m(cos β f·n − sin β f·b),   onto the road: Z = m(cos β f·b + sin β f·n).

The functions return X, Y and Z over the mass, times the speeds by which τ, n and b are normalized: v, and v√H. All are
polynomials in the derivatives and in v = √S. They take invariants with the attribute `vehicle`, in any type of numbers.
Where a path stops, `derivatives[1]` may be any vector in the direction of the velocity, which is `pace` times as long.
"""

from typing import Any

from qtraj.algebra.sparse import mul


def along(i: Any) -> Any:
    """X·v/m = r'·f + k v³: the specific power of the force along the path."""
    p = i.vehicle
    return i.B + p.gravity * i.V + p.drag * mul(mul(i.pace, i.pace), i.S * i.v)


def across(i: Any) -> Any:
    """Y·v√H/m, to the left."""
    p = i.vehicle
    return p.cos * (i.P * i.v) - p.sin * _upwards(i)


def onto(i: Any) -> Any:
    """Z·v√H/m: positive where the vehicle presses on the road."""
    p = i.vehicle
    return p.cos * _upwards(i) + p.sin * (i.P * i.v)


def _upwards(i: Any) -> Any:
    """f·b times v√H, with b√(SH) = S·up − V·r'."""
    return i.S * i.W - i.V * i.B + i.vehicle.gravity * i.H


def friction_numerator(i: Any) -> Any:
    """((X/μ_along)² + (Y/μ_across)²)·SH/m²: the demand by the friction ellipse, times the load."""
    p, x, y = i.vehicle, along(i), across(i)
    return p.inv_long * (p.inv_long * (x * x * i.H)) + p.inv_lat * (p.inv_lat * (y * y))


def power_numerator(i: Any) -> Any:
    """(X + C_rr·Z)·v times √H: the power of the drive, against inertia, gravity, drag and rolling resistance."""
    p = i.vehicle
    return mul(i.pace, p.mass * (along(i) * i.h + p.rolling * onto(i)))
