"""Limits as inequalities between polynomials in s = 2t/duration − 1 (paper S).

In the moving basis every derivative is a polynomial: those of R_z(φ)·(a, b, h) follow from (a, b)' = (a' − bφ',
b' + aφ'). So a quantity's square is numerator/denominator, and a limit holds where limit² · denominator − numerator ≥ 0
and the divisor is positive. Time is counted in half durations and lengths in a power of two near the size of the path,
so that nothing overflows at high degrees.
"""

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from qtraj.algebra.cell_polynomial import CellPolynomial, cell_polynomial
from qtraj.algebra.cells import PerPath
from qtraj.algebra.chebyshev_model import AXIS, ChebyshevModel, after, multiple
from qtraj.path.components import Triple, cross, dot
from qtraj.path.frenet import Invariants
from qtraj.path.moving_basis import MovingPolynomials
from qtraj.path.quantity import PathQuantity

ORDER = 4

UNDERFLOW = 2.0**-500
"""What underflow can do to a derivative, in units of the length: as long as that is no smaller [m]."""


class Vectors(eqx.Module):
    """Vectors at many instants, worked out in numbers; their components stay apart, which makes faster loops."""

    x: Array
    y: Array
    z: Array

    @property
    def components(self) -> Triple:
        """x, y and z."""
        return (self.x, self.y, self.z)

    def __getitem__(self, index: Any) -> Any:
        return self.components[index]

    def __matmul__(self, other: "Vectors") -> Array:
        return _scalar_product(self.components, other.components)

    def cross(self, other: "Vectors") -> "Vectors":
        """The vector product."""
        return Vectors(*_vector_product(self.components, other.components))


class Parts(eqx.Module):
    """The derivatives r', r'', … of many paths in s, in units of `length` [m] and half durations `unit` [s]."""

    derivatives: list[CellPolynomial]
    length: PerPath
    unit: PerPath


def parts(path: MovingPolynomials, duration: PerPath, roundings: int = 0) -> Parts:
    """The first derivatives of paths that stand side by side on the last axis of all coefficients.

    `roundings` is how often each coefficient has been rounded before, relatively.
    """
    unit = 0.5 * duration
    # Where height and azimuth begin does not count, and must not coarsen what does.
    y = jnp.zeros_like(path.x[:1]) if path.y is None else path.y
    given = [path.x, y, path.z.at[0].set(0.0), path.angle.at[0].set(0.0)]
    scaled = [_in_units(c, unit) for c in given]
    sizes = jnp.stack([jnp.max(jnp.abs(c[:, 0]), axis=0) for c in scaled[:3]])
    length = _power_of_two(jnp.max(sizes, axis=0))
    lengths = [c / length[None, None] for c in scaled[:3]]
    # The magnitudes of all coefficients go along, as further paths: what is summed up bounds what is rounded.
    x, y, z, angle = (centred(jnp.concatenate([c, jnp.abs(c)], axis=-1)) for c in (*lengths, scaled[3]))
    signs = jnp.concatenate([jnp.full_like(unit, -1.0), jnp.ones_like(unit)])
    degrees = [c.shape[0] - 1 for c in scaled]
    normal = _normal(unit) & _normal(unit ** max(degrees)) & (length > UNDERFLOW) & (length < 1 / UNDERFLOW)
    found: list[CellPolynomial] = []
    for order, rows in enumerate(_derivatives(x, y, z, angle, signs), start=1):
        a, bound = jnp.split(rows, 2, axis=-1)
        count = _roundings(max(degrees[:3]), degrees[3], order) + roundings
        size = jnp.max(jnp.sum(bound, axis=AXIS), axis=0)
        error = after(jnp.full_like(size, UNDERFLOW), count, size)
        found.append(cell_polynomial(a, jnp.where(normal, error, jnp.inf)))
    return Parts(found, length, unit)


def slack(entry: PathQuantity, i: Invariants, bound: tuple[Array, Array]) -> ChebyshevModel:
    """limit² · denominator − numerator in cells: the limit holds where this is not negative."""
    numerator = entry.numerator(i)
    denominator = numerator.one() if entry.denominator is None else entry.denominator(i)
    return multiple(denominator, *bound) - numerator


def squared_bound(limit: PerPath, scale: PerPath) -> tuple[Array, Array]:
    """The square of a limit in the units of `Parts`, and a bound on its rounding."""
    bound = limit * scale
    square = bound * bound
    normal = _normal(bound) & _normal(square) & _normal(scale)
    rounding = jnp.where(normal, 16 * float(jnp.finfo(bound.dtype).eps) * square, jnp.inf)
    return square[None], rounding[None]


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
def centred(coefficients: Float[Array, "k 1 paths"]) -> Array:
    """Coefficients in s of Σ a_k (1 + s)^k; of n + 1 coefficients each term has at most n + 1 roundings."""
    n = coefficients.shape[0] - 1
    weights = [[math.comb(k, i) for k in range(n + 1)] for i in range(n + 1)]
    return jnp.sum(
        jnp.asarray(np.array(weights, float), coefficients.dtype)[:, :, None, None] * coefficients[None], axis=1
    )


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


def _padded(c: Array, degree: int) -> Array:
    """The same polynomial with coefficients up to a higher degree."""
    more = degree + 1 - c.shape[AXIS]
    return jnp.pad(c, [(0, more), (0, 0), (0, 0)])


def _convolved(p: Float[Array, "m 1 paths"], q: Float[Array, "n 1 paths"]) -> Array:
    """Coefficients of the product of two polynomials."""
    m = p.shape[0]
    terms = [jnp.pad(p[i][None] * q, [(i, m - 1 - i), (0, 0), (0, 0)]) for i in range(m)]
    return sum(terms[1:], terms[0])


_scalar_product, _vector_product = jax.jit(dot), jax.jit(cross)
