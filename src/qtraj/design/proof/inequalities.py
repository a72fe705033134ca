"""Limits as inequalities between polynomials in s = 2t/duration − 1 (paper S).

In the moving basis every derivative is a polynomial: those of R_z(φ)·(a, b, h) follow from (a, b)' = (a' − bφ',
b' + aφ'). So a quantity's square is numerator/denominator, and a limit holds where limit² · denominator − numerator ≥ 0
and the divisor is positive. Time is counted in half durations and lengths in a power of two near the size of the path,
so that nothing overflows at high degrees.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from qtraj.algebra.cells import Cells, PerPath
from qtraj.algebra.chebyshev_model import AXIS, FLOOR, POINTS, SLACK, ChebyshevModel, after, multiple
from qtraj.algebra.cells import reach
from qtraj.path.components import Triple, cross, dot
from qtraj.path.frenet import Invariants
from qtraj.path.moving_basis import MovingPolynomials
from qtraj.path.quantity import QUANTITIES, PathQuantity

ORDER = 4

UNDERFLOW = 2.0**-500
"""What underflow can do to a derivative, in units of the length: as long as that is no smaller [m]."""


class Vectors(eqx.Module):
    """Vectors at many instants, worked out in numbers; their components stay apart, which makes faster loops."""

    components: tuple[Array, Array, Array]

    def __getitem__(self, index: Any) -> Any:
        return self.components[index]

    def __matmul__(self, other: "Vectors") -> Array:
        return _scalar_product(self.components, other.components)

    def cross(self, other: "Vectors") -> "Vectors":
        """The vector product."""
        return Vectors(_vector_product(self.components, other.components))


class Derivative(eqx.Module):
    """One derivative of many paths in s, in the moving basis: `coefficients` (3, k, 1, paths), and in `shifts`
    (l, 3, k, 1, paths) those of its l-th derivative over l!; `error` bounds what rounding did to a value, also in a
    shift to another centre.
    """

    coefficients: Float[Array, "3 k 1 paths"]
    shifts: Float[Array, "k 3 k 1 paths"]
    error: Float[Array, "1 paths"]

    def on(self, centre: Cells, half: Cells) -> ChebyshevModel:
        """It in cells `centre` ± `half` of [−1, 1], which must be exact in binary: powers of a half width are, too."""
        return _shifted(self, centre, half)

    def at(self, s: Cells) -> Vectors:
        """Its values at instants s."""
        return Vectors(_valued(self.coefficients, s))


class Parts(eqx.Module):
    """The derivatives r', r'', … of many paths in s, in units of `length` [m] and half durations `unit` [s]."""

    derivatives: list[Derivative]
    length: PerPath
    unit: PerPath


def parts(path: MovingPolynomials, duration: PerPath) -> Parts:
    """The first derivatives of paths that stand side by side on the last axis of all coefficients."""
    unit = 0.5 * duration
    # Where height and azimuth begin does not count, and must not coarsen what does.
    y = jnp.zeros_like(path.x[:1]) if path.y is None else path.y
    given = [path.x, y, path.z.at[0].set(0.0), path.angle.at[0].set(0.0)]
    scaled = [_in_units(c, unit) for c in given]
    sizes = jnp.stack([jnp.max(jnp.abs(c[:, 0]), axis=0) for c in scaled[:3]])
    length = _power_of_two(jnp.max(sizes, axis=0))
    lengths = [c / length[None, None] for c in scaled[:3]]
    # The magnitudes of all coefficients go along, as further paths: what is summed up bounds what is rounded.
    both = [_centred(jnp.concatenate([c, jnp.abs(c)], axis=-1)) for c in (*lengths, scaled[3])]
    signs = jnp.concatenate([jnp.full_like(unit, -1.0), jnp.ones_like(unit)])
    degrees = [c.shape[0] - 1 for c in scaled]
    normal = _normal(unit) & _normal(unit ** max(degrees)) & (length > UNDERFLOW) & (length < 1 / UNDERFLOW)
    found: list[Derivative] = []
    for order, rows in enumerate(_derivatives(*both, signs), start=1):
        a, bound = jnp.split(rows, 2, axis=-1)
        count = _roundings(max(degrees[:3]), degrees[3], order) + 2 * a.shape[AXIS]
        size = jnp.max(jnp.sum(bound, axis=AXIS), axis=0)
        error = after(jnp.full_like(size, UNDERFLOW), count, size)
        found.append(Derivative(a, _shifts(a), jnp.where(normal, error, jnp.inf)))
    return Parts(found, length, unit)


