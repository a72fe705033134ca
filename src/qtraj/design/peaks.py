"""Find the maxima of a smooth function of time, cell by cell.

The interval [0, duration] is divided into cells about equally spaced nodes. On a route the cells are the four parts of
each segment, and on a retimed path the cells of its timing; the nodes are their midpoints. In each cell, Newton's
method starts from the node and refines the maximum. The node and the borders of the cell are candidates, too. The
largest value is the maximum over the whole interval, unless a peak is narrower than a cell. Differentiation treats the
times t* of the maxima as constants. The gradient of f(t*, x) with respect to parameters x is still exact, because
∂f/∂t = 0 at a maximum inside a cell (envelope theorem), and t* is fixed on the border of a cell.
"""

from __future__ import annotations  # so that `help` shows short names

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.design.proof.maxima import find_maxima
from qtraj.foundation.namespace import in_numpy, stop_gradient, xp
from qtraj.foundation.types import Scalar, ScalarLike
from qtraj.path.hodograph import AbstractHodograph, require_path
from qtraj.path.own_name import name_of
from qtraj.path.own_quantity import Quantity
from qtraj.path.quantity import COMBINED, quantity
from qtraj.path.road_parameters import RoadParameters
from qtraj.path.values import value
from qtraj.path.vehicle import Vehicle, require
from qtraj.path.vehicle_data import batch_of

NEWTON_STEPS = 4
REFINED, SAMPLES = 64, 5
"""In NumPy, the number of cells in which the maximum is refined, and the number of samples in each of them."""

CELLS = 1025
"""Number of cells in which `peak` searches on a path that is neither a route nor a retimed path."""

PathFunction = Callable[[AbstractHodograph, Scalar], Scalar]
"""A function that returns a quantity of a path at one instant [s]."""


def peak(path: AbstractHodograph, name: str | Quantity, vehicle: Vehicle | None = None) -> tuple[Scalar, Scalar]:
    """Return the time [s] and the value of the maximum of one path quantity over the whole path.

    `name` is a field of `Limits`, for the magnitude of a quantity, or the name of a side of a limit, such as
    `longitudinal_acceleration_max`, for the signed value; for a lower side, such as `speed_min`, the result is the
    minimum. A `Quantity` of one's own stands for its magnitude. Newton's method refines the maximum in each of 1025
    intervals of time; on a route, in each of four intervals of every segment; on a retimed path, in each cell of its
    timing. The value is differentiable with respect to the path (envelope theorem).

    **Raises:** ValueError for an unknown name or a batch, or if the quantity needs a `vehicle` and none is given.
    """
    require_path(path)
    known: str = name_of(name)
    entry = quantity(known)
    if known == COMBINED:
        raise ValueError(
            f"{known} is relative to an Ellipse, which peak does not know: use qtraj.certify, whose `worst` contains "
            "the largest value"
        )
    used = require(vehicle, entry.needs, f"the quantity {known}") if entry.uses_vehicle else None
    road = None if used is None else used.parameters()
    if path.duration.ndim or batch_of(used):
        shapes = f"batch shapes {path.duration.shape} and {batch_of(vehicle)}"
        raise ValueError(f"peak accepts one path and one vehicle, but {shapes} were given: use jax.vmap")
    return (_peak if path.supports_numpy else _compiled_peak)(path, known, road)


@eqx.filter_jit
def _compiled_peak(path: AbstractHodograph, name: str, road: RoadParameters | None) -> tuple[Scalar, Scalar]:
    side = quantity(name).side
    time, largest = maximum(lambda path, t: side * value(path, t, name, road), path, CELLS)
    return time, side * largest


def _peak_at_once(path: AbstractHodograph, name: str, road: RoadParameters | None) -> tuple[Any, Any]:
    """Return the time [s] and the value of the maximum, in NumPy; only cells with the highest values are refined."""
    duration, side = path.duration, quantity(name).side
    low, high = _divided(*_cells(path, CELLS)[1:])

    def quantity_at(u: Any) -> Any:
        found = side * value(path, (u * duration).ravel(), name, road)
        return np.broadcast_to(found, u.size).reshape(u.shape)

    values = quantity_at(np.stack([low, 0.5 * (low + high), high]))
    highest = np.max(np.where(np.isnan(values), np.inf, values), axis=0)
    neighbours = np.maximum(np.append(highest[1:], -np.inf), np.append(-np.inf, highest[:-1]))
    cells = np.flatnonzero(highest >= neighbours)
    cells = cells[np.argsort(-highest[cells], kind="stable")][:REFINED]
    start, width = low[cells], high[cells] - low[cells]
    inside = lambda u: quantity_at(np.clip(start + u * width, start, high[cells]))  # noqa: E731
    grid = np.linspace(0.0, 1.0, SAMPLES)
    at, refined = find_maxima(inside, grid, inside(grid[:, None] + 0.0 * width))
    best = np.argmax(refined)
    time = np.clip(start + at * width, start, high[cells])[best] * duration
    return time, side * quantity_at(np.asarray(time / duration))[()]


def _divided(low: Float[Array, " n"], high: Float[Array, " n"]) -> tuple[Float[Array, " m"], Float[Array, " m"]]:
    """Divide cells into equal parts, so that there are at least about `CELLS` of them."""
    parts = -(-CELLS // len(low))
    u = np.arange(parts + 1) / parts
    ends = low[:, None] * (1 - u) + high[:, None] * u
    return ends[:, :-1].ravel(), ends[:, 1:].ravel()


_peak = in_numpy(_peak_at_once, _compiled_peak)


def cell_peaks(f: PathFunction, path: AbstractHodograph, cells: int) -> Float[Array, " n"]:
    """Return the time of the maximum of f(path, t) in each of `cells` cells, as a fraction of the duration.

    On a route or a retimed path, the cells do not depend on `cells` (see the module). Differentiation treats the times
    as constants.
    """
    nodes, low, high = _cells(path, cells)
    # Exclude the search from differentiation, because its derivatives would only increase the cost.
    constant = _constant(path)

    def g(u: Scalar) -> Scalar:
        return f(constant, u * constant.duration)

    candidates = jnp.stack([newton_max(g, nodes, low, high), nodes, low, high])
    values = jax.vmap(jax.vmap(g))(candidates)
    return jnp.take_along_axis(candidates, jnp.argmax(values, axis=0)[None], axis=0)[0]


def _cells(path: AbstractHodograph, cells: int) -> tuple[Any, Any, Any]:
    """Return the nodes and both ends of the cells, as fractions of the duration.

    A cell of a route or a retimed path ends just before the next cell, so that it does not contain values of the next
    segment.
    """
    knots = path.nodes()
    if knots is None:
        half = 0.5 / (cells - 1)
        nodes = np.linspace(0.0, 1.0, cells).astype(path.duration.dtype)
        return nodes, np.clip(nodes - half, 0.0, 1.0), np.clip(nodes + half, 0.0, 1.0)
    low = stop_gradient(knots / path.duration)
    ends = xp.concatenate([low[1:], xp.ones_like(low[:1])])
    high = xp.maximum(xp.nextafter(ends, xp.zeros_like(ends)), low)
    return 0.5 * (low + high), low, high


def maximum(f: PathFunction, path: AbstractHodograph, cells: int) -> tuple[Scalar, Scalar]:
    """Return the time and the value of the maximum of f(path, t); the value is differentiable (envelope theorem)."""
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
    """Find a maximum of g in each cell [low, high] by Newton's method from u.

    Where g is not concave, step uphill to the border of the cell.
    """

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
