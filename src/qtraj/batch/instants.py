"""Paths and their frames at many instants at once, in components.

The definitions are those of `trihedral` and `quantity`, in a form that compilers for CPUs turn into few fast loops. The
derivatives are computed in the path's moving basis, where they are polynomials. One cosine and one sine of half its
angle transform the results to world axes. The quaternion is that of the moving basis times that of the frame in it. The
code avoids square roots, divisions and branches, because the compiler would split the loop at each of them.

Arrays are (paths, instants). Where a frame does not exist, the numbers are the fallback values of `trihedral`.
"""

from functools import cached_property
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.lax import split, stop_gradient
from jaxtyping import Array, Float

from qtraj.algebra import hamilton, polynomial, quaternion, rotation
from qtraj.batch.body_forces import path_force, turning_moment
from qtraj.batch.components import filled, triple, world_derivatives
from qtraj.batch.cpu import DIVISION, cos_sin, derivatives_in_one_loop, inverse_root, root
from qtraj.path.components import Triple, add_vectors, cross, dot, rotated_z, scaled, select
from qtraj.path.frenet import Invariants, natural_acceleration, natural_rate, upright_rates
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.moving_basis import MovingPolynomials, in_moving_basis
from qtraj.path.path_quantity import PathQuantity
from qtraj.path.placement import Placement
from qtraj.path.rate_axes import BODY
from qtraj.path.regularity import has_natural_frame, has_tangent, has_upright_frame
from qtraj.path.trihedral import STEEP, AbstractFrame, Natural, Upright
from qtraj.path.vehicle import RoadParameters, Vehicle

Times = Float[Array, "rows instants"]
Quaternion = tuple[Array, Array, Array, Array]

ORDER = 4
"""The highest derivative of a path that any output needs."""

FORWARD, UP = (1, 0, 0), (0, 0, 1)
"""World axes; integers 0 and 1 cost nothing (`algebra.sparse`)."""


class FrameComponents(NamedTuple):
    """A frame on a path: its axes in the path's moving basis, its rate and acceleration in its own axes."""

    axes: tuple[Triple, Triple, Triple]
    rate: Triple
    acceleration: Triple
    defined: Array


