"""Paths and their frames at many instants at once, in components.

The definitions are those of `trihedral` and `quantity`, in a form that compilers for CPUs turn into few fast loops.
The derivatives stand in the path's moving basis, where they are polynomials; one cosine and one sine, of half the
angle, carry the results into the world. The quaternion is that of the moving basis times that of the frame in it. Of an
instant there are neither roots, divisions nor branches, each of which would make several loops of one.

Arrays are (paths, instants). Where a frame does not exist the numbers are the fallback values of `trihedral`.
"""

from functools import cached_property
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.lax import split, stop_gradient
from jaxtyping import Array, Float

from qtraj.algebra import hamilton, quaternion, rotation
from qtraj.batch.cpu import DIVISION, cos_sin, derivatives_in_one_loop, inverse_root, root
from qtraj.path.components import Triple, chosen, cross, dot, jet, scaled, times, total
from qtraj.path.frenet import Invariants, natural_acceleration, natural_rate, upright_rates
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.moving_basis import MovingPolynomials, moving_components
from qtraj.path.placement import Placement
from qtraj.path.quantity import PathQuantity
from qtraj.path.rate_axes import BODY
from qtraj.path.regularity import bends, leaves_vertical, moves
from qtraj.path.trihedral import STEEP, AbstractFrame, Natural, Upright

Times = Float[Array, "rows instants"]
Quaternion = tuple[Array, Array, Array, Array]

ORDER = 4
"""The highest derivative of a path that anything needs."""

FORWARD, UP = (1, 0, 0), (0, 0, 1)
"""Axes of the world: integers cost nothing."""


class Hung(NamedTuple):
    """A frame on a path: its axes in the path's basis, its rate and acceleration in its own axes."""

    axes: tuple[Triple, Triple, Triple]
    rate: Triple
    acceleration: Triple
    defined: Array


class Instants:
    """What is known of a stack of paths (every array with a leading axis) at instants (paths or 1, instants) [s].

    Vectors are triples of arrays. Each is formed when it is first asked for.
    """

    def __init__(self, paths: AbstractHodograph, t: Times, frame: AbstractFrame, axes: str = BODY):
        self.frame, self.t, self.axes = frame, t, axes
        known = eqx.filter_vmap(lambda path: path.polynomials())(paths)
        if known is None:
            self.basis, rows = Basis(), _world_rows(paths, t)
        else:
            t = t.astype(known.x.dtype)
            rows, angle = _moving_rows(known, t)
            self.basis = Basis(angle, known.placement)
        nothing = jnp.zeros_like(rows[0][0])
        self.rows = [_full(row, nothing) for row in rows]
        self.duration = paths.duration[:, None].astype(nothing.dtype)

    def derivative(self, k: int) -> Triple:
        """The k-th derivative of r, world axes."""
        x, y, z = self.basis.world(self.rows[k])
        if k or not self.basis.placed:
            return x, y, z
        return x + self.basis.origin[0], y + self.basis.origin[1], z + self.basis.origin[2]

    def magnitude(self, entry: PathQuantity) -> Array:
        """A path quantity by the formula of its entry."""
        return root(entry.squared(self.invariants, DIVISION))

    @cached_property
    def invariants(self) -> Invariants:
        """With the world's vertical."""
        return Invariants(self.rows, self.basis.local(UP) if self.basis.placed else None)

    @property
    def speed(self) -> Array:
        return root(self.invariants.S)

    @property
    def curvature(self) -> Array:
        i = self.invariants
        return root(i.N) * inverse_root(i.S, moves(i, self.duration)) ** 3

    @cached_property
    def torsion(self) -> Array:
        return self.invariants.T * self._inv_cross_norm**2

    @property
    def dcm(self) -> tuple[Array, ...]:
        tangent, normal, binormal = (self.basis.world(axis) for axis in self._hung.axes)
        return (*tangent, *normal, *binormal)

    @cached_property
    def quaternion(self) -> Quaternion:
        """That to the world, first non-zero component positive."""
        q = self.basis.world_quaternion(_quaternion(*self._hung.axes))
        sign = jnp.where(hamilton.is_negative(q), -1.0, 1.0).astype(q[0].dtype)
        return sign * q[0], sign * q[1], sign * q[2], sign * q[3]

    @property
    def gibbs(self) -> tuple[Array, ...]:
        return _gibbs(self.quaternion)

    @property
    def rate(self) -> Triple:
        return self._seen(self._hung.rate)

    @property
    def acceleration(self) -> Triple:
        return self._seen(self._hung.acceleration)

    def _seen(self, v: Triple) -> Triple:
        """A vector of the frame in the axes that are asked for."""
        if self.axes == BODY:
            return v
        a, b, c = (scaled(axis, part) for axis, part in zip(self._hung.axes, v, strict=True))
        return self.basis.world((total([a[0], b[0], c[0]]), total([a[1], b[1], c[1]]), total([a[2], b[2], c[2]])))

    @property
    def defined(self) -> Array:
        return self._hung.defined

    @cached_property
    def _bending(self) -> Array:
        return bends(self.invariants, self.duration)

    @cached_property
    def _inv_cross_norm(self) -> Array:
        return inverse_root(self.invariants.N, self._bending)

    @cached_property
    def _hung(self) -> Hung:
        if isinstance(self.frame, Natural):
            return self._natural()
        return self._upright(self.frame) if isinstance(self.frame, Upright) else self._other()

    def _natural(self) -> Hung:
        i, bending, inv_cross_norm = self.invariants, self._bending, self._inv_cross_norm
        # 1/v and 1/|c| are 0 where there is no trihedral, so that all that they multiply vanishes there.
        known = (i, inverse_root(i.S, bending), inv_cross_norm, self.torsion)
        rate, acceleration = natural_rate(*known), natural_acceleration(*known)
        nothing = jnp.zeros_like(i.S)
        axes = _axes(self.basis, self.rows[1], scaled(i.c, inv_cross_norm), bending)
        return Hung(axes, (rate[0], nothing, rate[1]), (acceleration[0], nothing, acceleration[1]), bending)

    def _upright(self, frame: Upright) -> Hung:
        x, y, z = frame.unit_up(self.duration.dtype)
        up = self.basis.local((x, y, z))
        i = Invariants(self.rows, up)
        defined = leaves_vertical(i, self.duration)
        rate, acceleration = upright_rates(i, inverse_root(i.S, defined), inverse_root(i.H, defined))
        axes = _axes(self.basis, self.rows[1], up, ~_vanishes(i.H))
        return Hung(axes, rate, acceleration, defined)

    def _other(self) -> Hung:
        """Any other frame, instant by instant."""
        rows = jnp.stack([jnp.stack(self.derivative(k), axis=-1) for k in range(ORDER + 1)], axis=-2)
        durations = jnp.broadcast_to(self.duration, rows.shape[:2])
        t = jnp.broadcast_to(self.t.astype(rows.dtype), durations.shape)
        at = jax.vmap(jax.vmap(self.frame.at))(t, rows, durations)
        known = (at.tangent, at.normal, at.binormal, at.rate, at.acceleration)
        tangent, normal, binormal, rate, acceleration = (_triple(v) for v in known)
        axes = self.basis.local(tangent), self.basis.local(normal), self.basis.local(binormal)
        return Hung(axes, rate, acceleration, at.defined)


