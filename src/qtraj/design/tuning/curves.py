"""Polynomials for the derivatives of a path, and derivatives of these polynomials with respect to the variables.

The time is u = t/T, where T is the duration. In the moving basis, the derivatives of the position R_z(φ)·(ρ, 0, h) with
respect to u have polynomial components: the derivative of a vector with the components (a, b, c) has the components
(a' − bφ', b' + aφ', c'). If the end positions are fixed, the path as a function of u depends only on its slopes at both
ends. These slopes are the boundary velocities (for φ, the angular rates) times T. The coefficients are differentiated
with respect to these slopes, once for all limits and instants.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra.polynomial import taylor_terms
from qtraj.design.tuning.problem import Problem

ORDERS = 4
TERMS = 4  # coefficients of cubics

HERMITE = np.asarray([[1, 0, 0, 0], [0, 0, 1, 0], [0, 3, -2, -1], [0, -2, 1, 1]], float)
"""The matrix that converts (first value, difference of the values, both slopes) to the coefficients of a cubic."""

ANGLE = 1  # the index of φ in (ρ, φ, h)


class Curves(NamedTuple):
    """The coefficients of ascending powers of u = t/T in a path, where T is the duration.

    `derivatives` contains the coefficients of the first four derivatives of r, and `place` those of ρ, φ and h. The
    arrays may also contain derivatives of the coefficients; leading axes then index these derivatives. If φ' is
    constant, all derivatives of r have the same degree; otherwise the degree increases by two with each derivative.
    """

    derivatives: Float[Array, "*more orders terms 3"]
    place: Float[Array, "*more terms 3"]

    @property
    def angle(self) -> Float[Array, "*more terms"]:
        """The coefficients of φ."""
        return self.place[..., ANGLE]

    def up_to(self, order: int) -> Float[Array, "*more order terms 3"]:
        """Return the coefficients of the derivatives up to `order`, without trailing zeros."""
        return up_to(self.derivatives, order)


def up_to(derivatives: Float[Array, "*more orders terms 3"], order: int) -> Float[Array, "*more order terms 3"]:
    """Return the coefficients of the derivatives up to `order`, without trailing zeros."""
    orders, terms = derivatives.shape[-3:-1]
    per_order = (terms - TERMS) // orders
    return derivatives[..., :order, : terms - per_order * (orders - order), :]


class CurveDerivatives(NamedTuple):
    """Derivatives of a path with respect to its slopes at both ends, and of the slopes with respect to the variables.

    `first` and `second` are derivatives with respect to the slopes; `slopes` (k, n) and `log_duration` (n,) are the
    derivatives of the slopes and of ln T with respect to the variables, where T is the duration. The path is linear in
    the slopes of ρ and h. So `second` contains only the pairs of slopes that include φ' (see `pairs`), and is None if
    φ' is constant.
    """

    first: Curves
    second: Float[Array, "pairs orders terms 3"] | None  # of the coefficients of the derivatives of r
    slopes: Float[Array, "k n"]
    log_duration: Float[Array, " n"]


def cubics(problem: Problem, slopes: Float[Array, "2 3"]) -> Float[Array, "4 3"]:
    """Return the coefficients of ρ, φ and h as cubics in u = t/T for given slopes at both ends."""
    first, last = problem.ends
    return jnp.asarray(HERMITE, slopes.dtype) @ jnp.concatenate([jnp.stack([first, last - first]), slopes])


@jax.jit
def reference_cubics(problem: Problem) -> Float[Array, "4 3"]:
    """Return the coefficients of ρ, φ and h as cubics in u = t/T for the initial path."""
    return cubics(problem, problem.slopes(jnp.zeros(problem.size, problem.speed.dtype))[0])


def curve(problem: Problem, slopes: Float[Array, "2 3"]) -> Curves:
    """Return the path with the given slopes dρ/du, dφ/du and dh/du at both ends."""
    cubic = cubics(problem, slopes)
    return Curves(_orders(cubic[None], _angle_rate(problem, cubic), None)[0], cubic)


def curve_derivatives(
    problem: Problem, z: Float[Array, " n"], slopes: Float[Array, "2 3"]
) -> tuple[Curves, CurveDerivatives]:
    """Return the path for the variables `z`, with the `slopes` of `z` at both ends, and its derivatives."""
    cubic, directions = cubics(problem, slopes), _directions(problem)
    # The cubics are linear in the slopes, so their derivatives with respect to the slopes are constant.
    moved: Any = np.einsum("tk,nkc->ntc", HERMITE[:, 2:], directions)
    orders = _orders(
        jnp.concatenate([cubic[None], jnp.asarray(moved, z.dtype)]),
        _angle_rate(problem, cubic),
        None if problem.motion.is_uniform else moved[:, 1:, ANGLE] * np.arange(1, TERMS),
    )
    n = directions.shape[0]
    slopes_in_z = jax.jacfwd(lambda z: problem.slopes(z)[0])(z).reshape(6, -1)
    last = 0.0 if problem.objective.fixes_duration else 1.0
    log_in_z = jnp.asarray([0.0] * (z.shape[0] - 1) + [last], z.dtype)
    free = np.flatnonzero(directions.any(axis=0).reshape(-1))
    at, first = Curves(orders[0], cubic), Curves(orders[1 : n + 1], jnp.asarray(moved, z.dtype))
    second = None if problem.motion.is_uniform else orders[n + 1 :]
    return at, CurveDerivatives(first, second, slopes_in_z[free], log_in_z)


def _angle_rate(problem: Problem, cubic: Float[Array, "4 3"]) -> Float[Array, " rates"]:
    """Return the coefficients of φ' = dφ/du for ascending powers of u."""
    if problem.motion.is_uniform:
        return cubic[1:2, ANGLE]
    return cubic[1:, ANGLE] * jnp.arange(1, TERMS, dtype=cubic.dtype)


