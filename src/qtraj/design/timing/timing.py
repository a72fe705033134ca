"""Define the relation u̇² = a(u) between a path parameter u and time, with a piecewise cubic a, and the retimed path."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.foundation.arrays import as_float, one_instant
from qtraj.foundation.document import storable
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Scalar, ScalarLike
from qtraj.path.hodograph import AbstractHodograph

QUADRATURE = np.polynomial.legendre.leggauss(12)
"""Nodes and weights on [−1, 1] for the time within a cell."""

NEWTON_STEPS = 8


@storable
class Timing(eqx.Module):
    """The relation between a path parameter u and time: u̇² = a(u), where a is a cubic polynomial between two `knots`.

    `knots` (n + 1,) [s] increase from 0. `coefficients` (n, 4) are the coefficients of a in each cell, for ascending
    powers of the position x in the cell, 0 ≤ x ≤ 1. `rest` indicates whether the vehicle is at rest, a = 0, at the
    start and at the end; elsewhere a > 0. `times` (n + 1,) [s] are the times of the knots. The methods `time` and
    `parameter` are inverses of each other to within about 1e-12 of the duration.
    """

    coefficients: Float[Array, "cells 4"]
    knots: Float[Array, " cells+1"]
    rest: tuple[bool, bool] = eqx.field(static=True)
    times: Float[Array, " cells+1"]

    def __init__(
        self,
        coefficients: ArrayInput,
        knots: ArrayInput,
        rest: Sequence[bool] = (False, False),
        times: ArrayInput | None = None,
    ):
        self.coefficients, self.knots = as_float(coefficients), as_float(knots)
        self.rest = (bool(rest[0]), bool(rest[1]))
        if self.coefficients.shape[-1:] != (4,) or self.knots.shape[-1] != self.coefficients.shape[-2] + 1:
            raise ValueError(
                "a timing needs coefficients of shape (cells, 4) and knots of shape (cells + 1,), but arrays of the "
                f"shapes {self.coefficients.shape} and {self.knots.shape} were given"
            )
        self.times = _times(self) if times is None else as_float(times)

    def __repr__(self) -> str:
        return shown(self, knots="s", coefficients="", times="s")

    @property
    def duration(self) -> Float[Array, "*batch"]:
        """The duration of the whole path [s]."""
        return self.times[..., -1]

    def squared_speed(self, u: ScalarLike) -> Scalar:
        """Return a(u) = u̇² at one parameter `u`."""
        cell, place = self._locate(one_instant(u))
        return jnp.maximum(_horner(self.coefficients[cell], place), 0.0)

    def taylor(self, u: ScalarLike) -> Float[Array, " 4"]:
        """Return the Taylor coefficients of the function a(u) at the parameter `u`."""
        cell, place = self._locate(one_instant(u))
        c = self.coefficients[cell]
        shifted = [sum(math.comb(j, k) * c[j] * place ** (j - k) for j in range(k, 4)) for k in range(4)]
        return jnp.stack(shifted) / (self.knots[cell + 1] - self.knots[cell]) ** jnp.arange(4, dtype=c.dtype)

    def time(self, u: ScalarLike) -> Scalar:
        """Return the time [s] at which the parameter is `u`; outside the knots, return the time of the nearer end."""
        cell, place = self._locate(one_instant(u))
        starts, ends = self._kinds(cell)
        z = _unstretched(place, starts, ends)
        return self.times[cell] + _elapsed(self._form(cell), self._length(cell), starts, ends, z)

    def parameter(self, t: ScalarLike) -> Scalar:
        """Return the parameter at the time `t` [s]; outside [0, duration], return the parameter of the nearer end."""
        return self.motion(t)[0]

    def motion(self, t: ScalarLike) -> tuple[Scalar, Scalar]:
        """Return the parameter u and its rate u̇ at the time `t` [s]; outside [0, duration], those of the nearer end."""
        t = _clipped(one_instant(t), 0.0, self.duration)
        cell = jnp.clip(jnp.searchsorted(self.times, t, side="right") - 1, 0, self._cells - 1)
        length, kinds = self._length(cell), self._kinds(cell)
        z = _position(self, t, cell)
        rate = length * _stretching(z, *kinds) / _pace(self._form(cell), length, *kinds, z)
        return self.knots[cell] + length * _stretched(z, *kinds), rate

    @property
    def _cells(self) -> int:
        return self.coefficients.shape[-2]

    def _form(self, cell: Array) -> Array:
        return self.coefficients[cell]

    def _length(self, cell: Array) -> Array:
        return self.knots[cell + 1] - self.knots[cell]

    def _kinds(self, cell: Array) -> tuple[Array, Array]:
        return (cell == 0) & self.rest[0], (cell == self._cells - 1) & self.rest[1]

    def _locate(self, u: Scalar) -> tuple[Array, Scalar]:
        u = u.astype(self.knots.dtype)
        cell = jnp.clip(jnp.searchsorted(self.knots, u, side="right") - 1, 0, self._cells - 1)
        return cell, _clipped((u - self.knots[cell]) / (self.knots[cell + 1] - self.knots[cell]), 0.0, 1.0)


# Near a state of rest, time is proportional to the square root of the distance. So in a cell that starts or ends at
# rest the place x is z² or 1 − (1 − z)², and time is a smooth function of z. The parameter u and its rate u̇ are smooth
# functions of z, too, so their derivatives are correct also at rest, where √a is not differentiable in u.


@eqx.filter_custom_jvp
def _position(timing: Timing, t: Scalar, cell: Int[Array, ""]) -> Scalar:
    """Return z at a time within a cell."""
    since, span = t - timing.times[cell], timing.times[cell + 1] - timing.times[cell]
    given = timing._form(cell), timing._length(cell), *timing._kinds(cell)

    def newton(_: Any, z: Scalar) -> Scalar:
        return jnp.clip(z - (_elapsed(*given, z) - since) / _pace(*given, z), 0.0, 1.0)

    return jax.lax.fori_loop(0, NEWTON_STEPS, newton, since / span)


@_position.def_jvp
def _position_jvp(primals: Any, tangents: Any) -> tuple[Scalar, Scalar]:
    """The change of z is the change of the time, less that of the time at which z is reached, divided by dt/dz."""
    timing, t, cell = primals
    z, late = _position(timing, t, cell), tangents[1]
    starts, ends = timing._kinds(cell)

    def reached(x: Timing) -> Scalar:
        return x.times[cell] + _elapsed(x._form(cell), x._length(cell), starts, ends, z)

    late = jnp.zeros_like(z) if late is None else late
    if jax.tree.leaves(tangents[0]):
        shift = eqx.filter_jvp(reached, (timing,), (tangents[0],))[1]
        late = late if shift is None else late - shift
    return z, late / _pace(timing._form(cell), timing._length(cell), starts, ends, z)


@eqx.filter_jit
def _times(timing: Timing) -> Float[Array, "*batch cells+1"]:
    """Return the times of the knots [s]."""
    c = jnp.moveaxis(timing.coefficients, -1, 0)
    length = timing.knots[..., 1:] - timing.knots[..., :-1]
    k = jnp.arange(c.shape[-1])
    starts, ends = (k == 0) & timing.rest[0], (k == k.size - 1) & timing.rest[1]
    passed = jnp.cumsum(_elapsed(c, length, starts, ends, jnp.ones_like(length)), axis=-1)
    return jnp.concatenate([jnp.zeros_like(passed[..., :1]), passed], axis=-1)


def _elapsed(c: Array, length: Array, starts: Array, ends: Array, z: Array) -> Array:
    """Return the time [s] from the start of a cell to the position `_stretched(z)`."""
    at = (jnp.asarray(QUADRATURE[0], z.dtype) + 1) / 2
    weights = jnp.asarray(QUADRATURE[1] / 2, z.dtype)
    c, length, starts, ends = (jnp.asarray(x)[..., None] for x in (c, length, starts, ends))
    at, weights = (x.reshape(*[1] * z.ndim, -1) for x in (at, weights))
    return z * jnp.sum(weights * _pace(c, length, starts, ends, at * z[..., None]), axis=-1)


def _stretched(z: Array, starts: Array, ends: Array) -> Array:
    return jnp.where(starts, z**2, jnp.where(ends, z * (2 - z), z))


def _stretching(z: Array, starts: Array, ends: Array) -> Array:
    """Return the derivative of `_stretched`."""
    return jnp.where(starts, 2 * z, jnp.where(ends, 2 * (1 - z), 1.0))


def _unstretched(place: Scalar, starts: Array, ends: Array) -> Scalar:
    return jnp.where(starts, _root(place), jnp.where(ends, 1 - _root(1 - place), place))


def _pace(c: Array, length: Array, starts: Array, ends: Array, z: Array) -> Array:
    """Return dt/dz [s] at the position `_stretched(z)` in a cell.

    The first axis of `c` indexes the four coefficients of the squared rate a = u̇².
    """
    place = _stretched(z, starts, ends)
    left = 1 - place
    from_start = c[1] + place * (c[2] + place * c[3])
    to_end = -(c[1] + 2 * c[2] + 3 * c[3]) + left * (c[2] + 3 * c[3] - left * c[3])
    rest = jnp.where(starts | ends, 2.0, 1.0)
    return length * rest * jnp.where(starts, from_start, jnp.where(ends, to_end, _horner(c, place))) ** -0.5


@storable
class RetimedPath(AbstractHodograph):
    """A path r(u) with a timing u(t): the hodograph r(u(t)), where t is the time [s] since the start.

    This hodograph is not polynomial in t. The proofs of `retime` and `certify` use the polynomials r(u) and u̇²(u)
    instead. These proofs need cells of the form that `retime` creates. With other cells, `certify` samples the path.
    """

    path: AbstractHodograph
    timing: Timing

    def __init__(self, path: AbstractHodograph, timing: Timing):
        self.path, self.timing = path, timing

    def __repr__(self) -> str:
        return shown(self)

    @property
    def duration(self) -> Scalar:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The duration of the whole path [s]."""
        return self.timing.duration

    def nodes(self) -> Float[Array, " nodes"]:
        """Return the times of the knots [s]; the path is smooth between them."""
        return self.timing.times

    def derivatives(self, t: ScalarLike, order: int) -> Float[Array, "{order}+1 3"]:
        """Return r and its time derivatives up to `order` at one instant `t`, in world axes; row k is in [m s^-k]."""
        u, rate = self.timing.motion(t)
        change = _increments(rate, self.timing.taylor(u), order)
        factorials = jnp.asarray([float(math.factorial(k)) for k in range(order + 1)], u.dtype)[:, None]
        return _composed(self.path.derivatives(u, order) / factorials, change) * factorials


