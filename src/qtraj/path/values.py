"""Values of path quantities at one instant."""

import jax.numpy as jnp
from jaxtyping import Array

from qtraj.foundation.types import Scalar, ScalarLike
from qtraj.path.components import Triple, rotated_z
from qtraj.path.frenet import Invariants
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.moving_basis import in_moving_basis
from qtraj.path.placement import Placement
from qtraj.path.quantity import quantity
from qtraj.path.vehicle import RoadParameters


def invariants_at(
    path: AbstractHodograph, t: ScalarLike, order: int, vehicle: RoadParameters | None = None
) -> Invariants:
    """The invariants of a path's derivatives up to `order` at `t`, computed in its moving basis if it has one."""
    polynomials = path.polynomials()
    if polynomials is None:
        return Invariants([(row[0], row[1], row[2]) for row in path.derivatives(t, order)], vehicle=vehicle)
    x, y, z, angle = polynomials.series(t, order)
    return Invariants(in_moving_basis(x, y, z, angle), vertical(polynomials.placement, angle[0]), vehicle)


def squared(path: AbstractHodograph, t: ScalarLike, name: str, vehicle: RoadParameters | None = None) -> Scalar:
    """The square of one path quantity at one instant; of a signed one that of its positive part."""
    entry = quantity(name)
    return jnp.asarray(entry.squared(invariants_at(path, t, max(entry.order, 1), vehicle)), path.duration.dtype)


def value(path: AbstractHodograph, t: ScalarLike, name: str, vehicle: RoadParameters | None = None) -> Scalar:
    """One path quantity at one instant, in its unit; infinite at a pole."""
    entry = quantity(name)
    i = invariants_at(path, t, max(entry.order, 1), vehicle)
    return jnp.asarray(entry.value(i), path.duration.dtype)


def vertical(placement: Placement | None, angle: Array) -> Triple | None:
    """The world's vertical in the moving basis at this `angle`; None if it is the third axis."""
    if placement is None:
        return None
    zero = jnp.zeros_like(angle)
    return to_turned_basis(placement.to_local(jnp.stack([zero, zero, jnp.ones_like(zero)])), angle)


def to_turned_basis(vector: Array, angle: Array) -> Triple:
    """The components of a vector in a basis that is rotated about the third axis by `angle`."""
    return rotated_z(vector, jnp.cos(angle), -jnp.sin(angle))