class Instants:
    """All outputs of a stack of paths (every array with a leading axis) at instants (paths or 1, instants) [s].

    Vectors are triples of arrays. Each output is computed at its first use.
    """

    def __init__(
        self,
        paths: AbstractHodograph,
        t: Times,
        frame: AbstractFrame,
        axes: str = BODY,
        vehicle: Vehicle | None = None,
    ):
        self.frame, self.t, self.axes, self.vehicle = frame, t, axes, vehicle
        polynomials = eqx.filter_vmap(lambda path: path.polynomials())(paths)
        if polynomials is None:
            self.basis, rows = Basis(), world_derivatives(paths, t, ORDER)
        else:
            t = t.astype(polynomials.x.dtype)
            rows, angle = _moving_derivatives(polynomials, t)
            self.basis = Basis(angle, polynomials.placement)
        zero = jnp.zeros_like(rows[0][0])
        self.rows = [filled(row, zero) for row in rows]
        self.duration = paths.duration[:, None].astype(zero.dtype)

    def derivative(self, k: int) -> Triple:
        """The k-th derivative of r, world axes."""
        x, y, z = self.basis.world(self.rows[k])
        if k or not self.basis.placed:
            return x, y, z
        return x + self.basis.origin[0], y + self.basis.origin[1], z + self.basis.origin[2]

    def path_quantity(self, entry: PathQuantity) -> Array:
        """The value of a path quantity."""
        return entry.value(self.invariants, DIVISION)

    @cached_property
    def invariants(self) -> Invariants:
        """The invariants of the path, with the world's vertical."""
        up = self.basis.local(UP) if self.basis.placed else None
        return Invariants(self.rows, up, self._road, root)

    @property
    def _road(self) -> RoadParameters | None:
        if self.vehicle is None:
            return None
        parameters = self.vehicle.parameters(self.duration.dtype)
        return RoadParameters(*(jnp.asarray(x) for x in parameters))

    @property
    def force(self) -> Triple:
        """The force that moves the vehicle along the path [N], in the requested axes."""
        force = path_force(self._road, self.rows, self.basis.local(UP), root(self.invariants.S))
        if self.axes != BODY:
            return self.basis.world(force)
        tangent, normal, binormal = (dot(axis, force) for axis in self._frame.axes)
        return tangent, normal, binormal

    @property
    def moment(self) -> Triple:
        """The moment that turns the vehicle with the frame [N m], in the requested axes."""
        frame = self._frame
        return self._in_axes(turning_moment(self.vehicle, frame.rate, frame.acceleration))

    @property
    def speed(self) -> Array:
        """|r'| [m/s]."""
        return root(self.invariants.S)

    @property
    def curvature(self) -> Array:
        """κ [1/m]; 0 where the path stops."""
        i = self.invariants
        return root(i.N) * inverse_root(i.S, has_tangent(i, self.duration)) ** 3

    @cached_property
    def torsion(self) -> Array:
        """χ [1/m]; 0 where the path is straight or stops."""
        return self.invariants.T * self._inv_cross_norm**2

    @property
    def dcm(self) -> tuple[Array, ...]:
        """Direction cosines, world to body, row by row."""
        tangent, normal, binormal = (self.basis.world(axis) for axis in self._frame.axes)
        return (*tangent, *normal, *binormal)

    @cached_property
    def quaternion(self) -> Quaternion:
        """The unit quaternion, body to world; its first non-zero component is positive."""
        q = self.basis.world_quaternion(hamilton.from_axes(*self._frame.axes, inverse_root))
        sign = jnp.where(hamilton.is_negative(q), -1.0, 1.0).astype(q[0].dtype)
        return sign * q[0], sign * q[1], sign * q[2], sign * q[3]

    @property
    def gibbs(self) -> tuple[Array, ...]:
        """The Gibbs vector."""
        return _gibbs(self.quaternion)

    @property
    def rate(self) -> Triple:
        """Angular rate of the frame [rad/s], in the requested axes."""
        return self._in_axes(self._frame.rate)

    @property
    def acceleration(self) -> Triple:
        """Angular acceleration of the frame [rad/s²], in the requested axes."""
        return self._in_axes(self._frame.acceleration)

    def _in_axes(self, v: Triple) -> Triple:
        """A vector with components in the frame, in the requested axes."""
        if self.axes == BODY:
            return v
        a, b, c = (scaled(axis, part) for axis, part in zip(self._frame.axes, v, strict=True))
        return self.basis.world(add_vectors(add_vectors(a, b), c))

    @property
    def defined(self) -> Array:
        """Whether the frame exists."""
        return self._frame.defined

    @cached_property
    def _has_natural_frame(self) -> Array:
        return has_natural_frame(self.invariants, self.duration)

    @cached_property
    def _inv_cross_norm(self) -> Array:
        return inverse_root(self.invariants.N, self._has_natural_frame)

    @cached_property
    def _frame(self) -> FrameComponents:
        if isinstance(self.frame, Natural):
            return self._natural()
        return self._upright(self.frame) if isinstance(self.frame, Upright) else self._other()

    def _natural(self) -> FrameComponents:
        i, exists, inv_cross_norm = self.invariants, self._has_natural_frame, self._inv_cross_norm
        # 1/v and 1/|c| are 0 where there is no trihedral, so all products with them are 0 there.
        arguments = (i, inverse_root(i.S, exists), inv_cross_norm, self.torsion)
        rate, acceleration = natural_rate(*arguments), natural_acceleration(*arguments)
        zero = jnp.zeros_like(i.S)
        axes = _axes(self.basis, self.rows[1], scaled(i.c, inv_cross_norm), exists)
        return FrameComponents(axes, (rate[0], zero, rate[1]), (acceleration[0], zero, acceleration[1]), exists)

    def _upright(self, frame: Upright) -> FrameComponents:
        x, y, z = frame.unit_up(self.duration.dtype)
        up = self.basis.local((x, y, z))
        i = Invariants(self.rows, up)
        defined = has_upright_frame(i, self.duration)
        rate, acceleration = upright_rates(i, inverse_root(i.S, defined), inverse_root(i.H, defined))
        axes = _axes(self.basis, self.rows[1], up, ~_vanishes(i.H))
        return FrameComponents(axes, rate, acceleration, defined)

    def _other(self) -> FrameComponents:
        """Any other frame, instant by instant."""
        rows = jnp.stack([jnp.stack(self.derivative(k), axis=-1) for k in range(ORDER + 1)], axis=-2)
        durations = jnp.broadcast_to(self.duration, rows.shape[:2])
        t = jnp.broadcast_to(self.t.astype(rows.dtype), durations.shape)
        at = jax.vmap(jax.vmap(self.frame.at))(t, rows, durations)
        vectors = (at.tangent, at.normal, at.binormal, at.rate, at.acceleration)
        tangent, normal, binormal, rate, acceleration = (triple(v) for v in vectors)
        axes = self.basis.local(tangent), self.basis.local(normal), self.basis.local(binormal)
        return FrameComponents(axes, rate, acceleration, at.defined)


