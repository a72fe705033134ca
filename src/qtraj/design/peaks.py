"""Maxima of a smooth function of time, cell by cell.

[0, duration] is divided into cells about equally spaced nodes. In each cell the maximum is refined by Newton's method
from the node; the node and the borders of the cell are candidates as well. The largest value is the maximum over the
whole interval, except for peaks narrower than a cell. Each cell's value is a continuous function of the parameters of
`f`. Differentiation treats the times of the maxima as constants. The gradient of f(t*, x) with respect to x is still
exact: inside a cell ∂f/∂t = 0 at the maximum (envelope theorem), and on the border of a cell t* is fixed.
"""

from __future__ import annotations  # so that `help` shows short names

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.foundation.types import Scalar, ScalarLike
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.quantity import quantity
from qtraj.path.values import value
from qtraj.path.vehicle import Vehicle, require_vehicle

NEWTON_STEPS = 4
CELLS = 1025
"""Number of cells in which `peak` searches."""

PathFunction = Callable[[AbstractHodograph, Scalar], Scalar]
"""A quantity of a path at one instant."""


@eqx.filter_jit
def peak(path: AbstractHodograph, name: str, vehicle: Vehicle | None = None) -> tuple[Scalar, Scalar]:
    """Time [s] and value of the maximum of one path quantity (a field of `Limits`) over the whole path.

    The search refines 1025 cells of time, or four cells of every segment of a route, by Newton's method. The value can
    be differentiated with respect to the path (envelope theorem).

    **Raises:** ValueError for an unknown name, or a quantity that needs a `vehicle` without one.
    """
    road = require_vehicle(vehicle, f"the quantity {name}").parameters() if quantity(name).needs_vehicle else None
    return maximum(lambda path, t: value(path, t, name, road), path, CELLS)


def cell_peaks(f: PathFunction, path: AbstractHodograph, cells: int) -> Float[Array, " n"]:
    """The maximiser of f(path, t) in each of `cells` cells, as a fraction of the duration, without gradients."""
    nodes, low, high = _cells(path, cells)
    # The gradients stop before the search: differentiating the search would change nothing but the cost.
    constant = _constant(path)

    def g(u: Scalar) -> Scalar:
        return f(constant, u * constant.duration)

    candidates = jnp.stack([newton_max(g, nodes, low, high), nodes, low, high])
    values = jax.vmap(jax.vmap(g))(candidates)
    return jnp.take_along_axis(candidates, jnp.argmax(values, axis=0)[None], axis=0)[0]


def _cells(path: AbstractHodograph, cells: int) -> tuple[Array, Array, Array]:
    """Midpoints and ends of the cells, as fractions of the duration; the cells of a route end just before a knot."""
    knots = path.nodes()
    if knots is None:
        half = 0.5 / (cells - 1)
        nodes = jnp.linspace(0.0, 1.0, cells, dtype=path.duration.dtype)
        return nodes, jnp.clip(nodes - half, 0.0, 1.0), jnp.clip(nodes + half, 0.0, 1.0)
    low = jax.lax.stop_gradient(knots / path.duration)
    ends = jnp.concatenate([low[1:], jnp.ones_like(low[:1])])
    high = jnp.maximum(jnp.nextafter(ends, jnp.zeros_like(ends)), low)
    return 0.5 * (low + high), low, high


def maximum(f: PathFunction, path: AbstractHodograph, cells: int) -> tuple[Scalar, Scalar]:
    """Time and value of the maximum of f(path, t) over the path; the value is differentiable (envelope theorem)."""
    times = cell_peaks(f, path, cells) * path.duration
    values = jax.vmap(lambda t: f(path, t))(times)
    highest = jnp.argmax(values)
    return times[highest], values[highest]


def _constant(path: AbstractHodograph) -> AbstractHodograph:
    return jax.tree.map(lambda x: jax.lax.stop_gradient(x) if eqx.is_array(x) else x, path)


def newton_max(
    g: Callable[[Scalar], Scalar],
    u: Float[Array, " n"],
    low: Float[Array, " n"],
    high: Float[Array, " n"],
    steps: int = NEWTON_STEPS,
) -> Float[Array, " n"]:
    """Newton's method for a maximum of g in all cells; if g is not concave, step uphill to the border of the cell."""

    def slope(u: Scalar) -> Scalar:
        return jax.jvp(g, (u,), (jnp.ones_like(u),))[1]

    def improve(u: Scalar, low: Scalar, high: Scalar) -> Scalar:
        first, second = jax.jvp(slope, (u,), (jnp.ones_like(u),))
        concave = second < 0
        step = jnp.where(concave, -first / jnp.where(concave, second, 1.0), jnp.sign(first))
        return jnp.where(jnp.isfinite(step), jnp.clip(u + step, low, high), u)

    def step(_: ScalarLike, u: Float[Array, " n"]) -> Float[Array, " n"]:
        return jax.vmap(improve)(u, low, high)

    return jax.lax.fori_loop(0, steps, step, u)
