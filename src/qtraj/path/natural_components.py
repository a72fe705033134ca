"""The natural trihedral along a spiral-helix at many instants at once, in components.

The same definitions as `trihedral.Natural`, in a form that compilers for CPUs turn into few fast loops: everything is
worked out in the rotating basis (e_ρ, e_φ, k), where the derivatives are polynomials; one cosine and one sine, of half
the angle, carry the results into the world. The quaternion is (cos φ/2 + k sin φ/2) ∘ that of the trihedral in the
rotating basis. Of an instant there are neither roots, divisions nor branches, each of which would make several loops of
one.

Arrays are (paths, instants). Where the trihedral does not exist the numbers are the fillers of `trihedral.Natural`.
"""

import equinox as eqx
import jax.numpy as jnp
from jax.lax import rsqrt, split, stop_gradient
from jaxtyping import Array, Float

from qtraj.foundation.one_loop import derivatives_in_one_loop
from qtraj.path.components import Component, Triple, chosen, cross, dot, jet, scaled
from qtraj.path.invariants import invariants, largest, rotating_components
from qtraj.path.inverse_root import inverse_root, root
from qtraj.path.natural_rates import natural_acceleration, natural_rate
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.trigonometry import cos_sin
from qtraj.path.trihedral import DEFINED_TOLERANCE

Instants = Float[Array, "paths instants"]
Quaternion = tuple[Array, Array, Array, Array]


def natural_components(paths: SpiralHelix, t: Instants) -> dict[str, tuple[Array, ...]]:
    """Every output of a batched evaluation by its name, each component an array (paths, instants).

    `paths` is a stack, its arrays with a leading axis; `t` [s] is (paths, instants) or (1, instants).
    """
    turned = _Turned(paths, t)
    r = [_full(row, t) for row in turned.rows]
    of = invariants(r[1], r[2], r[3])
    speeds, areas = largest(of, r[2], r[3], paths.duration[:, None].astype(t.dtype))
    limits = jnp.finfo(t.dtype)
    tolerance = (DEFINED_TOLERANCE * float(limits.eps)) ** 2
    moving = jnp.maximum(speeds * tolerance, limits.tiny) < of.S
    bending = moving & (jnp.maximum(areas * tolerance, limits.tiny) < of.N)
    # 1/v and 1/|c|, and 0 where they do not exist, so that all that they multiply vanishes there.
    slowness, narrowness = inverse_root(of.S, moving), inverse_root(of.N, bending)
    c = cross(r[1], r[2])
    tangent, normal, binormal = _axes(turned, r[1], scaled(c, narrowness), bending)
    quaternion = turned.world_quaternion(_quaternion(tangent, normal, binormal))
    torsion = of.T * narrowness**2
    nothing = jnp.zeros_like(torsion)
    along, across = natural_rate(of, slowness, narrowness, torsion)
    along_rate, across_rate = natural_acceleration(r, c, of, slowness, narrowness, torsion)
    return {
        "position": turned.world_position(r[0]),
        "velocity": turned.world(r[1]),
        "acceleration": turned.world(r[2]),
        "jerk": turned.world(r[3]),
        "dcm": (*turned.world(tangent), *turned.world(normal), *turned.world(binormal)),
        "quaternion": quaternion,
        "gibbs": _gibbs(quaternion),
        "speed": (root(of.S),),
        "curvature": (root(of.N) * slowness**3,),
        "torsion": (torsion,),
        "rate": (along, nothing, across),
        "angular_acceleration": (along_rate, nothing, across_rate),
        "defined": (bending,),
    }


class _Turned(eqx.Module):
    """The rotating bases of a stack of paths: their rows of derivatives, and the way into the world."""

    rows: list[Triple]
    half_cos: Array
    half_sin: Array
    orientation: Quaternion | None
    origin: Triple | None

    def __init__(self, paths: SpiralHelix, t: Instants):
        jets = _jets([x.astype(t.dtype) for x in (paths.radius, paths.angle, paths.height)], t)
        self.rows = rotating_components(*jets)
        self.half_cos, self.half_sin = cos_sin(0.5 * jets[1][0])
        self.orientation = self.origin = None
        if paths.placement is not None:
            self.orientation = _unit(paths.placement.orientation.astype(t.dtype))
            origin = paths.placement.origin.astype(t.dtype)
            self.origin = (origin[:, 0, None], origin[:, 1, None], origin[:, 2, None])

    def world(self, v: Triple) -> Triple:
        """World components of a free vector."""
        cos, sin = 1 - 2 * self.half_sin**2, 2 * self.half_sin * self.half_cos
        local = v[0] * cos - v[1] * sin, v[0] * sin + v[1] * cos, v[2]
        if self.orientation is None:
            return local
        x, y, z = _matrix(self.orientation)
        return dot(x, local), dot(y, local), dot(z, local)

    def world_position(self, v: Triple) -> Triple:
        x, y, z = self.world(v)
        if self.origin is None:
            return x, y, z
        return x + self.origin[0], y + self.origin[1], z + self.origin[2]

    def rotating(self, k: int) -> Triple:
        """The k-th axis of the world in the rotating basis."""
        zero, one = jnp.zeros_like(self.half_cos), jnp.ones_like(self.half_cos)
        x, y, z = ((one, zero, zero), (zero, one, zero), (zero, zero, one))[k]
        if self.orientation is not None:
            row = _matrix(self.orientation)[k]
            x, y, z = row[0] + zero, row[1] + zero, row[2] + zero
        cos, sin = 1 - 2 * self.half_sin**2, 2 * self.half_sin * self.half_cos
        return x * cos + y * sin, y * cos - x * sin, z

    def world_quaternion(self, q: Quaternion) -> Quaternion:
        """The quaternion to the world, first non-zero component positive, of one to the rotating basis."""
        c, s = self.half_cos, self.half_sin
        w, x, y, z = c * q[0] - s * q[3], c * q[1] - s * q[2], c * q[2] + s * q[1], c * q[3] + s * q[0]
        if self.orientation is not None:
            w, x, y, z = _product(self.orientation, (w, x, y, z))
        negative = (w < 0) | ((w == 0) & ((x < 0) | ((x == 0) & ((y < 0) | ((y == 0) & (z < 0))))))
        sign = jnp.where(negative, -1.0, 1.0).astype(w.dtype)
        return sign * w, sign * x, sign * y, sign * z


