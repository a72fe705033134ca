"""The least-squares problem of a recorded turn in the horizontal plane: axis, radius and angle."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from numpy.polynomial import legendre

from qtraj.foundation.arrays import as_array, bucket
from qtraj.path.track import Track, elapsed_times, to_float64

TERMS = 4
"""Coefficients of ρ and h: cubics."""

UNKNOWNS = 2 + 2 * TERMS
"""The axis (x, y), and the coefficients of ρ and φ in the basis; a linear φ holds the last two at zero."""

POINTS = 129
"""Instants at which the bounds of ρ count, evenly spread: between them a cubic leaves its bounds by little."""

PENALTY = 10.0
"""Weight of a radius beyond its bounds, against the errors of position."""

FIRST_DAMPING, LOWERED, RAISED = 1e-2, 0.3, 2.0
"""Of Levenberg and Marquardt: the first damping, and its factors after a step that helped and one that did not."""

ROUNDINGS = 100
"""Least damping, in roundings."""


class TurnProblem(eqx.Module):
    """Samples about the centre of a window, in lengths of `scale`; `weights` are 0 for padding."""

    basis: Float[Array, "n terms"]
    slope: Float[Array, "n terms"]  # [1/s]
    positions: Float[Array, "n 2"]
    velocities: Float[Array, "n 2"]  # [1/s]
    weights: Float[Array, " n"]
    velocity_weights: Float[Array, " n"]  # [s], 0 where no velocities are recorded
    bounded: Float[Array, "p terms"]  # the basis at the instants at which the bounds count
    bounds: Float[Array, "2"]

    def errors(self, unknowns: Float[Array, " m"], shifts: Float[Array, "2 p"]) -> Float[Array, " k"]:
        """Weighted errors of position and velocity, and how far ρ leaves its bounds, in one vector.

        `shifts` are the multipliers of the lower and the upper bound, as lengths that are added to the violation.
        """
        axis, of_radius, of_angle = unknowns[:2], unknowns[2 : 2 + TERMS], unknowns[2 + TERMS :]
        both, rates = jnp.stack([of_radius, of_angle]), jnp.stack([self.basis, self.slope])
        (radius, angle), (stretch, rate) = jnp.einsum("bnk,pk->bpn", rates, both)
        cos, sin = jnp.cos(angle), jnp.sin(angle)
        around = radius * rate
        position = jnp.stack([axis[0] + radius * cos, axis[1] + radius * sin], axis=1)
        velocity = jnp.stack([stretch * cos - around * sin, stretch * sin + around * cos], axis=1)
        outside = jnp.maximum(self.excess(unknowns) + shifts, 0.0)
        return jnp.concatenate(
            [
                jnp.ravel(self.weights[:, None] * (position - self.positions)),
                jnp.ravel(self.velocity_weights[:, None] * (velocity - self.velocities)),
                PENALTY * POINTS**-0.5 * jnp.ravel(outside),
            ]
        )

    def excess(self, unknowns: Float[Array, " m"]) -> Float[Array, "2 p"]:
        """How far ρ is below its lower and above its upper bound; negative inside."""
        radius = self.bounded @ unknowns[2 : 2 + TERMS]
        return jnp.stack([self.bounds[0] - radius, radius - self.bounds[1]])


def basis_at(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Legendre polynomials over the window at `times` (n,) from its start, and their time derivatives: (n, 4) each."""
    duration = times[-1]
    s = 2 * times / duration - 1
    slopes = [legendre.legval(s, legendre.legder(row)) for row in np.eye(TERMS)]
    return legendre.legvander(s, TERMS - 1), np.stack(slopes, axis=1) * 2 / duration


def problem(track: Track, centre: np.ndarray, scale: float, bounds: tuple[float, float], ratio: float) -> TurnProblem:
    """The problem of `track` about `centre` [m]; `ratio` [s] is the position sigma over the velocity sigma.

    In JAX's default precision, whatever that of the track.
    """
    basis, slope = basis_at(elapsed_times(track))
    count = len(basis)
    velocities = np.zeros((count, 2)) if track.velocities is None else to_float64(track.velocities)[:, :2]
    weight = np.full(count, count**-0.5)
    missing = bucket(count) - count

    def padded(x: np.ndarray) -> Array:
        return as_array(np.pad(x, [(0, missing)] + [(0, 0)] * (x.ndim - 1)), float)

    return TurnProblem(
        basis=padded(basis),
        slope=padded(slope),
        positions=padded((to_float64(track.positions)[:, :2] - centre[:2]) / scale),
        velocities=padded(velocities / scale),
        weights=padded(weight),
        velocity_weights=padded(weight * (0.0 if track.velocities is None else ratio)),
        bounded=as_array(legendre.legvander(np.linspace(-1, 1, POINTS), TERMS - 1), float),
        bounds=as_array(np.array(bounds) / scale, float),
    )


