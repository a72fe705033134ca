"""The distance from the given path as a constraint: its square, with derivatives in the slopes at the ends and in u.

ρ, φ and h are linear in the slopes, so that all there is to differentiate twice is the square itself, a polynomial in
the four numbers of `Offset`.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.design.tuning.curves import along_u
from qtraj.path.quantity import CORRIDOR, Offset

Cubics = Float[Array, "terms 3"]
Places = Float[Array, " places"]


def value(place: Cubics, given: Cubics, u: Places) -> Places:
    """The square at the places `u`."""
    return _square(along_u(_offset(place, given), u, 0)[0])


def slopes(
    place: Cubics, moved: Float[Array, "k terms 3"], given: Cubics, u: Places
) -> tuple[Places, Float[Array, "k places"]]:
    """The square at the places `u`, and its derivatives in the slopes."""
    p = along_u(_offset(place, given), u, 0)[0]
    gradient = jax.grad(lambda p: jnp.sum(_square(p)))(p)
    return _square(p), _along(gradient, along_u(_padded(moved), u, 0)[0])


def expanded(
    place: Cubics, moved: Float[Array, "k terms 3"], given: Cubics, u: Places
) -> tuple[Places, Array, Array, Array, Places, Places]:
    """The square, its derivatives in the slopes, those in slopes and u, and in u."""
    p, in_u, in_u_twice = along_u(_offset(place, given), u, 2)
    first, first_in_u = along_u(_padded(moved), u, 1)
    n = moved.shape[0]
    w = jnp.concatenate([first, in_u[None]])
    gradient, of_w = jax.vjp(lambda p: jax.grad(lambda p: jnp.sum(_square(p)))(p), p)
    onto = jax.vmap(lambda v: of_w(v)[0])(w)  # the Hessian, which is symmetric and of each place its own
    curved = jnp.sum(w[:, None] * onto[None], axis=2)
    flat = _along(gradient, w)
    mixed = curved[:n, n] + _along(gradient, first_in_u)
    bend = curved[n, n] + 2 * jnp.sum(gradient * in_u_twice, axis=0)
    return _square(p), flat[:n], curved[:n, :n], mixed, flat[n], bend


def _offset(place: Cubics, given: Cubics) -> Float[Array, "terms 4"]:
    """Coefficients of the numbers of an `Offset`."""
    return jnp.concatenate([place - given, given[:, :1]], axis=1)


def _padded(moved: Float[Array, "k terms 3"]) -> Float[Array, "k terms 4"]:
    return jnp.pad(moved, ((0, 0), (0, 0), (0, 1)))


def _square(p: Float[Array, "4 places"]) -> Places:
    return CORRIDOR.numerator(Offset(*p))


def _along(gradient: Float[Array, "4 places"], w: Float[Array, "k 4 places"]) -> Float[Array, "k places"]:
    return jnp.sum(gradient[None] * w, axis=1)
