"""The relation of a path's own parameter u and time t, u̇² = a(u) with a piecewise cubic, and the path in time."""

import math
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.lax import stop_gradient
from jaxtyping import Array, Float

from qtraj.foundation.arrays import as_float, one_instant
from qtraj.foundation.document import storable
from qtraj.foundation.types import ArrayInput, Scalar, ScalarLike
from qtraj.path.hodograph import AbstractHodograph

QUADRATURE = np.polynomial.legendre.leggauss(12)
"""Of the time within a cell."""

NEWTON_STEPS = 8


@storable
class Timing(eqx.Module):
    """Time along a path: u̇² = a(u) > 0 in cells of equal length of the parameter u in [0, `length`].

    `coefficients` (n, 4): ascending powers of the place in [0, 1] within each cell. `rest` says whether the vehicle is
    at rest at the start and at the end, where a then vanishes. `time` and `parameter` are inverse to each other to
    about 1e-12 of the duration.
    """

    coefficients: Float[Array, "cells 4"]
    length: Scalar
    rest: tuple[bool, bool] = eqx.field(static=True)
    times: Float[Array, "cells+1"]

    def __init__(
        self,
        coefficients: ArrayInput,
        length: ArrayInput,
        rest: Sequence[bool] = (False, False),
        times: ArrayInput | None = None,
    ):
        self.coefficients, self.length = as_float(coefficients), as_float(length)
        self.rest = (bool(rest[0]), bool(rest[1]))
        if times is None:
            passed = jax.vmap(lambda k: self._elapsed(k, jnp.ones((), self.length.dtype)))(jnp.arange(self._cells))
            self.times = jnp.concatenate([jnp.zeros_like(passed[:1]), jnp.cumsum(passed)])
        else:
            self.times = as_float(times)

    @property
    def duration(self) -> Scalar:
        """The time for the whole path [s]."""
        return self.times[-1]

    @property
    def _cells(self) -> int:
        return self.coefficients.shape[0]

    def squared_speed(self, u: ScalarLike) -> Scalar:
        """a(u) = u̇² at one parameter."""
        cell, place = self._locate(one_instant(u))
        return jnp.maximum(_horner(self.coefficients[cell], place), 0.0)

    def taylor(self, u: ScalarLike) -> Float[Array, " 4"]:
        """Taylor coefficients of a about one parameter."""
        cell, place = self._locate(one_instant(u))
        c = self.coefficients[cell]
        shifted = [sum(math.comb(j, k) * c[j] * place ** (j - k) for j in range(k, 4)) for k in range(4)]
        return jnp.stack(shifted) * (self._cells / self.length) ** jnp.arange(4, dtype=c.dtype)

    def time(self, u: ScalarLike) -> Scalar:
        """The time [s] at which the parameter is u."""
        cell, place = self._locate(one_instant(u))
        return self.times[cell] + self._elapsed(cell, self._unstretched(cell, place))

    def parameter(self, t: ScalarLike) -> Scalar:
        """The parameter at a time [s]; outside [0, duration] that of the nearer end."""
        t = jnp.clip(one_instant(t), 0.0, self.duration)
        u = stop_gradient(self._inverted(t))
        return u + jnp.sqrt(_positive(self.squared_speed(u))) * (t - self.time(u))  # derivatives of the inverse

    def _inverted(self, t: Scalar) -> Scalar:
        cell = jnp.clip(jnp.searchsorted(self.times, t, side="right") - 1, 0, self._cells - 1)
        since, span = t - self.times[cell], self.times[cell + 1] - self.times[cell]

        def newton(_: Any, z: Scalar) -> Scalar:
            return jnp.clip(z - (self._elapsed(cell, z) - since) / self._pace(cell, z), 0.0, 1.0)

        z = jax.lax.fori_loop(0, NEWTON_STEPS, newton, since / span)
        return (cell + self._stretched(cell, z)) * self.length / self._cells

    def _locate(self, u: Scalar) -> tuple[Array, Scalar]:
        x = u.astype(self.length.dtype) * self._cells / self.length
        cell = jnp.clip(jnp.floor(x), 0, self._cells - 1)
        return cell.astype(int), jnp.clip(x - cell, 0.0, 1.0)

    def _elapsed(self, cell: Array, z: Scalar) -> Scalar:
        """The time from the beginning of a cell to its place f(z)."""
        at = (jnp.asarray(QUADRATURE[0], z.dtype) + 1) / 2 * z
        return z * jnp.sum(jnp.asarray(QUADRATURE[1] / 2, z.dtype) * self._pace(cell, at))

    # In a cell that begins or ends at rest time goes with the square root of the way: there the place is z² from the
    # start, or 1 − (1 − z)² to the end, and time is a smooth function of z.

    def _kinds(self, cell: Array) -> tuple[Array, Array]:
        return (cell == 0) & self.rest[0], (cell == self._cells - 1) & self.rest[1]

    def _stretched(self, cell: Array, z: Array) -> Array:
        starts, ends = self._kinds(cell)
        return jnp.where(starts, z**2, jnp.where(ends, z * (2 - z), z))

    def _unstretched(self, cell: Array, place: Scalar) -> Scalar:
        starts, ends = self._kinds(cell)
        return jnp.where(starts, jnp.sqrt(_positive(place)), jnp.where(ends, 1 - jnp.sqrt(_positive(1 - place)), place))

    def _pace(self, cell: Array, z: Array) -> Array:
        """dt/dz [s]."""
        starts, ends = self._kinds(cell)
        c = self.coefficients[cell]
        place = self._stretched(cell, z)
        left = 1 - place
        plain = _horner(c, place)
        from_start = c[1] + place * (c[2] + place * c[3])
        to_end = -(c[1] + 2 * c[2] + 3 * c[3]) + left * (c[2] + 3 * c[3] - left * c[3])
        factor = jnp.where(starts | ends, 2.0, 1.0)
        return (
            self.length / self._cells * factor * jnp.where(starts, from_start, jnp.where(ends, to_end, plain)) ** -0.5
        )


