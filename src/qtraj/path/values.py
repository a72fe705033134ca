"""Compute path quantities at one instant, or in NumPy at many."""

from jaxtyping import Array

from qtraj.foundation.methods import method
from qtraj.foundation.namespace import xp
from qtraj.foundation.types import Scalar, ScalarLike
from qtraj.path.components import Triple, rotated_z
from qtraj.path.frame_components import triple
from qtraj.path.frenet import Invariants
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.moving_basis import in_moving_basis
from qtraj.path.path_quantity import PathQuantity
from qtraj.path.placement import Placement
from qtraj.path.quantity import quantity
from qtraj.path.regularity import rotating_span
from qtraj.path.standstill import ORDER as STANDSTILL_ORDER, driven_invariants
from qtraj.path.vehicle import NO_VEHICLE, RoadParameters


def invariants_at(
    path: AbstractHodograph, t: ScalarLike, order: int, vehicle: RoadParameters | None = None
) -> Invariants:
    """Return the invariants of the derivatives up to `order` at `t` [s], in the moving basis of the path if it has one.

    Instants `t` (n,) are accepted for paths that support NumPy.
    With a `vehicle`, the invariants are also defined at a standstill; for this, derivatives up to order 4 are used.
    """
    polynomials = method(path, "polynomials")()
    order = order if vehicle is None else max(order, STANDSTILL_ORDER)
    if polynomials is None:
        rows = method(path, "sampled" if xp.ndim(t) else "derivatives")(t, order)
        up, rows, span = None, [triple(row) for row in rows], method(path, "span")(t)
    else:
        x, y, z, angle = method(polynomials, "series")(t, order)
        rows, up = in_moving_basis(x, y, z, angle), vertical(polynomials.placement, angle[0])
        span = rotating_span(path.duration, angle[1])
    if vehicle is None:
        return Invariants(rows, up)
    return driven_invariants(rows, up, vehicle, xp.asarray(t, path.duration.dtype), path.duration, span)


def squared(path: AbstractHodograph, t: ScalarLike, name: str, vehicle: RoadParameters | None = None) -> Scalar:
    """Return the square of a path quantity at one instant `t` [s], or 0 if the quantity is negative.

    The square of a quantity with a `factor` is divided by the square of the factor.
    """
    entry = quantity(name)
    i = _invariants_of(entry, path, t, vehicle)
    return xp.asarray(entry.squared(i), path.duration.dtype)


def value(path: AbstractHodograph, t: ScalarLike, name: str, vehicle: RoadParameters | None = None) -> Scalar:
    """Return the path quantity `name` at one instant `t` [s], in its unit; infinite at a pole."""
    entry = quantity(name)
    i = _invariants_of(entry, path, t, vehicle)
    return xp.asarray(entry.scale(vehicle) * entry.value(i), path.duration.dtype)


def _invariants_of(
    entry: PathQuantity, path: AbstractHodograph, t: ScalarLike, vehicle: RoadParameters | None
) -> Invariants:
    """Return the invariants from which a quantity is computed."""
    order = max(entry.order, 1)
    if entry.on_road:
        return invariants_at(path, t, order, NO_VEHICLE if vehicle is None else vehicle)
    found = invariants_at(path, t, order)
    found.vehicle = vehicle
    return found


def vertical(placement: Placement | None, angle: Array) -> Triple | None:
    """Return the world's vertical in the moving basis at this `angle`, or None if the vertical is the third axis."""
    if placement is None:
        return None
    zero = xp.zeros_like(angle)
    return to_turned_basis(placement.to_local(xp.stack([zero, zero, xp.ones_like(zero)], axis=-1)), angle)


def to_turned_basis(vector: Array, angle: Array) -> Triple:
    """Return the components of a vector in a basis that is rotated about the third axis by `angle`."""
    return rotated_z(triple(vector), xp.cos(angle), -xp.sin(angle))
