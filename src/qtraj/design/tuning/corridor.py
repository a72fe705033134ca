"""The squared distance from the initial path as a constraint, with its derivatives.

Let u be the time divided by the duration. The derivatives are with respect to u and to the slopes, which are the
derivatives of the coordinates ρ, φ and h with respect to u at both ends. The coordinates are linear in the slopes. So
only the squared distance, which is a polynomial in the four fields of `Offset`, has nonzero second derivatives with
respect to the slopes. The arguments `directions` are the derivatives of the coefficients with respect to the slopes.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.design.tuning.curves import along_u
from qtraj.path.quantity import CORRIDOR, Offset

Cubics = Float[Array, "terms 3"]
Places = Float[Array, " places"]


def value(place: Cubics, reference: Cubics, u: Places) -> Places:
    """Return the squared distance at the instants `u`; `place` and `reference` are coefficients of (ρ, φ, h)."""
    return _square(along_u(_offset(place, reference), u, 0)[0])


def slopes(
    place: Cubics, directions: Float[Array, "k terms 3"], reference: Cubics, u: Places
) -> tuple[Places, Float[Array, "k places"]]:
    """Return the squared distance at the instants `u`, and its derivatives with respect to the slopes."""
    p = along_u(_offset(place, reference), u, 0)[0]
    gradient = jax.grad(lambda p: jnp.sum(_square(p)))(p)
    return _square(p), _along(gradient, along_u(_padded(directions), u, 0)[0])


def second_order(
    place: Cubics, directions: Float[Array, "k terms 3"], reference: Cubics, u: Places
) -> tuple[Places, Array, Array, Array, Places, Places]:
    """Return the squared distance at the instants `u`, and its derivatives.

    The derivatives are the first and second derivatives with respect to the slopes, the mixed second derivatives with
    respect to the slopes and u, and the first and second derivatives with respect to u.
    """
    p, in_u, in_u_twice = along_u(_offset(place, reference), u, 2)
    first, first_in_u = along_u(_padded(directions), u, 1)
    n = directions.shape[0]
    w = jnp.concatenate([first, in_u[None]])
    gradient, hessian_vp = jax.vjp(lambda p: jax.grad(lambda p: jnp.sum(_square(p)))(p), p)
    # Products with the Hessian equal products with its transpose, because it is symmetric. One product treats all
    # instants, because they are independent of each other.
    projected = jax.vmap(lambda v: hessian_vp(v)[0])(w)
    hessian = jnp.sum(w[:, None] * projected[None], axis=2)
    first_order = _along(gradient, w)
    mixed = hessian[:n, n] + _along(gradient, first_in_u)
    second_rate = hessian[n, n] + 2 * jnp.sum(gradient * in_u_twice, axis=0)
    return _square(p), first_order[:n], hessian[:n, :n], mixed, first_order[n], second_rate


def _offset(place: Cubics, reference: Cubics) -> Float[Array, "terms 4"]:
    """Return the coefficients of the four fields of `Offset`."""
    return jnp.concatenate([place - reference, reference[:, :1]], axis=1)


def _padded(directions: Float[Array, "k terms 3"]) -> Float[Array, "k terms 4"]:
    return jnp.pad(directions, ((0, 0), (0, 0), (0, 1)))


def _square(p: Float[Array, "4 places"]) -> Places:
    return CORRIDOR.numerator(Offset(*p))


def _along(gradient: Float[Array, "4 places"], w: Float[Array, "k 4 places"]) -> Float[Array, "k places"]:
    return jnp.sum(gradient[None] * w, axis=1)
