"""Limits as inequalities between polynomials in s = 2t/duration − 1 (paper S).

The position is R_z(φ)·(a, b, h), where R_z is the rotation about the axis, and a, b, h and φ are polynomials. In this
moving basis every derivative of the position has polynomial components: the derivative of the vector with the
components a and b has the components a' − bφ' and b' + aφ'. So the square of a quantity is a quotient of polynomials,
and a limit is satisfied where limit² · denominator − numerator ≥ 0 and the divisor is positive. The unit of time is
half the duration, and the unit of length is a power of two close to the size of the path. With these units, polynomials
of high degree do not overflow.
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
from qtraj.algebra.chebyshev_model import AXIS, ChebyshevModel, add_rounding, multiple
from qtraj.design.proof.road import Bound
from qtraj.path.components import Triple, cross, dot
from qtraj.path.frenet import Invariants
from qtraj.path.moving_basis import MovingPolynomials
from qtraj.path.path_quantity import PathQuantity

ORDER = 4

UNDERFLOW = 2.0**-500
"""Bound on the underflow error of a derivative, in units of `PathDerivatives.length`, and lower bound on this length.
"""


class Vectors(eqx.Module):
    """Vectors at many instants; separate arrays for the components compile to faster loops."""

    x: Array
    y: Array
    z: Array

    @property
    def components(self) -> Triple:
        """The components x, y and z."""
        return (self.x, self.y, self.z)

    def __getitem__(self, index: Any) -> Any:
        return self.components[index]

    def __matmul__(self, other: "Vectors") -> Array:
        return _scalar_product(self.components, other.components)

    def cross(self, other: "Vectors") -> "Vectors":
        """Return the vector product."""
        return Vectors(*_vector_product(self.components, other.components))


class PathDerivatives(eqx.Module):
    """The derivatives of the position with respect to s = 2t/duration − 1, for a batch of paths.

    The derivatives are in units of `length` [m] and in ascending order, starting with the first. `unit` [s] is half the
    duration of each path. The first derivative may be replaced by a vector parallel to the velocity. `pace` is the
    ratio of the velocity to this vector; `pace=None` means that the ratio is 1.
    """

    derivatives: list[CellPolynomial]
    length: PerPath
    unit: PerPath
    pace: CellPolynomial | None = None


def path_derivatives(
    path: MovingPolynomials, duration: PerPath, roundings: int | Array = 0, orders: int = ORDER
) -> PathDerivatives:
    """Return the derivatives up to the order `orders` of a batch of paths; the last axis of `path` indexes the paths.

    `roundings` is the number of relative rounding errors that each coefficient already contains, a scalar or an array
    (1, paths).
    """
    unit = 0.5 * duration
    # No derivative depends on the initial height or azimuth. Zeros there keep the full precision of all other
    # coefficients.
    y = jnp.zeros_like(path.x[:1]) if path.y is None else path.y
    coordinates = [path.x, y, path.z.at[0].set(0.0), path.angle.at[0].set(0.0)]
    scaled = [in_units(c, unit)[:, None] for c in coordinates]
    sizes = jnp.stack([jnp.max(jnp.abs(c[:, 0]), axis=0) for c in scaled[:3]])
    length = power_of_two(jnp.max(sizes, axis=0))
    lengths = [c / length[None, None] for c in scaled[:3]]
    # The absolute values of all coefficients are treated as additional paths: their sums bound the rounding errors.
    x, y, z, angle = (centred(jnp.concatenate([c, jnp.abs(c)], axis=-1)) for c in (*lengths, scaled[3]))
    signs = jnp.concatenate([jnp.full_like(unit, -1.0), jnp.ones_like(unit)])
    degrees = [c.shape[0] - 1 for c in scaled]
    is_normal = _is_normal(unit) & _is_normal(unit ** max(degrees)) & (length > UNDERFLOW) & (length < 1 / UNDERFLOW)
    derivatives: list[CellPolynomial] = []
    for order, coefficients_and_bounds in enumerate(_derivatives(x, y, z, angle, signs, orders), start=1):
        a, bound = jnp.split(coefficients_and_bounds, 2, axis=-1)
        count = _n_roundings(max(degrees[:3]), degrees[3], order) + roundings
        size = jnp.max(jnp.sum(bound, axis=AXIS), axis=0)
        error = add_rounding(jnp.full_like(size, UNDERFLOW), count, size)
        derivatives.append(cell_polynomial(a, jnp.where(is_normal, error, jnp.inf)))
    return PathDerivatives(derivatives, length, unit)


def slack(entry: PathQuantity, i: Invariants, bound: Bound) -> ChebyshevModel:
    """Return limit² · denominator − numerator in cells of s = 2t/duration − 1.

    The limit is satisfied where this value is not negative.
    """
    numerator = entry.numerator(i)
    denominator = numerator.one() if entry.denominator is None else entry.denominator(i)
    return multiple(denominator, *bound.square) - numerator


def bounds(limit: PerPath, scale: PerPath) -> Bound:
    """Return a limit and its square in the units of `PathDerivatives`, each with a bound on its rounding error.

    `scale` converts the limit from SI units.
    """
    bound = limit * scale
    rounding = jnp.where(_is_normal(bound) & _is_normal(scale), 8 * float(jnp.finfo(bound.dtype).eps) * bound, jnp.inf)
    return Bound((bound[None], rounding[None]), squared_bound(limit, scale))


def squared_bound(limit: PerPath, scale: PerPath) -> tuple[Array, Array]:
    """Return the square of a limit in the units of `PathDerivatives`, and a bound on its rounding error."""
    bound = limit * scale
    square = bound * bound
    is_normal = _is_normal(bound) & _is_normal(square) & _is_normal(scale)
    rounding = jnp.where(is_normal, 16 * float(jnp.finfo(bound.dtype).eps) * square, jnp.inf)
    return square[None], rounding[None]


def _derivatives(x: Array, y: Array, z: Array, angle: Array, signs: Array, orders: int) -> list[Array]:
    """Return the coefficients of the derivatives of the position, from the first to the order `orders`.

    `signs` is −1 for the coefficients of a path, and 1 for the absolute values of these coefficients. With absolute
    values no terms cancel, so the results are sums of the magnitudes of all terms.
    """
    angle_rate, derivatives = _derivative(angle), []
    for _ in range(orders):
        rotated_y, rotated_x = _multiply(angle_rate, y), _multiply(angle_rate, x)
        x, y, z = _add(_derivative(x), signs[None, None] * rotated_y), _add(_derivative(y), rotated_x), _derivative(z)
        n = max(a.shape[AXIS] for a in (x, y, z)) - 1
        derivatives.append(jnp.stack([_pad(a, n) for a in (x, y, z)]))
    return derivatives


def _derivative(c: Array) -> Array:
    n = c.shape[AXIS] - 1
    return c[1:] * jnp.asarray(np.arange(1.0, n + 1)[:, None, None], c.dtype) if n else jnp.zeros_like(c)


def _add(p: Array, q: Array) -> Array:
    n = max(p.shape[AXIS], q.shape[AXIS]) - 1
    return _pad(p, n) + _pad(q, n)


def _n_roundings(degree: int, angle_rate: int, order: int) -> int:
    """Return the maximum number of roundings in one term of a coefficient, for the derivative of this order.

    `degree` is the degree of the coordinates, and `angle_rate` the degree of φ. With degree n, the change of variable
    to s needs at most 2n + 2 roundings: n + 1 for the powers of time, one for the binomial coefficient and n for the
    sum. Each derivative adds a multiplication, a sum of up to `angle_rate` products, an addition, and the roundings of
    φ'.
    """
    first = 2 * max(degree, angle_rate) + 4
    return first + order * (angle_rate + 4 + first)


@jax.jit
def centred(coefficients: Float[Array, "k 1 paths"]) -> Array:
    """Return the coefficients of the powers of s in the polynomial Σ a_k (1 + s)^k, where a_k are the `coefficients`.

    With n + 1 coefficients, each term contains at most n + 1 roundings.
    """
    n = coefficients.shape[0] - 1
    weights = [[math.comb(k, i) for k in range(n + 1)] for i in range(n + 1)]
    return jnp.sum(
        jnp.asarray(np.array(weights, float), coefficients.dtype)[:, :, None, None] * coefficients[None], axis=1
    )


def in_units(coefficients: Float[Array, "k paths"], unit: PerPath) -> Float[Array, "k paths"]:
    """Return the coefficients of polynomials in t/unit, from their coefficients in t."""
    powers = [jnp.ones_like(unit)]
    for _ in range(coefficients.shape[0] - 1):
        powers.append(powers[-1] * unit)
    return coefficients * jnp.stack(powers)


@jax.jit
def _is_normal(x: Array) -> Bool[Array, " paths"]:
    """Check whether positive numbers are far enough from overflow and underflow to have bounded relative errors."""
    limits = jnp.finfo(x.dtype)
    return (x > float(limits.tiny) / float(limits.eps)) & (x < float(limits.max) * float(limits.eps))


def power_of_two(size: PerPath) -> PerPath:
    """Return the largest power of two that does not exceed `size`, or 1 if `size` is not positive and finite."""
    exponent = jax.lax.bitcast_convert_type(size, jnp.int64) & 0x7FF0000000000000
    power = jax.lax.bitcast_convert_type(exponent, size.dtype)
    return jnp.where((power > 0) & (power < jnp.inf), power, 1.0)


def _pad(c: Array, degree: int) -> Array:
    """Pad the coefficients of a polynomial with zeros up to `degree`."""
    more = degree + 1 - c.shape[AXIS]
    return jnp.pad(c, [(0, more), (0, 0), (0, 0)])


def _multiply(p: Float[Array, "m 1 paths"], q: Float[Array, "n 1 paths"]) -> Array:
    """Return the coefficients of the product of two polynomials."""
    m = p.shape[0]
    terms = [jnp.pad(p[i][None] * q, [(i, m - 1 - i), (0, 0), (0, 0)]) for i in range(m)]
    return sum(terms[1:], terms[0])


_scalar_product, _vector_product = jax.jit(dot), jax.jit(cross)