def _jets(polynomials: list[Float[Array, "paths _"]], t: Float[Array, "rows instants"]) -> list[list[Component]]:
    """Taylor coefficients of the polynomials at `t`, orders 0 … 4."""
    single = [c for p in polynomials for c in split(p, [1] * p.shape[1], axis=1)]
    spread = iter(derivatives_in_one_loop([jnp.broadcast_to(c, (c.shape[0], t.shape[1])) for c in single]))
    return [jet([next(spread) for _ in range(p.shape[1])], t, 4) for p in polynomials]


def _unit(orientations: Float[Array, "paths 4"]) -> Quaternion:
    q = orientations / stop_gradient(jnp.max(jnp.abs(orientations), axis=-1, keepdims=True))
    q = q * rsqrt(jnp.sum(q * q, axis=-1, keepdims=True))
    return q[:, 0, None], q[:, 1, None], q[:, 2, None], q[:, 3, None]


def _matrix(q: Quaternion) -> tuple[Triple, Triple, Triple]:
    """The rows of R(q), entry by entry."""
    w, x, y, z = q
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


def _axes(turned: _Turned, r1: Triple, bend: Triple, bending: Array) -> tuple[Triple, Triple, Triple]:
    """τ, n and b in the rotating basis; `bend` is c/|c| where the path bends."""
    S = dot(r1, r1)
    still = jnp.less(S, jnp.finfo(S.dtype).tiny)
    tangent = chosen(still, turned.rotating(0), scaled(r1, inverse_root(S, ~still)))
    tangent, across = _with_fillers(turned, tangent, bend, bending)
    # n from c × τ, then b = τ × n: orthonormal to round-off also where c has lost most of its digits.
    towards = cross(across, tangent)
    normal = scaled(towards, inverse_root(dot(towards, towards)))
    return tangent, normal, cross(tangent, normal)


def _with_fillers(turned: _Turned, tangent: Triple, bend: Triple, bending: Array) -> tuple[Triple, Triple]:
    """τ, and a vector along b: level with the world where the path does not bend, as in `trihedral`."""
    up, forward = turned.rotating(2), turned.rotating(0)
    reference = chosen(dot(up, tangent) ** 2 > 0.75, forward, up)
    along = dot(reference, tangent)
    x, y, z = scaled(tangent, along)
    level = (reference[0] - x, reference[1] - y, reference[2] - z)
    return tangent, chosen(bending, bend, level)


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


def _product(p: Quaternion, q: Quaternion) -> Quaternion:
    """p∘q by Hamilton's rule."""
    a, b, c, d = p
    s, x, y, z = q
    return (
        a * s - b * x - c * y - d * z,
        a * x + b * s + c * z - d * y,
        a * y - b * z + c * s + d * x,
        a * z + b * y - c * x + d * s,
    )


def _gibbs(q: Quaternion) -> tuple[Array, ...]:
    """G_k = λ_k/λ0; as `gibbs.to_gibbs` at half turns."""
    s = q[0]
    square = s * s
    regular = square >= jnp.finfo(s.dtype).tiny
    inverse = s * inverse_root(square, regular) ** 2
    far = [stop_gradient(jnp.where(u > 0, jnp.inf, jnp.where(u < 0, -jnp.inf, 0.0)).astype(s.dtype)) for u in q[1:]]
    return tuple(jnp.where(regular, u * inverse, x) for u, x in zip(q[1:], far, strict=True))


def _full(row: Triple, t: Instants) -> Triple:
    """The row with arrays for the entries that vanish identically."""
    return tuple(x if isinstance(x, Array) else jnp.zeros_like(t) for x in row)  # type: ignore[return-value]
