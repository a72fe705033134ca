"""Evaluate paths and their frames at many instants at once; each component is a separate array.

The formulas are defined in `frame_components` and `quantity`. The derivatives of a polynomial path are computed in its
moving basis, in which they are polynomials. The results are transformed to world axes with the cosine and sine of half
the angle of the basis. The derivatives of other paths are computed in world axes. The quaternion is the product of the
quaternion of the moving basis and the quaternion of the frame relative to this basis.

Arrays are (paths, instants). Where a frame is not defined, its outputs are the fallback values of `trihedral`.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax.lax import split
from jaxtyping import Array, Float

from qtraj.algebra import hamilton, polynomial
from qtraj.algebra.cpu import derivatives_in_one_loop, inverse_root, root
from qtraj.batch.body_forces import path_force, turning_moment
from qtraj.foundation.namespace import is_host, stop_gradient, xp
from qtraj.path.components import Triple, add_vectors, dot, scaled
from qtraj.path.frame_components import UP, Basis, FrameComponents, Quaternion, curvature, filled, torsion, triple
from qtraj.path.frenet import Invariants
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.moving_basis import MovingPolynomials, in_moving_basis
from qtraj.path.path_quantity import PathQuantity
from qtraj.path.rate_axes import BODY
from qtraj.path.regularity import rotating_span
from qtraj.path.road_on_path import road_on
from qtraj.path.standstill import driven_invariants
from qtraj.path.trihedral import AbstractFrame
from qtraj.path.vehicle import Vehicle, fixed_parameters

Times = Float[Array, "rows instants"]

ORDER = 4
"""Order of the highest derivative of a path that any output needs."""


class Instants:
    """All outputs of a batch of paths at the times `t` (paths or 1, instants) [s].

    Every array of `paths` has a leading axis. Vectors are triples of arrays. Each output is computed at its first use.
    """

    def __init__(
        self,
        paths: AbstractHodograph,
        t: Times,
        frame: AbstractFrame,
        axes: str = BODY,
        vehicle: Vehicle | None = None,
    ):
        self.frame, self.t, self.axes = frame, t, axes
        self.vehicle: Any = vehicle  # None only if no output needs a vehicle
        alone = is_host(t) and paths.supports_numpy and paths.duration.shape[0] == 1
        self._one = jax.tree.map(lambda x: x[0], paths) if alone else None
        single = lambda path: path.polynomials()  # noqa: E731
        polynomials = single(paths) if paths.supports_numpy else eqx.filter_vmap(single)(paths)
        if polynomials is None:
            self.basis, rows, span = Basis(), _world_derivatives(paths, t), _spans(paths, t)
        else:
            t = t.astype(polynomials.x.dtype)
            rows, angle, rate = _moving_derivatives(polynomials, t)
            span = rotating_span(paths.duration[:, None], rate)
            shared = jax.tree.map(lambda x: x[:, None], polynomials.placement)  # the same for all instants of a path
            self.basis = Basis(angle, shared)
        zero = xp.zeros_like(rows[0][0])
        self.rows = [filled(row, zero) for row in rows]
        self.duration, self.span = (xp.asarray(x).astype(zero.dtype) for x in (paths.duration[:, None], span))

    def derivative(self, k: int) -> Triple:
        """Return the position for k = 0, or its k-th time derivative, in world axes."""
        x, y, z = self.basis.world(self.rows[k])
        if k or not self.basis.placed:
            return x, y, z
        return x + self.basis.origin[0], y + self.basis.origin[1], z + self.basis.origin[2]

    def path_quantity(self, entry: PathQuantity) -> Array:
        """Return the values of a path quantity."""
        if entry.in_world(self._road):
            return entry.value(self._driven_in_world if entry.gravity else self._in_world)
        return entry.scale(self._road) * entry.value(self._driven if entry.gravity else self._with_vehicle)

    @cached_property
    def _in_world(self) -> Invariants:
        """The invariants of derivatives in world axes, for quantities that contain components or the position."""
        return Invariants([self.derivative(k) for k in range(ORDER + 1)], None, self._road, root)

    @cached_property
    def _driven_in_world(self) -> Invariants:
        """The same for forces, also at a standstill."""
        return driven_invariants(self._in_world.r, None, self._road, self.t, self.duration, self.span, root)

    @cached_property
    def invariants(self) -> Invariants:
        """The invariants of the path; the vertical is world z."""
        return self.basis.invariants(self.rows)

    @cached_property
    def _with_vehicle(self) -> Invariants:
        """The invariants of the path for quantities that may depend on the wheelbase of the vehicle."""
        self.invariants.vehicle = self._road
        return self.invariants

    @cached_property
    def _driven(self) -> Invariants:
        """The invariants from which forces are computed; they are also defined at a standstill."""
        up = self.basis.local(UP) if self.basis.placed else None
        return driven_invariants(self.rows, up, self._road, self.t, self.duration, self.span, root)

    @cached_property
    def _road(self) -> Any:
        """The parameters of the vehicle; those that change along the way are NaN in a batch and under JAX."""
        if self.vehicle is not None and self.vehicle.on_changing_road and self._one is not None:
            return road_on(self.vehicle, self._one).at(np.asarray(self.t[0])).each(lambda x: x[None])
        parameters = fixed_parameters(self.vehicle, self.duration.dtype)
        return parameters.each(lambda x: x[:, None] if xp.ndim(x) else x)  # shared by all instants of a path

    @property
    def force(self) -> Triple:
        """The force [N] that moves the vehicle along the path, in the requested axes."""
        force = path_force(self._road, self.rows, self.basis.local(UP), root(self.invariants.S))
        if self.axes != BODY:
            return self.basis.world(force)
        tangent, normal, binormal = (dot(axis, force) for axis in self._frame.axes)
        return tangent, normal, binormal

    @property
    def moment(self) -> Triple:
        """The moment [N m] that rotates the vehicle with the frame, in the requested axes."""
        frame = self._frame
        return self._in_axes(turning_moment(self.vehicle, frame.rate, frame.acceleration))

    @property
    def speed(self) -> Array:
        """The speed |r'| [m/s]."""
        return root(self.invariants.S)

    @property
    def curvature(self) -> Array:
        """The curvature κ [1/m]; 0 where the speed is zero."""
        return curvature(self.invariants, self.span)

    @cached_property
    def torsion(self) -> Array:
        """The torsion χ [1/m]; 0 where the path is straight or the speed is zero."""
        return torsion(self.invariants, self.span)

    @property
    def dcm(self) -> tuple[Array, ...]:
        """The direction cosines, world to body, row by row."""
        tangent, normal, binormal = (self.basis.world(axis) for axis in self._frame.axes)
        return (*tangent, *normal, *binormal)

    @cached_property
    def quaternion(self) -> Quaternion:
        """The unit quaternion, body to world; its first non-zero component is positive."""
        q = self.basis.world_quaternion(hamilton.from_axes(*self._frame.axes, inverse_root))
        sign = xp.where(hamilton.is_negative(q), -1.0, 1.0).astype(q[0].dtype)
        return sign * q[0], sign * q[1], sign * q[2], sign * q[3]

    @property
    def gibbs(self) -> tuple[Array, ...]:
        """The Gibbs vector."""
        return _gibbs(self.quaternion)

    @property
    def rate(self) -> Triple:
        """The angular rate [rad/s] of the frame, in the requested axes."""
        return self._in_axes(self._frame.rate)

    @property
    def acceleration(self) -> Triple:
        """The angular acceleration [rad/s²] of the frame, in the requested axes."""
        return self._in_axes(self._frame.acceleration)

    def _in_axes(self, v: Triple) -> Triple:
        """Convert a vector from the axes of the frame to the requested axes."""
        if self.axes == BODY:
            return v
        a, b, c = (scaled(axis, part) for axis, part in zip(self._frame.axes, v, strict=True))
        return self.basis.world(add_vectors(add_vectors(a, b), c))

    @property
    def defined(self) -> Array:
        """Whether the frame is defined."""
        return self._frame.defined

    @cached_property
    def _frame(self) -> FrameComponents:
        found = self.frame.components_at(self.t, self.invariants, self.basis, self.span)
        return self._other() if found is None else found

    def _other(self) -> FrameComponents:
        """Evaluate, instant by instant, a frame that does not provide components."""
        rows = xp.stack([xp.stack(self.derivative(k), axis=-1) for k in range(ORDER + 1)], axis=-2)
        spans = xp.broadcast_to(self.span, rows.shape[:2])
        t = xp.broadcast_to(self.t.astype(rows.dtype), spans.shape)
        at = jax.vmap(jax.vmap(self.frame.at))(t, rows, spans)
        vectors = (at.tangent, at.normal, at.binormal, at.rate, at.acceleration)
        tangent, normal, binormal, rate, acceleration = (triple(v) for v in vectors)
        axes = self.basis.local(tangent), self.basis.local(normal), self.basis.local(binormal)
        return FrameComponents(axes, rate, acceleration, at.defined)


