"""Define the moments that rotate a body with the natural trihedral, as entries of the registry of quantities.

In its own axes τ, n and b, the natural trihedral has the angular rate ω = (p, 0, r), with p = vχ and r = vκ, and the
angular acceleration ε = (p', 0, r'). v is the speed, κ the curvature and χ the torsion. If τ, n and b are principal
axes of inertia with the moments of inertia J_τ, J_n and J_b, Euler's equations M = Jε + ω×Jω give

        M_τ = J_τ p',     M_n = (J_τ − J_b) p r,     M_b = J_b r'.

So the square of each moment is a ratio of polynomials times the square of a factor that depends only on the inertia.
"""

from typing import Any

from qtraj.algebra.cpu import inverse_root
from qtraj.path.frenet import binormal_acceleration, binormal_numerator, natural_acceleration, tangential_numerator
from qtraj.path.path_quantity import PRINCIPAL, PathQuantity, squared


def _accelerations(i: Any) -> tuple[Any, Any]:
    """Return the angular acceleration of the trihedral along τ and b; zeros where the trihedral does not exist."""
    inv_speed, inv_cross_norm = _inverses(i)
    return natural_acceleration(i, inv_speed, inv_cross_norm, i.T * inv_cross_norm**2)


def _inverses(i: Any) -> tuple[Any, Any]:
    return inverse_root(i.S), inverse_root(i.N)


def _normal_square(i: Any) -> Any:
    inv_speed, inv_cross_norm = _inverses(i)
    return squared(i.T * (inv_speed * inv_cross_norm))


MOMENT_QUANTITIES = (
    PathQuantity(
        "tangential_moment",
        "|M_τ|",
        "N m",
        4,
        "magnitude of the moment about τ that rotates a body with the natural trihedral",
        numerator=lambda i: squared(tangential_numerator(i)),
        denominator=lambda i: i.S * squared(squared(i.N)),
        square=lambda i: squared(_accelerations(i)[0]),
        divisor="cross_norm",
        needs=PRINCIPAL,
        factor_unit="kg m2",
        factor=lambda vehicle: vehicle.inertia_tangent,
    ),
    PathQuantity(
        "normal_moment",
        "|M_n|",
        "N m",
        3,
        "magnitude of the moment about n that rotates a body with the natural trihedral",
        numerator=lambda i: squared(i.T),
        denominator=lambda i: i.N * i.S,
        square=_normal_square,
        divisor="cross_norm",
        needs=PRINCIPAL,
        factor_unit="kg m2",
        factor=lambda vehicle: abs(vehicle.inertia_tangent - vehicle.inertia_binormal),
    ),
    PathQuantity(
        "binormal_moment",
        "|M_b|",
        "N m",
        3,
        "magnitude of the moment about b that rotates a body with the natural trihedral",
        numerator=lambda i: squared(binormal_numerator(i)),
        denominator=lambda i: i.N * squared(squared(i.S)),
        square=lambda i: squared(binormal_acceleration(i, *_inverses(i))),
        divisor="cross_norm",
        needs=PRINCIPAL,
        factor_unit="kg m2",
        factor=lambda vehicle: vehicle.inertia_binormal,
    ),
)
"""The moments about τ, n and b, in the order in which they are displayed."""

MOMENTS = tuple(entry.name for entry in MOMENT_QUANTITIES)
"""The names of the moments."""
