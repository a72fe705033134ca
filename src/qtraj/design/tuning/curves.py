"""Paths of a search in unit time: polynomials of their derivatives, and what shapes these.

In the moving basis the derivatives of R_z(φ)·(ρ, 0, h) in u = t/T are polynomials in u: (a, b, h)' = (a' − bφ',
b' + aφ', h'). Between given ends the path in unit time depends on its slopes there alone, the boundary velocities times
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

ANGLE = 1  # the place of φ among ρ, φ and h


class Curves(NamedTuple):
    """Ascending coefficients of r', r'', r''' and r'''' in u, and of ρ, φ, h; derivatives of these with axes in front.

    Where φ' is constant degrees stay; otherwise each order has two more.
    """

    derivatives: Float[Array, "*more orders terms 3"]
    place: Float[Array, "*more terms 3"]

    @property
    def angle(self) -> Float[Array, "*more terms"]:
        """The coefficients of φ."""
        return self.place[..., ANGLE]

    def up_to(self, order: int) -> Float[Array, "*more order terms 3"]:
        """The coefficients of the first derivatives, without those that vanish for want of degree."""
        orders, terms = self.derivatives.shape[-3:-1]
        rise = (terms - TERMS) // orders
        return self.derivatives[..., :order, : terms - rise * (orders - order), :]


class Changes(NamedTuple):
    """Derivatives of curves in the slopes at the ends, and what the variables do to the slopes and to ln T.

    The path is linear in the slopes of ρ and h. So `second` has the pairs of slopes (`pairs`) of which one is of φ, and
    is None where φ' is constant.
    """

    first: Curves
    second: Curves | None
    slopes: Float[Array, "k n"]
    log_duration: Float[Array, " n"]


def cubics(problem: Problem, slopes: Float[Array, "2 3"]) -> Float[Array, "4 3"]:
    """The coefficients of ρ, φ and h in u, with these slopes at the ends."""
    first, last = problem.ends
    rise = last - first
    return jnp.stack([first, slopes[0], 3 * rise - 2 * slopes[0] - slopes[1], slopes[0] + slopes[1] - 2 * rise])


def given(problem: Problem) -> Float[Array, "4 3"]:
    """The coefficients of ρ, φ and h in u of the path from which the search starts."""
    return cubics(problem, problem.slopes(jnp.zeros(problem.size, problem.speed.dtype))[0])


def curve(problem: Problem, slopes: Float[Array, "2 3"]) -> Curves:
    """The path with these slopes of ρ, φ and h in u at its ends."""
    cubic = cubics(problem, slopes)
    uniform = problem.motion.is_uniform
    turning = (cubic[1:, ANGLE] * jnp.arange(1, TERMS, dtype=cubic.dtype))[: 1 if uniform else None]
    terms = TERMS if uniform else TERMS + (TERMS - 2) * ORDERS
    straight = jnp.asarray([1.0, 0.0, 1.0], cubic.dtype)
    x, rows = jnp.pad(cubic * straight[None], ((0, terms - TERMS), (0, 0))), []
    power = jnp.arange(1, terms, dtype=cubic.dtype)[:, None]
    for _ in range(ORDERS):
        across = jnp.stack([-x[:, 1], x[:, 0], jnp.zeros_like(x[:, 0])], axis=1)
        x = jnp.pad(x[1:] * power, ((0, 1), (0, 0)))
        for k in range(turning.shape[0]):
            x = x + turning[k] * (across if k == 0 else jnp.pad(across[:-k], ((k, 0), (0, 0))))
        rows.append(x)
    return Curves(jnp.stack(rows), cubic)


def changes(problem: Problem, z: Float[Array, " n"], slopes: Float[Array, "2 3"]) -> tuple[Curves, Changes]:
    """The path of the variables, with its derivatives."""
    unit = jnp.asarray(_directions(problem), z.dtype)

    def along(direction: Array) -> tuple[Curves, Curves]:
        return jax.jvp(lambda s: curve(problem, s), (slopes,), (direction,))

    def twice(one: Array, other: Array) -> Curves:
        return jax.jvp(lambda s: jax.jvp(lambda s: curve(problem, s), (s,), (one,))[1], (slopes,), (other,))[1]

    at, first = jax.vmap(along, out_axes=(None, 0))(unit)
    second = None
    if not problem.motion.is_uniform:
        both = pairs()
        second = jax.vmap(twice)(unit[both[:, 0]], unit[both[:, 1]])
    of_z = jax.jacfwd(lambda z: problem.slopes(z)[0])(z).reshape(6, -1)
    last = 0.0 if problem.objective.holds_duration else 1.0
    of_log = jnp.asarray([0.0] * (z.shape[0] - 1) + [last], z.dtype)
    moving = np.flatnonzero(_directions(problem).any(axis=0).reshape(-1))
    return at, Changes(first, second, of_z[moving], of_log)


def pairs() -> np.ndarray:
    """The pairs of slopes i ≤ j of which one is of φ, (pairs, 2)."""
    return np.asarray([(i, j) for i in range(6) for j in range(i, 6) if ANGLE in (i % 3, j % 3)])


def unpacked(x: Float[Array, "pairs *rest"]) -> Float[Array, "k k *rest"]:
    """Symmetric matrices from the entries of these pairs; zero elsewhere."""
    places = np.full((6, 6), len(pairs()))
    for k, (i, j) in enumerate(pairs()):
        places[i, j] = places[j, i] = k
    return jnp.concatenate([x, jnp.zeros_like(x[:1])])[places]


def along_u(coefficients: Float[Array, "*more terms 3"], u: Float[Array, " places"], order: int) -> list[Array]:
    """Vectors of polynomials and their Taylor coefficients at the places, up to `order`: (*more, 3, places) each."""
    return _horner([coefficients[..., k, :, None] for k in range(coefficients.shape[-2])], u, order)


def angle_at(angle: Float[Array, "*more terms"], u: Float[Array, " places"], order: int) -> list[Array]:
    """φ and its Taylor coefficients at the places: (*more, places) each."""
    return _horner([angle[..., k, None] for k in range(angle.shape[-1])], u, order)


def _horner(c: list[Array], u: Float[Array, " places"], order: int) -> list[Array]:
    wide = jnp.broadcast_to(u, (*c[0].shape[:-1], u.shape[0]))
    top = c[-2] + c[-1] * wide
    out: list[Array] = [top, *([jnp.broadcast_to(c[-1], wide.shape)] if order else [])]
    for row in c[-3::-1]:
        if len(out) <= order:
            out.append(out[-1])
            inner = range(len(out) - 2, 0, -1)
        else:
            inner = range(len(out) - 1, 0, -1)
        for k in inner:
            out[k] = out[k - 1] + out[k] * wide
        out[0] = out[0] * wide + row
    return out


def _directions(problem: Problem) -> np.ndarray:
    """Unit changes of the slopes that move: all six, or those of ρ and h at both ends."""
    unit = np.eye(6)
    free = [k for k in range(6) if not (problem.motion.is_uniform and k % 3 == ANGLE)]
    return unit[free].reshape(-1, 2, 3)