class Basis:
    """The moving bases of paths: R_z(angle) in the axes of a placement, or the world axes."""

    def __init__(self, angle: Array | None = None, placement: Placement | None = None):
        self.rotating, self.placed = angle is not None, placement is not None
        if angle is not None:
            cos, sin = self.half = cos_sin(0.5 * angle)
            self.cos, self.sin = 1 - 2 * sin**2, 2 * sin * cos
        if angle is not None and placement is not None:
            self.origin = triple(placement.origin.astype(angle.dtype)[:, None])
            unit = jax.vmap(quaternion.unit)(placement.orientation.astype(angle.dtype))
            self.orientation = tuple(unit[:, k, None] for k in range(4))
            dcm = jax.vmap(rotation.to_dcm)(unit)[:, None]  # its rows are the placement's axes in the world
            self.columns, self.rows = ([triple(m[..., k, :]) for k in range(3)] for m in (dcm, dcm.mT))

    def world(self, v: Triple) -> Triple:
        """World components of a free vector."""
        if self.rotating:
            v = rotated_z(v, self.cos, self.sin)
        return (dot(self.rows[0], v), dot(self.rows[1], v), dot(self.rows[2], v)) if self.placed else v

    def local(self, v: Triple) -> Triple:
        """Components in the moving basis of a free vector given in world axes."""
        if self.placed:
            v = dot(self.columns[0], v), dot(self.columns[1], v), dot(self.columns[2], v)
        return rotated_z(v, self.cos, -self.sin) if self.rotating else v

    def world_quaternion(self, q: Quaternion) -> Quaternion:
        """The quaternion to world axes from `q`, which maps to the moving basis."""
        if self.rotating:
            cos, sin = self.half
            q = hamilton.product((cos, 0, 0, sin), q)
        return hamilton.product(self.orientation, q) if self.placed else q


def _moving_derivatives(paths: MovingPolynomials, t: Times) -> tuple[list[Triple], Array]:
    """The derivatives in the moving basis, and its angle."""
    present = [paths.x, paths.z, paths.angle, *([] if paths.y is None else [paths.y])]
    single = [c for p in present for c in split(p.astype(t.dtype), [1] * p.shape[1], axis=1)]
    coefficients = iter(derivatives_in_one_loop([jnp.broadcast_to(c, (c.shape[0], t.shape[1])) for c in single]))
    x, z, angle, *y = (
        polynomial.taylor_terms([next(coefficients) for _ in range(p.shape[1])], t, ORDER) for p in present
    )
    return in_moving_basis(x, y[0] if y else [0] * len(x), z, angle), angle[0]  # type: ignore[return-value]


def _axes(basis: Basis, r1: Triple, across: Triple, exists: Array) -> tuple[Triple, Triple, Triple]:
    """τ, n along `across` × τ, and b; where `exists` is false, n is level as in `trihedral`."""
    S, forward, up = dot(r1, r1), basis.local(FORWARD), basis.local(UP)
    stopped = _vanishes(S)
    tangent = select(stopped, forward, scaled(r1, inverse_root(S, ~stopped)))
    reference = select(dot(up, tangent) ** 2 > STEEP, forward, up)
    x, y, z = scaled(tangent, dot(reference, tangent))
    # n from c × τ, then b = τ × n: orthonormal to round-off even where c has lost most of its digits.
    direction = cross(select(exists, across, (reference[0] - x, reference[1] - y, reference[2] - z)), tangent)
    normal = scaled(direction, inverse_root(dot(direction, direction)))
    return tangent, normal, cross(tangent, normal)


def _gibbs(q: Quaternion) -> tuple[Array, ...]:
    """The Gibbs vector λ_k/λ0, without division; at half turns the same as `rotation.to_gibbs`."""
    s = q[0]
    square = s * s
    regular = square >= jnp.finfo(s.dtype).tiny
    inverse = s * inverse_root(square, regular) ** 2
    infinite = [
        stop_gradient(jnp.where(u > 0, jnp.inf, jnp.where(u < 0, -jnp.inf, 0.0)).astype(s.dtype)) for u in q[1:]
    ]
    return tuple(jnp.where(regular, u * inverse, x) for u, x in zip(q[1:], infinite, strict=True))


def _vanishes(square: Array) -> Array:
    return square < float(jnp.finfo(square.dtype).tiny)