def slack(entry: PathQuantity, i: Invariants, bound: tuple[Array, Array]) -> ChebyshevModel:
    """limit² · denominator − numerator in cells: the limit holds where this is not negative."""
    numerator = entry.numerator(i)
    denominator = _one(numerator) if entry.denominator is None else entry.denominator(i)
    return multiple(denominator, *bound) - numerator


def squared_bound(limit: PerPath, scale: PerPath) -> tuple[Array, Array]:
    """The square of a limit in the units of `Parts`, and a bound on its rounding."""
    bound = limit * scale
    square = bound * bound
    normal = _normal(bound) & _normal(square) & _normal(scale)
    rounding = jnp.where(normal, 16 * float(jnp.finfo(bound.dtype).eps) * square, jnp.inf)
    return square[None], rounding[None]


def invariants_on(parts: Parts, centre: Cells, half: Cells, order: int) -> Invariants:
    """The invariants as Taylor models in cells."""
    return Invariants([None, *(r.on(centre, half) for r in parts.derivatives[:order])])


@jax.jit
def _shifted(r: Derivative, centre: Cells, half: Cells) -> ChebyshevModel:
    c = r.shifts[-1]
    for shift in reversed([r.shifts[k] for k in range(r.shifts.shape[0] - 1)]):
        c = c * centre[None, None] + shift
    powers = [jnp.ones_like(half)]
    for _ in range(c.shape[AXIS] - 1):
        powers.append(powers[-1] * half)
    c = c * jnp.stack(powers)[None]
    sizes, far = jnp.max(jnp.abs(c), axis=0), reach(half)
    points = jnp.asarray(POINTS, c.dtype)[:, None, None]
    values, bound = c[:, -1:] * jnp.ones_like(points), sizes[-1]
    for k in reversed(range(c.shape[AXIS] - 1)):
        values, bound = values * points[None] + c[:, k : k + 1], bound * far + sizes[k]
    size = jnp.sum(sizes, axis=0) * SLACK + FLOOR
    return ChebyshevModel(values, size, after(r.error, 2 * c.shape[AXIS], size), (bound + r.error) * SLACK)


@jax.jit
def _valued(coefficients: Float[Array, "3 k 1 paths"], s: Cells) -> Triple:
    found = []
    for c in coefficients:
        value = c[-1] + jnp.zeros_like(s)
        for k in reversed(range(c.shape[0] - 1)):
            value = value * s + c[k]
        found.append(value)
    return found[0], found[1], found[2]


@jax.jit
def _shifts(coefficients: Float[Array, "3 k 1 paths"]) -> Array:
    """All Taylor coefficients: row l holds those of the l-th derivative over l!."""
    n = coefficients.shape[AXIS] - 1
    weights = jnp.asarray(_binomials(n), coefficients.dtype)[:, :, None, None]
    rows = [jnp.pad(coefficients[:, k:], [(0, 0), (0, k), (0, 0), (0, 0)]) for k in range(n + 1)]
    return weights[:, None] * jnp.stack(rows)