class Basis:
    """The moving bases of paths: R_z(angle) in the axes of a placement, or the world's own axes."""

    def __init__(self, angle: Array | None = None, placement: Placement | None = None):
        self.turning, self.placed = angle is not None, placement is not None
        if angle is not None:
            cos, sin = self.half = cos_sin(0.5 * angle)
            self.cos, self.sin = 1 - 2 * sin**2, 2 * sin * cos
        if angle is not None and placement is not None:
            self.origin = _triple(placement.origin.astype(angle.dtype)[:, None])
            unit = jax.vmap(quaternion.unit)(placement.orientation.astype(angle.dtype))
            self.orientation = tuple(unit[:, k, None] for k in range(4))
            dcm = jax.vmap(rotation.to_dcm)(unit)[:, None]  # its rows are the placement's axes in the world
            self.columns, self.rows = ([_triple(m[..., k, :]) for k in range(3)] for m in (dcm, dcm.mT))

    def world(self, v: Triple) -> Triple:
        """World components of a free vector."""
        if self.turning:
            v = _turned(v, self.cos, self.sin)
        return (dot(self.rows[0], v), dot(self.rows[1], v), dot(self.rows[2], v)) if self.placed else v

    def local(self, v: Triple) -> Triple:
        """Components in the moving basis of a free vector given in world axes."""
        if self.placed:
            v = dot(self.columns[0], v), dot(self.columns[1], v), dot(self.columns[2], v)
        return _turned(v, self.cos, -self.sin) if self.turning else v

    def world_quaternion(self, q: Quaternion) -> Quaternion:
        """The quaternion to the world of one to the moving basis."""
        if self.turning:
            (c, s), (w, x, y, z) = self.half, q
            q = c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w
        return hamilton.product(self.orientation, q) if self.placed else q


def _turned(v: Triple, cos: Array, sin: Array) -> Triple:
    x, y, z = v
    return total([times(x, cos), times(y, -sin)]), total([times(x, sin), times(y, cos)]), z


