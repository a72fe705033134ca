"""Compute path quantities at one instant, or in NumPy at many."""

from collections.abc import Sequence
from typing import Any

from jaxtyping import Array

from qtraj.foundation.methods import method
from qtraj.foundation.namespace import in_numpy_or_jit, xp
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
    rows, up, span = _derivatives(path, t, order if vehicle is None else max(order, STANDSTILL_ORDER))
    return Invariants(rows, up) if vehicle is None else _driven(path, t, rows, up, span, vehicle)


def _derivatives(
    path: AbstractHodograph, t: ScalarLike, order: int, world: bool = False
) -> tuple[list[Triple], Triple | None, Any]:
    """Return the derivatives up to `order`, the vertical (None for the third axis), and the span [s].

    With `world`, the derivatives are in world axes.
    """
    polynomials = None if world else method(path, "polynomials")()
    if polynomials is None:
        rows = method(path, "sampled" if xp.ndim(t) else "derivatives")(t, order)
        return [triple(row) for row in rows], None, method(path, "span")(t)
    x, y, z, angle = method(polynomials, "series")(t, order)
    rows = in_moving_basis(x, y, z, angle)
    return rows, vertical(polynomials.placement, angle[0]), rotating_span(path.duration, angle[1])


def _driven(path: AbstractHodograph, t: Any, rows: Any, up: Any, span: Any, vehicle: RoadParameters) -> Invariants:
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
    if entry.gravity:
        return invariants_at(path, t, order, NO_VEHICLE if vehicle is None else vehicle)
    if entry.in_world:
        return Invariants(_derivatives(path, t, order, world=True)[0], None, vehicle)
    found = invariants_at(path, t, order)
    found.vehicle = vehicle
    return found


def values(
    path: AbstractHodograph, t: ScalarLike, names: Sequence[str], vehicle: RoadParameters | None = None
) -> dict[str, Scalar]:
    """Return several path quantities at one instant `t` [s], by name, from one evaluation of the path."""
    return dict(zip(names, _values(path, t, tuple(names), vehicle), strict=True))


@in_numpy_or_jit
def _values(path: AbstractHodograph, t: Any, names: tuple[str, ...], vehicle: Any) -> list[Scalar]:
    entries = [quantity(name) for name in names]
    on_road = any(entry.gravity for entry in entries)
    order = max(STANDSTILL_ORDER if on_road else 1, *(entry.order for entry in entries), 1)
    rows, up, span = _derivatives(path, t, order)
    free = Invariants(rows, up, vehicle)
    driven = _driven(path, t, rows, up, span, vehicle) if on_road else free
    world = free
    if any(entry.in_world for entry in entries):
        world = Invariants(_derivatives(path, t, order, world=True)[0], None, vehicle)
    of = lambda x: driven if x.gravity else world if x.in_world else free  # noqa: E731
    found = [entry.scale(vehicle) * entry.value(of(entry)) for entry in entries]
    return [xp.asarray(x, path.duration.dtype) for x in found]


def vertical(placement: Placement | None, angle: Array) -> Triple | None:
    """Return the world's vertical in the moving basis at this `angle`, or None if the vertical is the third axis."""
    if placement is None:
        return None
    zero = xp.zeros_like(angle)
    return to_turned_basis(placement.to_local(xp.stack([zero, zero, xp.ones_like(zero)], axis=-1)), angle)


def to_turned_basis(vector: Array, angle: Array) -> Triple:
    """Return the components of a vector in a basis that is rotated about the third axis by `angle`."""
    return rotated_z(triple(vector), xp.cos(angle), -xp.sin(angle))