def _derivatives(x: Array, y: Array, z: Array, angle: Array, signs: Array) -> list[Array]:
    """r', r'', …; of paths whose coefficients are magnitudes and whose sign is 1, bounds on all that is summed up."""
    turning, found = _derived(angle), []
    for _ in range(ORDER):
        across, along = _convolved(turning, y), _convolved(turning, x)
        x, y, z = _sum(_derived(x), signs[None, None] * across), _sum(_derived(y), along), _derived(z)
        n = max(a.shape[AXIS] for a in (x, y, z)) - 1
        found.append(jnp.stack([_padded(a, n) for a in (x, y, z)]))
    return found


def _derived(c: Array) -> Array:
    n = c.shape[AXIS] - 1
    return c[1:] * jnp.arange(1, n + 1, dtype=c.dtype)[:, None, None] if n else jnp.zeros_like(c)


def _sum(p: Array, q: Array) -> Array:
    n = max(p.shape[AXIS], q.shape[AXIS]) - 1
    return _padded(p, n) + _padded(q, n)


def _roundings(degree: int, turning: int, order: int) -> int:
    """Of any term of a coefficient of the derivative of this order, from the given coefficients on.

    To bring coefficients to s takes 2n + 3: n + 1 for the powers of time, one for the binomial and n for the sum. Each
    derivative multiplies, sums up to `turning` products and adds, and takes in the roundings of φ'.
    """
    first = 2 * max(degree, turning) + 4
    return first + order * (turning + 4 + first)


@jax.jit
def _centred(coefficients: Float[Array, "k 1 paths"]) -> Array:
    """Coefficients in s of Σ a_k (1 + s)^k."""
    n = coefficients.shape[0] - 1
    weights = [[math.comb(k, i) for k in range(n + 1)] for i in range(n + 1)]
    return jnp.sum(jnp.asarray(np.array(weights, float), coefficients.dtype)[:, :, None, None] * coefficients[None], axis=1)


def _in_units(coefficients: Float[Array, "k paths"], unit: PerPath) -> Float[Array, "k 1 paths"]:
    """Coefficients in t/unit."""
    powers = [jnp.ones_like(unit)]
    for _ in range(coefficients.shape[0] - 1):
        powers.append(powers[-1] * unit)
    return (coefficients * jnp.stack(powers))[:, None]


def _normal(x: Array) -> Bool[Array, " paths"]:
    """Whether a positive number is far from overflow and underflow, so that its rounding is relative."""
    limits = jnp.finfo(x.dtype)
    return (x > float(limits.tiny) / float(limits.eps)) & (x < float(limits.max) * float(limits.eps))


def _power_of_two(size: PerPath) -> PerPath:
    """The greatest that does not exceed `size`; 1 where that is not positive and finite."""
    exponent = jax.lax.bitcast_convert_type(size, jnp.int64) & 0x7FF0000000000000
    found = jax.lax.bitcast_convert_type(exponent, size.dtype)
    return jnp.where((found > 0) & (found < jnp.inf), found, 1.0)


def _binomials(n: int) -> np.ndarray:
    """C(k+l, l) over l and k, 0 … n; 0 where k + l > n."""
    return np.array([[math.comb(k + j, j) if k + j <= n else 0 for k in range(n + 1)] for j in range(n + 1)], float)


def _padded(c: Array, degree: int) -> Array:
    """The same polynomial with coefficients up to a higher degree."""
    more = degree + 1 - c.shape[AXIS]
    return jnp.pad(c, [(0, more), (0, 0), (0, 0)])


def _convolved(p: Float[Array, "m 1 paths"], q: Float[Array, "n 1 paths"]) -> Array:
    """Coefficients of the product of two polynomials."""
    m, n = p.shape[0], q.shape[0]
    terms = [jnp.pad(p[i][None] * q, [(i, m - 1 - i), (0, 0), (0, 0)]) for i in range(m)]
    return sum(terms[1:], terms[0])


def _one(like: ChebyshevModel) -> ChebyshevModel:
    """The constant 1."""
    ones = jnp.ones_like(like.error)
    return ChebyshevModel(jnp.ones_like(like.values), ones, 0.0 * ones, ones)


_scalar_product, _vector_product = jax.jit(dot), jax.jit(cross)
