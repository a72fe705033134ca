"""Define the relation u̇² = a(u) between a path parameter u and time, with a piecewise cubic a, and the retimed path."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from qtraj.design.timing.cell_times import (
    Cells,
    clipped,
    elapsed,
    horner,
    newton,
    pace,
    stretch,
    stretched,
    stretching,
    unstretched,
)
from qtraj.design.timing.retimed_motion import RetimedMotion
from qtraj.foundation.arrays import as_float, is_traced, one_instant, part
from qtraj.foundation.document import storable
from qtraj.foundation.namespace import in_numpy, namespace
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Scalar, ScalarLike
from qtraj.path.hodograph import AbstractHodograph, require_order
from qtraj.path.progress import composed
from qtraj.path.route import Route

ROUNDINGS = 8
"""A time later than the end by at most this number of rounding errors is treated as the end."""


@storable
class Timing(eqx.Module):
    """The relation between a path parameter u and time: u̇² = a(u), where a is a cubic polynomial between two `knots`.

    `knots` (n + 1,) [s] increase from 0. `coefficients` (n, 4) are the coefficients of a in each cell, for ascending
    powers of the position x in the cell, 0 ≤ x ≤ 1. `rest` indicates whether the vehicle is at rest, a = 0, at the
    start and at the end; elsewhere a > 0. `times` (n + 1,) [s] are the times of the knots. The methods `time` and
    `parameter` are inverses of each other to within about 1e-12 of the duration.
    """

    coefficients: Float[Any, "cells 4"]
    knots: Float[Any, " cells+1"]
    rest: tuple[bool, bool] = eqx.field(static=True)
    times: Float[Any, " cells+1"]

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
        self.times = as_float(_times(self) if times is None else times)

    def __repr__(self) -> str:
        return shown(self, knots="s", coefficients="", times="s")

    @property
    def duration(self) -> Float[Any, "*batch"]:
        """The duration of the whole path [s]."""
        return part(self.times, (..., -1))

    @in_numpy
    def squared_speed(self, u: ScalarLike) -> Scalar:
        """Return a(u) = u̇² at one parameter `u`."""
        cells, u = self._with(one_instant(u))
        cell, place = cells.locate(u)
        return as_float(cells.xp.maximum(horner(cells.form(cell), place), 0.0))

    @in_numpy
    def taylor(self, u: ScalarLike) -> Float[Any, " 4"]:
        """Return the Taylor coefficients of the function a(u) at the parameter `u`."""
        found = self.taylor_at(one_instant(u))
        return as_float(namespace(*found).stack(found))

    def taylor_at(self, u: Float[Any, " n"]) -> list[Float[Any, " n"]]:
        """Return the Taylor coefficients of the function a(u) at an array of parameters, orders 0 to 3."""
        cells, u = self._with(u)
        cell, place = cells.locate(u)
        c, length = cells.form(cell), cells.length(cell)
        shifted = [sum(math.comb(j, k) * c[j] * place ** (j - k) for j in range(k, 4)) for k in range(4)]
        return [x / length**k for k, x in enumerate(shifted)]

    @in_numpy
    def time(self, u: ScalarLike) -> Scalar:
        """Return the time [s] at which the parameter is `u`; outside the knots, return the time of the nearer end."""
        return as_float(self.times_of(one_instant(u)))

    def times_of(self, u: Float[Any, "*m"]) -> Float[Any, "*m"]:
        """Return the times [s] of an array of parameters, in NumPy unless the arguments are traced."""
        cells, u = self._with(u)
        cell, place = cells.locate(u)
        kinds = cells.kinds(cell)
        z = unstretched(place, kinds[-1])
        return cells.times[cell] + elapsed(cells.form(cell), cells.length(cell), *kinds, z)

    def parameter(self, t: ScalarLike) -> Scalar:
        """Return the parameter at the time `t` [s]; outside [0, duration], return the parameter of the nearer end."""
        return self.motion(t)[0]

    @in_numpy
    def motion(self, t: ScalarLike) -> tuple[Scalar, Scalar]:
        """Return the parameter u and its rate u̇ at the time `t` [s]; outside [0, duration], those of the nearer end."""
        u, rate = self.motion_at(one_instant(t))
        return as_float(u), as_float(rate)

    def motion_at(self, t: Float[Any, "*m"]) -> tuple[Float[Any, "*m"], Float[Any, "*m"]]:
        """Return the result of `motion` for an array of times, in NumPy unless the arguments are traced."""
        cells, s = self._with(t)
        # An end that was computed elsewhere, with other roundings, is not outside; the derivatives depend on this.
        s = clipped(s, 0.0, cells.times[-1] * (1 + ROUNDINGS * float(np.finfo(s.dtype).eps)))
        cell = cells.xp.clip(cells.xp.searchsorted(cells.times, s, side="right") - 1, 0, cells.count - 1)
        length, kinds = cells.length(cell), cells.kinds(cell)
        z = _position(self, s, cell) if cells.xp is jnp else newton(cells, s, cell)
        rate = length * stretching(z, kinds[-1]) / pace(cells.form(cell), length, *kinds, z)
        return cells.knots[cell] + length * stretched(z, kinds[-1]), rate

    def _with(self, x: Any) -> tuple[Cells, Any]:
        """Return the cells, and the argument of a method: NumPy arrays unless one of them is traced."""
        xp: Any = jnp if is_traced(self, x) else np
        coefficients, knots, times = (xp.asarray(y) for y in (self.coefficients, self.knots, self.times))
        return Cells(xp, coefficients, knots, times, self.rest), xp.asarray(x).astype(self.knots.dtype)


@eqx.filter_custom_jvp
def _position(timing: Timing, t: Scalar, cell: Int[Any, ""]) -> Scalar:
    """Return z at a time within a cell."""
    return newton(timing._with(t)[0], t, cell)


@_position.def_jvp
def _position_jvp(primals: Any, tangents: Any) -> tuple[Scalar, Scalar]:
    """The change of z is the change of the time, less that of the time at which z is reached, divided by dt/dz."""
    timing, t, cell = primals
    z, late = _position(timing, t, cell), tangents[1]
    own = timing._with(t)[0]
    starts, ends, share = own.kinds(cell)

    def reached(x: Timing) -> Scalar:
        cells = x._with(z)[0]
        return cells.times[cell] + elapsed(cells.form(cell), cells.length(cell), *cells.kinds(cell), z)

    late = jnp.zeros_like(z) if late is None else late
    if jax.tree.leaves(tangents[0]):
        shift = eqx.filter_jvp(reached, (timing,), (tangents[0],))[1]
        late = late if shift is None else late - shift
    return z, late / pace(own.form(cell), own.length(cell), starts, ends, share, z)


def _times(timing: Timing) -> Float[Any, "*batch cells+1"]:
    """Return the times of the knots [s]."""
    if is_traced(timing):
        return _traced_times(timing.coefficients, timing.knots, timing.rest)
    return _knot_times(np.asarray(timing.coefficients), np.asarray(timing.knots), timing.rest)


def _knot_times(coefficients: Any, knots: Any, rest: tuple[bool, bool]) -> Float[Any, "*batch cells+1"]:
    xp = namespace(coefficients, knots)
    c = xp.moveaxis(coefficients, -1, 0)
    length = knots[..., 1:] - knots[..., :-1]
    k = np.arange(c.shape[-1])
    starts, ends = (xp.asarray(x) for x in ((k == 0) & rest[0], (k == k.size - 1) & rest[1]))
    with np.errstate(all="ignore"):  # a failed search ends with NaN
        share = stretch(c, starts, ends)
        passed = xp.cumsum(elapsed(c, length, starts, ends, share, xp.ones_like(length)), axis=-1)
    return xp.concatenate([xp.zeros_like(passed[..., :1]), passed], axis=-1)


_traced_times = eqx.filter_jit(_knot_times)


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

    @property
    def supports_numpy(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Whether the original path supports NumPy."""
        return self.path.supports_numpy

    def nodes(self) -> Float[Any, " nodes"]:
        """Return the times of the knots [s]; the path is smooth between them."""
        return self.timing.times

    @in_numpy
    def derivatives(self, t: ScalarLike, order: int) -> Float[Any, "{order}+1 3"]:
        """Return r and its time derivatives up to `order` at one instant `t`, in world axes; row k is in [m s^-k]."""
        require_order(order)
        u, rate_of_u = self.timing.motion(t)
        rate: Any = rate_of_u
        taylor, rows = self.timing.taylor(u), self.path.derivatives(u, order)
        if not is_traced(rate, taylor, rows):
            rate, taylor, rows = (np.asarray(x) for x in (rate, taylor, rows))
        factorials = np.array([float(math.factorial(k)) for k in range(order + 1)], u.dtype)[:, None]
        return as_float(
            namespace(rows, rate).stack(composed([*(rows / factorials)], _increments(rate, taylor, order))) * factorials
        )

    def sampled(self, t: Float[Any, " n"], order: int) -> list[Float[Any, "n 3"]]:
        """Return r and its time derivatives up to `order`, each (n, 3), at instants `t` (n,), in world axes."""
        if is_traced(self, t):
            return super().sampled(t, order)
        u, rate = self.timing.motion_at(t)
        taylor, rows = self.timing.taylor_at(u), self.path.sampled(u, order)
        factorials = [float(math.factorial(k)) for k in range(order + 1)]
        shape = [np.asarray(row) / k for row, k in zip(rows, factorials, strict=True)]
        found = composed(shape, [np.asarray(x)[..., None] for x in _increments(rate, taylor, order)])
        return [row * k for row, k in zip(found, factorials, strict=True)]

    def driven(self) -> RetimedMotion | None:
        """Return the motion of a vehicle on a single concrete route, for the frame `Driving`."""
        single = self.duration.ndim == 0 and not is_traced(self) and isinstance(self.path, Route)
        return RetimedMotion(self) if single else None


