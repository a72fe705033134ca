"""Maxima of a smooth function of time, cell by cell.

[0, duration] is divided into cells about equally spaced nodes, and in each the largest value is sought by Newton's
method from the node; the node and the borders of the cell count as well. So the largest of the values is that of the
whole interval, up to maxima narrower than a cell, and each value is a continuous function of whatever else `f` depends
on. The times found are held constant in differentiation: within a cell ∂f/∂t = 0 there, so the gradient of f(t*, x) in
x is exact (envelope theorem), and on the border of a cell t* does not move.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.foundation.types import Scalar, ScalarLike
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.quantity import quantity
from qtraj.path.values import value

NEWTON_STEPS = 4
CELLS = 1025
"""Cells of time in which `peak` searches."""

OfPath = Callable[[AbstractHodograph, Scalar], Scalar]
"""A quantity of a path at one instant."""


@eqx.filter_jit
def peak(path: AbstractHodograph, name: str) -> tuple[Scalar, Scalar]:
    """Time [s] and size of the largest value of one path quantity (a field of `Limits`) over the whole path.

    Sought by Newton's method in 1025 cells of time, along a route in four cells of every segment; differentiable in the
    path (envelope theorem).

    **Raises:** ValueError for an unknown name.
    """
    quantity(name)
    return largest(lambda path, t: value(path, t, name), path, CELLS)


def cell_peaks(f: OfPath, path: AbstractHodograph, cells: int) -> Float[Array, " n"]:
    """Where f(path, t) is largest in each of `cells` cells: fractions of the duration, constant to differentiation."""
    nodes, low, high = _cells(path, cells)
    # Frozen before the search and not after it, or the search itself would be differentiated in vain.
    frozen = _frozen(path)

    def g(u: Scalar) -> Scalar:
        return f(frozen, u * frozen.duration)

    candidates = jnp.stack([climb(g, nodes, low, high), nodes, low, high])
    values = jax.vmap(jax.vmap(g))(candidates)
    return jnp.take_along_axis(candidates, jnp.argmax(values, axis=0)[None], axis=0)[0]


def _cells(path: AbstractHodograph, cells: int) -> tuple[Array, Array, Array]:
    """Middles and borders of the cells, in fractions of the duration; along pieces they end just before a joint."""
    joints = path.nodes()
    if joints is None:
        half = 0.5 / (cells - 1)
        nodes = jnp.linspace(0.0, 1.0, cells, dtype=path.duration.dtype)
        return nodes, jnp.clip(nodes - half, 0.0, 1.0), jnp.clip(nodes + half, 0.0, 1.0)
    low = jax.lax.stop_gradient(joints / path.duration)
    ends = jnp.concatenate([low[1:], jnp.ones_like(low[:1])])
    high = jnp.maximum(jnp.nextafter(ends, jnp.zeros_like(ends)), low)
    return 0.5 * (low + high), low, high


def largest(f: OfPath, path: AbstractHodograph, cells: int) -> tuple[Scalar, Scalar]:
    """Time and value of the largest f(path, t) over the path; the value is differentiable (envelope theorem)."""
    times = cell_peaks(f, path, cells) * path.duration
    values = jax.vmap(lambda t: f(path, t))(times)
    worst = jnp.argmax(values)
    return times[worst], values[worst]


def _frozen(path: AbstractHodograph) -> AbstractHodograph:
    return jax.tree.map(lambda x: jax.lax.stop_gradient(x) if eqx.is_array(x) else x, path)


def climb(
    g: Callable[[Scalar], Scalar],
    u: Float[Array, " n"],
    low: Float[Array, " n"],
    high: Float[Array, " n"],
    steps: int = NEWTON_STEPS,
) -> Float[Array, " n"]:
    """Newton's iteration for g' = 0 in every cell at once; uphill to the border where g is not concave."""

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
