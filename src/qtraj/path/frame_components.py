"""Compute the natural and the upright frame in components: axes τ, n, b, rates, and whether the frame exists.

The formulas are defined only in this module, for one instant or many. Components are arrays of any shape. The formulas
contain no square roots, divisions or branches, because each of these would make XLA's compiler for CPUs split the loop
over the instants. Where a frame does not exist, `defined` is false, but all values and derivatives are finite.
"""

from typing import Any, NamedTuple

from jaxtyping import Array

from qtraj.algebra import hamilton, quaternion, rotation
from qtraj.algebra.cpu import cos_sin, inverse_root, root
from qtraj.foundation.namespace import xp
from qtraj.path.components import Triple, cross, dot, rotated_z, scaled, select
from qtraj.path.frenet import Invariants, natural_acceleration, natural_rate, upright_rates
from qtraj.path.placement import Placement
from qtraj.path.regularity import has_natural_frame, has_tangent, has_upright_frame

Quaternion = tuple[Array, Array, Array, Array]

STEEP = 0.75
"""Squared vertical component of a unit tangent above which fallback axes refer to world x instead of world z."""

FORWARD, UP = (1, 0, 0), (0, 0, 1)
"""World axes; products with the integers 0 and 1 generate no operations (`algebra.sparse`)."""


class FrameComponents(NamedTuple):
    """A frame on a path, with its angular rate and acceleration.

    `axes` are τ, n and b, each a triple of components in the moving basis of the path. `rate` [rad/s] and
    `acceleration` [rad/s²] are components along τ, n and b. `defined` is true where the frame exists.
    """

    axes: tuple[Triple, Triple, Triple]
    rate: Triple
    acceleration: Triple
    defined: Array


class Basis:
    """The moving basis of a path: the axes of a placement, or the world axes, rotated by an angle about z.

    The leading dimensions of the placement's arrays equal the dimensions of the angle, or are 1 (broadcasting).
    """

    def __init__(self, angle: Array | None = None, placement: Placement | None = None):
        self.rotating, self.placed = angle is not None, placement is not None
        if angle is not None:
            cos, sin = self.half = cos_sin(0.5 * angle)
            self.cos, self.sin = 1 - 2 * sin**2, 2 * sin * cos
        if placement is not None:
            dtype = placement.origin.dtype if angle is None else angle.dtype
            self.origin = triple(placement.origin.astype(dtype))
            unit = quaternion.unit(placement.orientation.astype(dtype))
            self.orientation = quaternion.components(unit)
            # The rows of the direction cosine matrix are the axes of the placement in world components.
            dcm = rotation.to_dcm(unit)
            self.columns, self.rows = ([triple(m[..., k, :]) for k in range(3)] for m in (dcm, dcm.mT))

    def world(self, v: Triple) -> Triple:
        """Convert a free vector from the moving basis to world components."""
        if self.rotating:
            v = rotated_z(v, self.cos, self.sin)
        return (dot(self.rows[0], v), dot(self.rows[1], v), dot(self.rows[2], v)) if self.placed else v

    def local(self, v: Triple) -> Triple:
        """Convert a free vector from world components to the moving basis."""
        if self.placed:
            v = dot(self.columns[0], v), dot(self.columns[1], v), dot(self.columns[2], v)
        return rotated_z(v, self.cos, -self.sin) if self.rotating else v

    def world_quaternion(self, q: Quaternion) -> Quaternion:
        """Convert a quaternion from frame to moving basis, `q`, to the quaternion from frame to world axes."""
        if self.rotating:
            cos, sin = self.half
            q = hamilton.product((cos, 0, 0, sin), q)
        return hamilton.product(self.orientation, q) if self.placed else q

    def invariants(self, rows: list[Triple]) -> Invariants:
        """Return the invariants of the derivatives `rows`, which are in this basis; the vertical is world z."""
        return Invariants(rows, self.local(UP) if self.placed else None, root=root)


def natural(i: Invariants, basis: Basis, span: Array) -> FrameComponents:
    """Return the natural trihedral (paper S with corrected errata) of a path with invariants `i` and `span` [s]."""
    exists = has_natural_frame(i, span)
    # Where the trihedral does not exist, 1/|r'| and 1/|r'×r''| are replaced by 0, so all products with them are 0.
    inv_cross_norm = inverse_root(i.N, exists)
    arguments = (i, inverse_root(i.S, exists), inv_cross_norm, i.T * inv_cross_norm**2)
    rate, acceleration = natural_rate(*arguments), natural_acceleration(*arguments)
    zero = xp.zeros_like(i.S)
    axes = _axes(basis, i.r[1], scaled(i.c, inv_cross_norm), exists)
    return FrameComponents(axes, (rate[0], zero, rate[1]), (acceleration[0], zero, acceleration[1]), exists)


def upright(i: Invariants, basis: Basis, span: Array, up: Triple) -> FrameComponents:
    """Return the upright frame of a path with invariants `i` and `span` [s]; `up` is the unit vertical (world)."""
    up = basis.local(up)
    i = Invariants(i.r, up)
    exists = has_upright_frame(i, span)
    rate, acceleration = upright_rates(i, inverse_root(i.S, exists), inverse_root(i.H, exists))
    return FrameComponents(_axes(basis, i.r[1], up, ~vanishes(i.H)), rate, acceleration, exists)


def curvature(i: Invariants, span: Array) -> Array:
    """Return the curvature κ [1/m]; 0 where the speed is zero."""
    return root(i.N) * inverse_root(i.S, has_tangent(i, span)) ** 3


def torsion(i: Invariants, span: Array) -> Array:
    """Return the torsion χ [1/m]; 0 where the path is straight or the speed is zero."""
    return i.T * inverse_root(i.N, has_natural_frame(i, span)) ** 2


def triple(v: Array) -> Triple:
    """Return the components of vectors (..., 3) as a triple."""
    return v[..., 0], v[..., 1], v[..., 2]


def filled(row: Triple, zero: Array) -> Triple:
    """Replace the integer 0 in a triple by the array `zero`."""
    return tuple(zero if isinstance(x, int) else x for x in row)  # type: ignore[return-value]


def _axes(basis: Basis, r1: Triple, across: Triple, exists: Any) -> tuple[Triple, Triple, Triple]:
    """Return τ in the direction of the velocity `r1`, n in the direction of `across` × τ, and b = τ × n.

    Where the speed is zero, τ is world x. Where `exists` is false, b is the direction closest to world z that is
    perpendicular to τ; if τ is steep, b is the direction closest to world x.
    """
    S, forward, up = dot(r1, r1), basis.local(FORWARD), basis.local(UP)
    stopped = vanishes(S)
    tangent = select(stopped, forward, scaled(r1, inverse_root(S, ~stopped)))
    reference = select(dot(up, tangent) ** 2 > STEEP, forward, up)
    x, y, z = scaled(tangent, dot(reference, tangent))
    # Computing n from `across` × τ and then b = τ × n makes the axes orthonormal to within rounding error, for any
    # `across` that is not parallel to τ.
    direction = cross(select(exists, across, (reference[0] - x, reference[1] - y, reference[2] - z)), tangent)
    normal = scaled(direction, inverse_root(dot(direction, direction)))
    return tangent, normal, cross(tangent, normal)


def vanishes(square: Array) -> Array:
    """Return whether a squared norm is below the smallest normal number."""
    return square < float(xp.finfo(square.dtype).tiny)