class Search(NamedTuple):
    """Searches side by side: where each is, what it is about to try, and whether it has ended.

    `errors` and `jacobian` are those at `unknowns`; `cost` is the sum of squared errors.
    """

    unknowns: Float[Array, "s m"]
    cost: Float[Array, " s"]
    errors: Float[Array, "s k"]
    jacobian: Float[Array, "s k m"]
    trial: Float[Array, "s m"]
    damping: Float[Array, " s"]
    ended: Bool[Array, " s"]
    steps: Int[Array, " s"]


@eqx.filter_jit
def minimise(
    turn: TurnProblem,
    starts: Float[Array, "s m"],
    shifts: Float[Array, "s 2 p"],
    free: Float[Array, " m"],
    max_steps: Int[Array, ""],
) -> tuple[Float[Array, "s m"], Float[Array, "s 2 p"], Float[Array, " s"], Bool[Array, " s"], Int[Array, " s"]]:
    """Least squares by Levenberg and Marquardt from each of `starts`; `free` is 0 for unknowns that stay.

    Where each search is, how far ρ leaves its bounds there, the sum of squared errors of position and velocity, whether
    the search ended, and its steps. All searches are one loop over
    arrays, which compiles in a fraction of the time of a general solver, and once for both motions.
    """
    count, dtype = starts.shape[0], starts.dtype
    small = float(jnp.finfo(dtype).eps) ** 0.6

    def linearised(unknowns: Float[Array, " m"], shifts: Float[Array, "2 p"]) -> tuple[Array, Array]:
        jacobian, errors = jax.jacfwd(lambda x: (turn.errors(x, shifts),) * 2, has_aux=True)(unknowns)
        return errors, jacobian * free[None]

    def step(search: Search) -> Search:
        errors, jacobian = jax.vmap(linearised)(search.trial, shifts)
        cost = jnp.sum(errors**2, axis=1)
        better = ~search.ended & (cost < search.cost)

        def chosen(new: Array, old: Array) -> Array:
            return jnp.where(better.reshape(count, *(1,) * (new.ndim - 1)), new, old)

        unknowns, errors, jacobian = (
            chosen(search.trial, search.unknowns),
            chosen(errors, search.errors),
            chosen(jacobian, search.jacobian),
        )
        damping = search.damping * jnp.where(better, LOWERED, RAISED)
        move = _damped(errors, jacobian, damping)
        ended = search.ended | ~(jnp.max(jnp.abs(move), axis=1) > small)  # also where nothing is finite
        cost = jnp.where(better, cost, search.cost)
        steps = search.steps + jnp.where(search.ended, 0, 1)
        return Search(unknowns, cost, errors, jacobian, unknowns + move, damping, ended, steps)

    size = jax.eval_shape(turn.errors, starts[0], shifts[0]).shape[0]
    first = Search(
        unknowns=starts,
        cost=jnp.full(count, jnp.inf, dtype),
        errors=jnp.zeros((count, size), dtype),
        jacobian=jnp.zeros((count, size, starts.shape[1]), dtype),
        trial=starts,
        damping=jnp.full(count, FIRST_DAMPING / LOWERED, dtype),
        ended=jnp.zeros(count, bool),
        steps=jnp.zeros(count, jnp.int32),
    )
    last = jax.lax.while_loop(lambda s: jnp.any(~s.ended & (s.steps < max_steps)), step, first)
    misfit = jnp.sum(last.errors[:, : -shifts[0].size] ** 2, axis=1)
    excess = jax.vmap(turn.excess)(last.unknowns)
    return last.unknowns, excess, misfit, last.ended & jnp.isfinite(last.cost), last.steps


def _damped(
    errors: Float[Array, "s k"], jacobian: Float[Array, "s k m"], damping: Float[Array, " s"]
) -> Float[Array, "s m"]:
    """The steps that minimise |J p + r|² + damping |D p|², D the lengths of J's columns, by the normal equations.

    Their squared condition number costs digits of a step, which later steps correct, and none of where they end.
    """
    normal = jnp.einsum("skm,skn->smn", jacobian, jacobian)
    lengths = jnp.sqrt(jnp.diagonal(normal, axis1=1, axis2=2))
    lengths = jnp.where(lengths > 0, lengths, 1.0)
    floor = ROUNDINGS * float(jnp.finfo(errors.dtype).eps)  # below it the matrix might not be positive definite
    diagonal = jnp.maximum(damping, floor)[:, None, None] * jnp.eye(lengths.shape[1], dtype=errors.dtype)[None]
    factor = jnp.linalg.cholesky(normal / (lengths[:, :, None] * lengths[:, None]) + diagonal)
    down = (jnp.einsum("skm,sk->sm", jacobian, errors) / lengths)[..., None]
    half = jax.lax.linalg.triangular_solve(factor, down, left_side=True, lower=True)
    whole = jax.lax.linalg.triangular_solve(factor, half, left_side=True, lower=True, transpose_a=True)
    return -whole[..., 0] / lengths