def _moving_rows(known: MovingPolynomials, t: Times) -> tuple[list[Triple], Array]:
    """The derivatives in the moving basis, and its angle."""
    given = [known.x, known.z, known.angle, *([] if known.y is None else [known.y])]
    single = [c for p in given for c in split(p.astype(t.dtype), [1] * p.shape[1], axis=1)]
    spread = iter(derivatives_in_one_loop([jnp.broadcast_to(c, (c.shape[0], t.shape[1])) for c in single]))
    x, z, angle, *y = (jet([next(spread) for _ in range(p.shape[1])], t, ORDER) for p in given)
    return moving_components(x, y[0] if y else [0] * len(x), z, angle), angle[0]  # type: ignore[return-value]


def _world_rows(paths: AbstractHodograph, t: Times) -> list[Triple]:
    """The derivatives of paths without polynomials, world axes."""
    along = lambda path, t: jax.vmap(lambda t: path.derivatives(t, ORDER))(t)  # noqa: E731
    each = jnp.broadcast_to(t, (paths.duration.shape[0], t.shape[1]))
    r = eqx.filter_vmap(along, in_axes=(eqx.if_array(0), 0))(paths, each)
    return [_triple(r[..., k, :]) for k in range(ORDER + 1)]


def _axes(basis: Basis, r1: Triple, across: Triple, exists: Array) -> tuple[Triple, Triple, Triple]:
    """τ, n along `across` × τ, and b; where that does not exist, n is level as in `trihedral`."""
    S, forward, up = dot(r1, r1), basis.local(FORWARD), basis.local(UP)
    still = _vanishes(S)
    tangent = chosen(still, forward, scaled(r1, inverse_root(S, ~still)))
    reference = chosen(dot(up, tangent) ** 2 > STEEP, forward, up)
    x, y, z = scaled(tangent, dot(reference, tangent))
    # n from c × τ, then b = τ × n: orthonormal to round-off also where c has lost most of its digits.
    towards = cross(chosen(exists, across, (reference[0] - x, reference[1] - y, reference[2] - z)), tangent)
    normal = scaled(towards, inverse_root(dot(towards, towards)))
    return tangent, normal, cross(tangent, normal)


def _quaternion(tangent: Triple, normal: Triple, binormal: Triple) -> Quaternion:
    """The unit quaternion of a trihedral, of either sign, by two complex numbers u = w + ix and m = z − iy.

    um = (τ_y + iτ_z)/2, u² = (n_y + b_z + i(n_z − b_y))/2 and m² = (b_z − n_y − i(n_z + b_y))/2. The larger of the two
    is a square root, whose larger part is again taken first; the other follows by division: no digits are lost.
    """
    forward = tangent[0] >= 0
    real = jnp.where(forward, binormal[2] + normal[1], binormal[2] - normal[1])
    imaginary = jnp.where(forward, normal[2] - binormal[1], -normal[2] - binormal[1])
    modulus = 1 + jnp.abs(tangent[0])
    right = real >= 0
    larger = modulus + jnp.abs(real)
    scale = 0.5 * inverse_root(larger)
    a, b = jnp.where(right, larger, imaginary) * scale, jnp.where(right, imaginary, larger) * scale
    part = inverse_root(modulus) ** 2
    c, d = (tangent[1] * a + tangent[2] * b) * part, (tangent[2] * a - tangent[1] * b) * part
    w, x = jnp.where(forward, a, c), jnp.where(forward, b, d)
    z, y = jnp.where(forward, c, a), -jnp.where(forward, d, b)
    return w, x, y, z


def _gibbs(q: Quaternion) -> tuple[Array, ...]:
    """G_k = λ_k/λ0; as `gibbs.to_gibbs` at half turns."""
    s = q[0]
    square = s * s
    regular = square >= jnp.finfo(s.dtype).tiny
    inverse = s * inverse_root(square, regular) ** 2
    far = [stop_gradient(jnp.where(u > 0, jnp.inf, jnp.where(u < 0, -jnp.inf, 0.0)).astype(s.dtype)) for u in q[1:]]
    return tuple(jnp.where(regular, u * inverse, x) for u, x in zip(q[1:], far, strict=True))


def _vanishes(square: Array) -> Array:
    return square < float(jnp.finfo(square.dtype).tiny)


def _triple(v: Array) -> Triple:
    return v[..., 0], v[..., 1], v[..., 2]


def _full(row: Triple, zero: Array) -> Triple:
    """The row with arrays for the entries that vanish identically."""
    return tuple(zero if isinstance(x, int) else x for x in row)  # type: ignore[return-value]
