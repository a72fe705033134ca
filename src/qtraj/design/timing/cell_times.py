"""Compute the times within the cells of a timing, in NumPy or JAX."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from qtraj.foundation.namespace import namespace
from qtraj.foundation.types import ScalarLike

QUADRATURE = np.polynomial.legendre.leggauss(12)
"""Nodes and weights on [−1, 1] for the time within a cell."""

NEWTON_STEPS = 8


class Cells(NamedTuple):
    """The fields of a timing as arrays of the array library `xp`."""

    xp: Any
    coefficients: Float[Any, "cells 4"]
    knots: Float[Any, " cells+1"]
    times: Float[Any, " cells+1"]
    rest: tuple[bool, bool]

    @property
    def count(self) -> int:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The number of cells."""
        return self.coefficients.shape[-2]

    def form(self, cell: Any) -> Any:
        """Return the coefficients of a = u̇² on the first axis."""
        return self.xp.moveaxis(self.coefficients[cell], -1, 0)

    def length(self, cell: Any) -> Any:
        """Return the lengths of cells in the parameter."""
        return self.knots[cell + 1] - self.knots[cell]

    def kinds(self, cell: Any) -> tuple[Any, Any, Any]:
        """Return whether a cell starts at rest, whether it ends at rest, and its parameter of `stretched`."""
        starts, ends = (cell == 0) & self.rest[0], (cell == self.count - 1) & self.rest[1]
        return starts, ends, stretch(self.form(cell), starts, ends)

    def locate(self, u: Any) -> tuple[Any, Any]:
        """Return the cell that contains a parameter, and the position in the cell."""
        cell = self.xp.clip(self.xp.searchsorted(self.knots, u, side="right") - 1, 0, self.count - 1)
        return cell, clipped((u - self.knots[cell]) / self.length(cell), 0.0, 1.0)


# Near a state of rest, time is proportional to the square root of the distance. So the place x in a cell is a quadratic
# function of z with dx/dz proportional to √a if a is linear; then dt/dz is constant. At rest, x is z² or 1 − (1 − z)².
# The parameter u and its rate u̇ are smooth functions of z, so their derivatives are correct also at rest, where √a is
# not differentiable in u.


def stretch(c: Any, starts: Any, ends: Any) -> Any:
    """Return √a at the start of a cell, divided by the sum of the values at both ends; 0 or 1 at rest."""
    xp = namespace(c)
    first, last = root(c[0]), root(c[0] + c[1] + c[2] + c[3])
    both = first + last
    share = xp.where(both > 0, first / xp.where(both > 0, both, 1.0), 0.5)
    return xp.where(starts, 0.0, xp.where(ends, 1.0, share))


def newton(cells: Cells, t: Any, cell: Any) -> Any:
    """Return z at a time within a cell."""
    since, span = t - cells.times[cell], cells.times[cell + 1] - cells.times[cell]
    own = cells.form(cell), cells.length(cell), *cells.kinds(cell)

    def step(_: Any, z: Any) -> Any:
        return cells.xp.clip(z - (elapsed(*own, z) - since) / pace(*own, z), 0.0, 1.0)

    if cells.xp is jnp:
        return jax.lax.fori_loop(0, NEWTON_STEPS, step, since / span)
    z = since / span
    for k in range(NEWTON_STEPS):
        z = step(k, z)
    return z


def elapsed(c: Any, length: Any, starts: Any, ends: Any, share: Any, z: Any) -> Any:
    """Return the time [s] from the start of a cell to the position `stretched(z)`."""
    xp = namespace(c, length, z)
    at, weights = (
        xp.asarray(x, z.dtype).reshape(*[1] * z.ndim, -1) for x in ((QUADRATURE[0] + 1) / 2, QUADRATURE[1] / 2)
    )
    c, length, starts, ends, share = (xp.asarray(x)[..., None] for x in (c, length, starts, ends, share))
    return z * xp.sum(weights * pace(c, length, starts, ends, share, at * z[..., None]), axis=-1)


def stretched(z: Any, share: Any) -> Any:
    """Return the place in a cell at z; `share` is the result of `stretch`."""
    return z * (2 * share + z * (1 - 2 * share))


def stretching(z: Any, share: Any) -> Any:
    """Return the derivative of `stretched`."""
    return 2 * (share + z * (1 - 2 * share))


def unstretched(place: Any, share: Any) -> Any:
    """Return z for a place in a cell, the inverse of `stretched`."""
    xp = namespace(place, share)
    sum_ = share + root(share * share + (1 - 2 * share) * place)
    return xp.where(sum_ > 0, place / xp.where(sum_ > 0, sum_, 1.0), 0.0)


def pace(c: Any, length: Any, starts: Any, ends: Any, share: Any, z: Any) -> Any:
    """Return dt/dz [s] at the position `stretched(z)` in a cell.

    The first axis of `c` indexes the four coefficients of the squared rate a = u̇².
    """
    xp, place = namespace(c, z), stretched(z, share)
    left = 1 - place
    from_start = c[1] + place * (c[2] + place * c[3])
    to_end = -(c[1] + 2 * c[2] + 3 * c[3]) + left * (c[2] + 3 * c[3] - left * c[3])
    factor = xp.where(starts | ends, 2.0, stretching(z, share))
    return length * factor * xp.where(starts, from_start, xp.where(ends, to_end, horner(c, place))) ** -0.5


def clipped(x: Any, low: ScalarLike, high: ScalarLike) -> Any:
    """Clip `x` to its bounds; unlike with `jnp.clip`, the derivative is 1 if `x` equals a bound."""
    xp = namespace(x, high)
    return xp.where(x < low, low, xp.where(x > high, high, x))


def horner(c: Any, x: Any) -> Any:
    """Return the value at x of a cubic with the coefficients on the first axis of `c`."""
    return c[0] + x * (c[1] + x * (c[2] + x * c[3]))


def root(x: Any) -> Any:
    """Return √x, with the derivative 0 at x = 0."""
    xp = namespace(x)
    return xp.where(x > 0, xp.sqrt(xp.where(x > 0, x, 1.0)), 0.0)