@storable
class RetimedPath(AbstractHodograph):
    """A path r(u) driven by a timing: r(u(t)), t in seconds."""

    path: AbstractHodograph
    timing: Timing

    def __init__(self, path: AbstractHodograph, timing: Timing):
        self.path, self.timing = path, timing

    @property
    def duration(self) -> Scalar:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The time for the whole path [s]."""
        return self.timing.duration

    def derivatives(self, t: ScalarLike, order: int) -> Float[Array, "{order}+1 3"]:
        """r and its time derivatives up to `order` at one instant, world axes, row k in [m s^-k]."""
        u = self.timing.parameter(t)
        change = _increments(self.timing.taylor(u), order)
        shape = self.path.derivatives(u, order) / jnp.asarray([math.factorial(k) for k in range(order + 1)])[:, None]
        return _composed(shape, change) * jnp.asarray([math.factorial(k) for k in range(order + 1)])[:, None]


def _increments(a: Float[Array, " 4"], order: int) -> list[Scalar]:
    """Taylor coefficients in time of u − u₀, from u̇ = √a and ü = a'(u)/2."""
    zero = jnp.zeros_like(a[0])
    change = [zero, jnp.sqrt(_positive(a[0]))]
    for k in range(order - 1):
        square = sum((change[i] * change[k - i] for i in range(k + 1)), zero)
        slope = (a[1] if k == 0 else zero) + 2 * a[2] * change[k] + 3 * a[3] * square
        change.append(slope / (2 * (k + 1) * (k + 2)))
    return change[: order + 1]


def _composed(shape: Float[Array, "orders 3"], change: list[Scalar]) -> Float[Array, "orders 3"]:
    """Taylor coefficients of Σ shape_j δ^j, truncated, δ = Σ change_k t^k with change_0 = 0."""
    orders = shape.shape[0]
    result = jnp.zeros_like(shape).at[0].set(shape[-1])
    for row in shape[-2::-1]:
        product = [sum((change[i] * result[k - i] for i in range(1, k + 1)), jnp.zeros(3)) for k in range(orders)]
        result = jnp.stack(product).at[0].add(row)
    return result


def _horner(c: Array, x: Array) -> Array:
    return c[0] + x * (c[1] + x * (c[2] + x * c[3]))


def _positive(x: Array) -> Array:
    """`x`, or a number whose square root is nothing where it vanishes, for finite derivatives."""
    return jnp.where(x > 0, x, 1e-300)