def _moving_derivatives(paths: MovingPolynomials, t: Times) -> tuple[list[Triple], Array, Any]:
    """Return the derivatives of orders 0 to 4 of the paths in the moving basis, and its angle [rad] and rate [rad/s].

    A rate that is always zero is the integer 0.
    """
    present = [paths.x, paths.z, paths.angle, *([] if paths.y is None else [paths.y])]
    single = [c for p in present for c in _columns(p.astype(t.dtype))]
    coefficients = iter(derivatives_in_one_loop([xp.broadcast_to(c, (c.shape[0], t.shape[1])) for c in single]))
    x, z, angle, *y = (
        polynomial.taylor_terms([next(coefficients) for _ in range(p.shape[1])], t, ORDER) for p in present
    )
    return in_moving_basis(x, y[0] if y else [0] * len(x), z, angle), angle[0], angle[1]  # type: ignore[return-value]


def _columns(c: Float[Array, "paths n"]) -> Sequence[Any]:
    """Return the columns (paths, 1); XLA compiles a split to faster loops than slices."""
    return np.split(c, c.shape[1], axis=1) if is_host(c) else split(c, [1] * c.shape[1], axis=1)


def _world_derivatives(paths: AbstractHodograph, t: Times) -> list[Triple]:
    """Return the derivatives of orders 0 to 4 of paths that are not polynomial, in world axes."""
    if is_host(t) and paths.supports_numpy:  # one path
        path = jax.tree.map(lambda x: x[0], paths)
        return [triple(x[None]) for x in path.sampled(t[0], ORDER)]
    along = lambda path, t: jax.vmap(lambda t: path.derivatives(t, ORDER))(t)  # noqa: E731
    each = xp.broadcast_to(t, (paths.duration.shape[0], t.shape[1]))
    r = eqx.filter_vmap(along, in_axes=(eqx.if_array(0), 0))(paths, each)
    return [triple(r[..., k, :]) for k in range(ORDER + 1)]


def _spans(paths: AbstractHodograph, t: Times) -> Array:
    """Return the spans of paths that are not polynomial, (paths, 1) or (paths, instants) [s]; see `regularity`."""
    if is_host(t) and paths.supports_numpy:  # one path
        return xp.atleast_1d(jax.tree.map(lambda x: x[0], paths).span(t[0]))[None]
    each = xp.broadcast_to(t, (paths.duration.shape[0], t.shape[1]))
    found = eqx.filter_vmap(lambda path, t: path.span(t), in_axes=(eqx.if_array(0), 0))(paths, each)
    return found.reshape(len(found), -1)


def _gibbs(q: Quaternion) -> tuple[Array, ...]:
    """Return the Gibbs vector λ_k/λ0, computed without a division; at half turns as in `rotation.to_gibbs`."""
    s = q[0]
    square = s * s
    regular = square >= float(xp.finfo(s.dtype).tiny)
    inverse = s * inverse_root(square, regular) ** 2
    infinite = [stop_gradient(xp.where(u > 0, xp.inf, xp.where(u < 0, -xp.inf, 0.0)).astype(s.dtype)) for u in q[1:]]
    return tuple(xp.where(regular, u * inverse, x) for u, x in zip(q[1:], infinite, strict=True))