def _increments(rate: Scalar, a: Float[Any, " 4"], order: int) -> list[Scalar]:
    """Return the Taylor coefficients of u(t) − u₀ in time, from u̇ = `rate` and ü = a'(u)/2.

    The argument `a` contains the Taylor coefficients of the function a(u) at u₀.
    """
    zero = 0.0 * rate
    change = [zero, rate]
    for k in range(order - 1):
        square = sum((change[i] * change[k - i] for i in range(k + 1)), zero)
        slope = (a[1] if k == 0 else zero) + 2 * a[2] * change[k] + 3 * a[3] * square
        change.append(slope / (2 * (k + 1) * (k + 2)))
    return change[: order + 1]


def speeds_at_ends(path: RetimedPath) -> Float[np.ndarray, "cells 2"]:
    """Return the speeds at both ends of each cell [m/s], for a path with concrete values."""
    powers, knots = np.asarray(path.timing.coefficients), np.asarray(path.timing.knots)
    pace = np.array([float(np.linalg.norm(np.asarray(path.path.derivatives(u, 1))[1])) for u in knots])
    squares = np.stack([powers[:, 0], powers.sum(axis=1)], axis=1)
    return np.sqrt(np.maximum(squares, 0.0)) * np.stack([pace[:-1], pace[1:]], axis=1)
