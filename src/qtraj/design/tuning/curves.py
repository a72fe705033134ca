"""Paths of a search in unit time: polynomials of their derivatives, and what the variables do to these.

In the moving basis the derivatives of R_z(φ)·(ρ, 0, h) in u = t/T are polynomials in u: (a, b, h)' = (a' − bφ',
b' + aφ', h'). Their coefficients are differentiated in the variables once for all limits and places.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.design.tuning.problem import Problem

ORDERS = 4
LOWEST = 4  # coefficients of cubics, which stay as many where φ' is constant


class Curves(NamedTuple):
    """Ascending coefficients of r', r'', r''' and r'''' in u, those of φ, and ln T.

    Derivatives of these in the variables stand on further axes in front.
    """

    derivatives: Float[Array, "*more orders terms 3"]
    angle: Float[Array, "*more terms"]
    log_duration: Float[Array, "*more"]

    def up_to(self, order: int) -> Float[Array, "*more order terms 3"]:
        """The coefficients of the first derivatives, without those that vanish for want of degree."""
        orders, terms = self.derivatives.shape[-3:-1]
        rise = (terms - LOWEST) // orders
        return self.derivatives[..., :order, : terms - rise * (orders - order), :]


class Changes(NamedTuple):
    """First derivatives in the variables, and second ones by pairs of variables (`pairs`)."""

    first: Curves
    second: Curves


def curve(problem: Problem, z: Float[Array, " n"]) -> Curves:
    """The path of the variables."""
    coefficients, log_duration = problem.coefficients(z)
    radius, angle, height = (coefficients[:, k] for k in range(3))
    turning = _derivative(angle)[: 1 if problem.motion.is_uniform else None]
    a, b, h = radius, jnp.zeros_like(radius[:1]), height
    rows = []
    for k in range(ORDERS):
        before = a
        a = _derivative(a) if k == 0 else _add(_derivative(a), -_product(b, turning))
        b = _product(before, turning) if k == 0 else _add(_derivative(b), _product(before, turning))
        h = _derivative(h)
        rows.append((a, b, h))
    terms = max(x.shape[0] for row in rows for x in row)
    padded = [jnp.stack([jnp.pad(x, (0, terms - x.shape[0])) for x in row], axis=1) for row in rows]
    return Curves(jnp.stack(padded), angle, log_duration)


def changes(problem: Problem, z: Float[Array, " n"]) -> tuple[Curves, Changes]:
    """The path of the variables, with its derivatives in them."""
    unit = jnp.eye(z.shape[0], dtype=z.dtype)
    both = pairs(z.shape[0])

    def along(direction: Array) -> tuple[Curves, Curves]:
        return jax.jvp(lambda z: curve(problem, z), (z,), (direction,))

    def twice(one: Array, other: Array) -> Curves:
        return jax.jvp(lambda z: jax.jvp(lambda z: curve(problem, z), (z,), (one,))[1], (z,), (other,))[1]

    at, first = jax.vmap(along, out_axes=(None, 0))(unit)
    return at, Changes(first, jax.vmap(twice)(unit[both[:, 0]], unit[both[:, 1]]))


def pairs(n: int) -> np.ndarray:
    """The pairs of variables i ≤ j, (pairs, 2)."""
    return np.stack(np.triu_indices(n), axis=1)


def unpacked(x: Float[Array, "pairs *rest"]) -> Float[Array, "n n *rest"]:
    """Symmetric matrices from their upper triangles."""
    n = int((2 * x.shape[0]) ** 0.5)
    places = np.zeros((n, n), int)
    for k, (i, j) in enumerate(pairs(n)):
        places[i, j] = places[j, i] = k
    return x[places]


def _derivative(p: Float[Array, " n"]) -> Float[Array, " m"]:
    return p[1:] * jnp.arange(1, p.shape[0], dtype=p.dtype) if p.shape[0] > 1 else jnp.zeros_like(p)


def _add(p: Array, q: Array) -> Array:
    most = max(p.shape[0], q.shape[0])
    p, q = (x if x.shape[0] == most else jnp.pad(x, (0, most - x.shape[0])) for x in (p, q))
    return p + q


def _product(p: Float[Array, " m"], q: Float[Array, " n"]) -> Array:
    """The coefficients of a product: copies of one factor, each shifted by one more place, summed."""
    n = q.shape[0]
    if n == 1:
        return p * q[0]
    total = jnp.pad(p * q[0], (0, n - 1))
    for k in range(1, n):
        total = total + jnp.pad(p * q[k], (k, n - 1 - k))
    return total


def along_u(coefficients: Float[Array, "*more terms 3"], u: Float[Array, " places"], order: int) -> list[Array]:
    """Vectors of polynomials and their Taylor coefficients at the places, up to `order`: (*more, 3, places) each."""
    terms = coefficients.shape[-2]
    return _horner([coefficients[..., k, :, None] for k in range(terms)], u, order)


def angle_at(curves: Curves, u: Float[Array, " places"], order: int) -> list[Array]:
    """φ and its Taylor coefficients at the places: (*more, places) each."""
    return _horner([curves.angle[..., k, None] for k in range(curves.angle.shape[-1])], u, order)


def _horner(c: list[Array], u: Float[Array, " places"], order: int) -> list[Array]:
    wide = jnp.broadcast_to(u, (*c[0].shape[:-1], u.shape[0]))
    out: list[Array] = [c[-1] + jnp.zeros_like(wide), *[jnp.zeros_like(wide)] * order]
    for step, row in enumerate(c[-2::-1]):
        for k in range(min(order, step + 1), 0, -1):
            out[k] = out[k - 1] + (out[k] * wide if step >= k else 0.0)
        out[0] = out[0] * wide + row
    return out
