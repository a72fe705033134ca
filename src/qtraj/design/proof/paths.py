"""Prepare paths for `certify`: the polynomials of polynomial paths, and functions that evaluate their quantities."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra.quaternion import conjugate, rotate
from qtraj.design.proof.inequalities import PathDerivatives, Vectors, path_derivatives
from qtraj.design.proof.judge import Evaluate, Scale
from qtraj.path.frenet import Invariants
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.moving_basis import MovingPolynomials
from qtraj.path.values import to_turned_basis

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


class PolynomialPaths(eqx.Module):
    """The data of a batch of polynomial paths; paths with equal numbers of coefficients share an executable."""

    polynomials: MovingPolynomials
    duration: Float[Array, "*paths"]
    orientation: Float[Array | np.ndarray, "*paths 4"]


def prepared(path: AbstractHodograph, axes: int) -> Any:
    """Return the data on which the findings depend: the polynomials of polynomial paths, or the paths themselves.

    `axes` is the number of batch axes of `path`.
    """
    polynomials = _vmap_times(lambda path: path.polynomials(), axes)(path)
    if polynomials is None:
        return path
    placement, shape = polynomials.placement, path.duration.shape
    if placement is None:
        orientation: Any = np.broadcast_to(IDENTITY, (*shape, 4))
    else:
        orientation = placement.orientation.astype(path.duration.dtype)
    return PolynomialPaths(
        MovingPolynomials(polynomials.x, polynomials.y, polynomials.z, polynomials.angle), path.duration, orientation
    )


def _vmap_times(function: Any, axes: int) -> Any:
    for _ in range(axes):
        function = eqx.filter_vmap(function)
    return function


def from_polynomials(source: PolynomialPaths) -> tuple[Evaluate, Scale, Array, PathDerivatives]:
    """Return the arguments of `judge` for polynomial paths."""
    coefficients = jax.tree.map(lambda x: jnp.moveaxis(x, 0, -1), source.polynomials)
    polynomials = path_derivatives(coefficients, source.duration)
    w, x, y, z = source.orientation.T
    vertical = jax.vmap(lambda q: rotate(conjugate(q), jnp.asarray([0.0, 0.0, 1.0], q.dtype)))(source.orientation).T

    @jax.jit
    def up(s: Array) -> Vectors:
        t, angle = polynomials.unit[None] * (s + 1), jnp.zeros_like(s)
        for c in coefficients.angle[::-1]:
            angle = angle * t + c[None]
        return Vectors(*to_turned_basis(vertical[:, None], angle))

    def evaluate(s: Array, order: int, with_vertical: bool) -> Invariants:
        derivatives = [None, *(Vectors(*r.at(s)) for r in polynomials.derivatives[:order])]
        return Invariants(derivatives, up(s) if with_vertical else None)

    is_vertical = ((x == 0) & (y == 0)) | ((w == 0) & (z == 0))
    return evaluate, Scale(polynomials.length, polynomials.unit), is_vertical, polynomials


def from_curves(paths: AbstractHodograph) -> tuple[Evaluate, Scale, Array, None]:
    """Return the arguments of `judge` for paths that are not polynomial."""
    unit = 0.5 * paths.duration
    arrays, static = eqx.partition(paths, eqx.is_array)

    def evaluate(s: Array, order: int, with_vertical: bool) -> Invariants:
        def of_path(arrays: Any, t: Array) -> Array:
            path = eqx.combine(arrays, static)
            return jax.vmap(lambda t: path.derivatives(t, order))(t)

        # The axes of the derivatives are the instant, the order, the path and the component.
        derivatives = jax.vmap(of_path, (0, 1), 2)(arrays, unit[None] * (s + 1))
        scaled = [derivatives[:, k] * (unit**k)[None, :, None] for k in range(order + 1)]
        return Invariants([Vectors(r[..., 0], r[..., 1], r[..., 2]) for r in scaled])

    return evaluate, Scale(jnp.ones_like(unit), unit), jnp.ones(unit.shape, bool), None