def _increments(rate: Scalar, a: Float[Array, " 4"], order: int) -> list[Scalar]:
    """Return the Taylor coefficients of u(t) − u₀ in time, from u̇ = `rate` and ü = a'(u)/2.

    The argument `a` contains the Taylor coefficients of the function a(u) at u₀.
    """
    zero = jnp.zeros_like(a[0])
    change = [zero, rate]
    for k in range(order - 1):
        square = sum((change[i] * change[k - i] for i in range(k + 1)), zero)
        slope = (a[1] if k == 0 else zero) + 2 * a[2] * change[k] + 3 * a[3] * square
        change.append(slope / (2 * (k + 1) * (k + 2)))
    return change[: order + 1]


def _composed(shape: Float[Array, "orders 3"], change: list[Scalar]) -> Float[Array, "orders 3"]:
    """Return the truncated Taylor coefficients of Σ shape_j δ^j, where δ = Σ change_k t^k and change_0 = 0."""
    orders = shape.shape[0]
    result = jnp.zeros_like(shape).at[0].set(shape[-1])
    for row in shape[-2::-1]:
        product = [
            sum((change[i] * result[k - i] for i in range(1, k + 1)), jnp.zeros_like(row)) for k in range(orders)
        ]
        result = jnp.stack(product).at[0].add(row)
    return result


def _clipped(x: Array, low: ScalarLike, high: ScalarLike) -> Array:
    """Clip `x` to its bounds; unlike with `jnp.clip`, the derivative is 1 if `x` equals a bound."""
    return jnp.where(x < low, low, jnp.where(x > high, high, x))


def _horner(c: Array, x: Array) -> Array:
    return c[0] + x * (c[1] + x * (c[2] + x * c[3]))


def _root(x: Array) -> Array:
    """Return √x, with the derivative 0 at x = 0."""
    return jnp.where(x > 0, jnp.sqrt(jnp.where(x > 0, x, 1.0)), 0.0)
