"""Paths in unit time: the polynomials of their derivatives, and the derivatives of those in the variables.

In the moving basis the derivatives of R_z(φ)·(ρ, 0, h) in u = t/T are polynomials in u: (a, b, h)' = (a' − bφ',
b' + aφ', h'). Between fixed ends the path in unit time depends only on its slopes there, the boundary velocities times
T. The coefficients are differentiated in these slopes, once for all limits and places.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.design.tuning.problem import Problem

ORDERS = 4
TERMS = 4  # coefficients of cubics

ANGLE = 1  # the index of φ in (ρ, φ, h)


class Curves(NamedTuple):
    """Ascending coefficients in u of r', r'', r''', r'''' and of ρ, φ, h; or derivatives of these, with leading axes.

    With constant φ' all orders have the same degree; otherwise each order adds two.
    """

    derivatives: Float[Array, "*more orders terms 3"]
    place: Float[Array, "*more terms 3"]

    @property
    def angle(self) -> Float[Array, "*more terms"]:
        """The coefficients of φ."""
        return self.place[..., ANGLE]

    def up_to(self, order: int) -> Float[Array, "*more order terms 3"]:
        """The coefficients of the derivatives up to `order`, without trailing zeros."""
        orders, terms = self.derivatives.shape[-3:-1]
        per_order = (terms - TERMS) // orders
        return self.derivatives[..., :order, : terms - per_order * (orders - order), :]


class CurveDerivatives(NamedTuple):
    """Derivatives of curves in the slopes at the ends, and of the slopes and ln T in the variables.

    The path is linear in the slopes of ρ and h. So `second` contains only the pairs of slopes (`pairs`) with φ' among
    them, and is None where φ' is constant.
    """

    first: Curves
    second: Curves | None
    slopes: Float[Array, "k n"]
    log_duration: Float[Array, " n"]


def cubics(problem: Problem, slopes: Float[Array, "2 3"]) -> Float[Array, "4 3"]:
    """The coefficients of ρ, φ and h in u, with these slopes at the ends."""
    first, last = problem.ends
    difference = last - first
    return jnp.stack(
        [first, slopes[0], 3 * difference - 2 * slopes[0] - slopes[1], slopes[0] + slopes[1] - 2 * difference]
    )


def reference_cubics(problem: Problem) -> Float[Array, "4 3"]:
    """The coefficients of ρ, φ and h in u of the initial path."""
    return cubics(problem, problem.slopes(jnp.zeros(problem.size, problem.speed.dtype))[0])


def curve(problem: Problem, slopes: Float[Array, "2 3"]) -> Curves:
    """The path with these slopes of ρ, φ and h in u at its ends."""
    cubic = cubics(problem, slopes)
    uniform = problem.motion.is_uniform
    angle_rate = (cubic[1:, ANGLE] * jnp.arange(1, TERMS, dtype=cubic.dtype))[: 1 if uniform else None]
    terms = TERMS if uniform else TERMS + (TERMS - 2) * ORDERS
    straight = jnp.asarray([1.0, 0.0, 1.0], cubic.dtype)
    x, orders = jnp.pad(cubic * straight[None], ((0, terms - TERMS), (0, 0))), []
    power = jnp.arange(1, terms, dtype=cubic.dtype)[:, None]
    for _ in range(ORDERS):
        rotated = jnp.stack([-x[:, 1], x[:, 0], jnp.zeros_like(x[:, 0])], axis=1)
        x = jnp.pad(x[1:] * power, ((0, 1), (0, 0)))
        for k in range(angle_rate.shape[0]):
            x = x + angle_rate[k] * (rotated if k == 0 else jnp.pad(rotated[:-k], ((k, 0), (0, 0))))
        orders.append(x)
    return Curves(jnp.stack(orders), cubic)


def curve_derivatives(
    problem: Problem, z: Float[Array, " n"], slopes: Float[Array, "2 3"]
) -> tuple[Curves, CurveDerivatives]:
    """The path for the variables, with its derivatives."""
    unit = jnp.asarray(_directions(problem), z.dtype)

    def along(direction: Array) -> tuple[Curves, Curves]:
        return jax.jvp(lambda s: curve(problem, s), (slopes,), (direction,))

    def twice(one: Array, other: Array) -> Curves:
        return jax.jvp(lambda s: jax.jvp(lambda s: curve(problem, s), (s,), (one,))[1], (slopes,), (other,))[1]

    at, first = jax.vmap(along, out_axes=(None, 0))(unit)
    second = None
    if not problem.motion.is_uniform:
        first_index, second_index = pairs().T
        second = jax.vmap(twice)(unit[first_index], unit[second_index])
    slopes_in_z = jax.jacfwd(lambda z: problem.slopes(z)[0])(z).reshape(6, -1)
    last = 0.0 if problem.objective.fixes_duration else 1.0
    log_in_z = jnp.asarray([0.0] * (z.shape[0] - 1) + [last], z.dtype)
    free = np.flatnonzero(_directions(problem).any(axis=0).reshape(-1))
    return at, CurveDerivatives(first, second, slopes_in_z[free], log_in_z)


def pairs() -> np.ndarray:
    """The pairs of slopes i ≤ j with a slope of φ among them, (pairs, 2)."""
    return np.asarray([(i, j) for i in range(6) for j in range(i, 6) if ANGLE in (i % 3, j % 3)])


def from_pairs(x: Float[Array, "pairs *rest"]) -> Float[Array, "k k *rest"]:
    """Symmetric matrices from their entries at `pairs()`; zero elsewhere."""
    places = np.full((6, 6), len(pairs()))
    for k, (i, j) in enumerate(pairs()):
        places[i, j] = places[j, i] = k
    return jnp.concatenate([x, jnp.zeros_like(x[:1])])[places]


def second_along(
    derivatives: CurveDerivatives, gradient: Float[Array, "order 3 places"], order: int, u: Float[Array, " places"]
) -> Array:
    """The gradient in r', r'', … times their second derivatives in the slopes: (k, k, places)."""
    k = derivatives.slopes.shape[0]
    if derivatives.second is None:
        return jnp.zeros((k, k, *u.shape), u.dtype)
    second = derivatives.second.up_to(order)
    powers = [jnp.ones_like(u)]
    for _ in range(second.shape[-2] - 1):
        powers.append(powers[-1] * u)
    projected = gradient[:, None] * jnp.stack(powers)[None, :, None]
    return from_pairs(second.reshape(second.shape[0], -1) @ projected.reshape(-1, u.shape[0]))


def along_u(coefficients: Float[Array, "*more terms 3"], u: Float[Array, " places"], order: int) -> list[Array]:
    """Vectors of polynomials at the places, and their Taylor coefficients up to `order`: (*more, 3, places) each."""
    return _horner([coefficients[..., k, :, None] for k in range(coefficients.shape[-2])], u, order)


def angle_at(angle: Float[Array, "*more terms"], u: Float[Array, " places"], order: int) -> list[Array]:
    """φ at the places, and its Taylor coefficients up to `order`: (*more, places) each."""
    return _horner([angle[..., k, None] for k in range(angle.shape[-1])], u, order)


def _horner(c: list[Array], u: Float[Array, " places"], order: int) -> list[Array]:
    broadcast = jnp.broadcast_to(u, (*c[0].shape[:-1], u.shape[0]))
    top = c[-2] + c[-1] * broadcast
    out: list[Array] = [top, *([jnp.broadcast_to(c[-1], broadcast.shape)] if order else [])]
    for row in c[-3::-1]:
        if len(out) <= order:
            out.append(out[-1])
            inner = range(len(out) - 2, 0, -1)
        else:
            inner = range(len(out) - 1, 0, -1)
        for k in inner:
            out[k] = out[k - 1] + out[k] * broadcast
        out[0] = out[0] * broadcast + row
    return out


def _directions(problem: Problem) -> np.ndarray:
    """Unit changes of the free slopes: all six, or those of ρ and h for uniform motion."""
    unit = np.eye(6)
    free = [k for k in range(6) if not (problem.motion.is_uniform and k % 3 == ANGLE)]
    return unit[free].reshape(-1, 2, 3)