def _orders(
    cubic: Float[Array, "rows 4 3"], angle_rate: Float[Array, " rates"], moved_rate: Float[np.ndarray, "k rates"] | None
) -> Float[Array, "rows_ orders terms 3"]:
    """Return the coefficients of the first four derivatives of r, and their derivatives with respect to the slopes.

    `cubic` contains the coefficients of ρ, φ and h, and optionally their derivatives with respect to the k slopes.
    `moved_rate` contains the derivatives of φ' with respect to the slopes; if it is given, the result includes the
    second derivatives for the `pairs` of slopes. With the components x = (a, b, c), the recursion is
    x ← x' + φ'·(−b, a, 0).
    """
    terms = TERMS if angle_rate.shape[0] == 1 else TERMS + (TERMS - 2) * ORDERS
    n_pairs = 0 if moved_rate is None else len(pairs())
    power = np.arange(1.0, terms)[None, :, None]
    turned = jnp.asarray([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]], cubic.dtype)
    x = jnp.pad(cubic * np.asarray([[[1.0, 0.0, 1.0]]]), ((0, n_pairs), (0, terms - TERMS), (0, 0)))
    orders = []
    for _ in range(ORDERS):
        rotated = x @ turned
        x = jnp.pad(x[:, 1:] * power, ((0, 0), (0, 1), (0, 0)))
        for k in range(angle_rate.shape[0]):
            shifted = rotated if k == 0 else jnp.pad(rotated[:, :-k], ((0, 0), (k, 0), (0, 0)))
            x = x + angle_rate[k] * shifted
            if moved_rate is not None:
                i, j = pairs().T
                rates = moved_rate[:, k, None, None]
                from_slopes = rates * shifted[:1]
                from_pairs = rates[i] * shifted[1 + j] + rates[j] * shifted[1 + i]
                x = x + jnp.concatenate([jnp.zeros_like(x[:1]), from_slopes, from_pairs])
        orders.append(x)
    return jnp.stack(orders, axis=1)


def pairs() -> np.ndarray:
    """Return the pairs (pairs, 2) of indices i ≤ j of two slopes, at least one of which is a slope of φ."""
    return np.asarray([(i, j) for i in range(6) for j in range(i, 6) if ANGLE in (i % 3, j % 3)])


def from_pairs(x: Float[Array, "pairs *rest"]) -> Float[Array, "k k *rest"]:
    """Return symmetric matrices with the given entries at `pairs()`, and zeros elsewhere."""
    places = np.full((6, 6), len(pairs()))
    for k, (i, j) in enumerate(pairs()):
        places[i, j] = places[j, i] = k
    return jnp.concatenate([x, jnp.zeros_like(x[:1])])[places]


def second_along(
    derivatives: CurveDerivatives, gradient: Float[Array, "order 3 places"], order: int, u: Float[Array, " places"]
) -> Array:
    """Contract `gradient` with the second derivatives of r' and the higher derivatives with respect to the k slopes.

    `gradient` is the gradient of a function with respect to the derivatives of r up to `order`, at the instants `u`.
    The shape of the result is (k, k, places).
    """
    k = derivatives.slopes.shape[0]
    if derivatives.second is None:
        return jnp.zeros((k, k, *u.shape), u.dtype)
    second = up_to(derivatives.second, order)
    powers = [jnp.ones_like(u)]
    for _ in range(second.shape[-2] - 1):
        powers.append(powers[-1] * u)
    projected = gradient[:, None] * jnp.stack(powers)[None, :, None]
    return from_pairs(second.reshape(second.shape[0], -1) @ projected.reshape(-1, u.shape[0]))


def along_u(coefficients: Float[Array, "*more terms 3"], u: Float[Array, " places"], order: int) -> list[Array]:
    """Return the values of vector polynomials at the instants `u`, and their Taylor coefficients up to `order`."""
    return _taylor(jnp.moveaxis(coefficients, -2, 0), u, order)


def angle_at(angle: Float[Array, "*more terms"], u: Float[Array, " places"], order: int) -> list[Array]:
    """Return the values of φ at the instants `u`, and its Taylor coefficients up to `order`."""
    return _taylor(jnp.moveaxis(angle, -1, 0), u, order)


@partial(jax.jit, static_argnums=2)  # so that equal shapes are traced and lowered once
def _taylor(coefficients: Float[Array, "terms *more"], u: Float[Array, " places"], order: int) -> list[Array]:
    shape = (*coefficients.shape[1:], u.shape[0])
    terms = jnp.broadcast_to(coefficients[..., None], (coefficients.shape[0], *shape))
    return taylor_terms(list(terms), jnp.broadcast_to(u, shape), order)


def _directions(problem: Problem) -> np.ndarray:
    """Return the unit vectors (k, 2, 3) of the free slopes: all six, or in uniform motion the four of ρ and h.

    The axes are the slope, the end of the path, and the coordinate.
    """
    unit = np.eye(6)
    free = [k for k in range(6) if not (problem.motion.is_uniform and k % 3 == ANGLE)]
    return unit[free].reshape(-1, 2, 3)
