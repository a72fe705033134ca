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
"""Number of coefficients of the cubics ρ and h."""

UNKNOWNS = 2 + 2 * TERMS
"""Number of unknowns: the axis (x, y), and the coefficients of ρ and φ; the last two are zero for a linear φ."""

POINTS = 129
"""Number of equally spaced instants at which the bounds of ρ apply; between them a cubic can violate them slightly."""

PENALTY = 10.0
"""Weight of violations of the radius bounds relative to position errors."""

INITIAL_DAMPING, DAMPING_DECREASE, DAMPING_INCREASE = 1e-2, 0.3, 2.0
"""The initial Levenberg–Marquardt damping, and the factors on the damping after accepted and rejected steps."""

MIN_DAMPING = 100
"""Minimum damping, in units of machine epsilon."""


class TurnProblem(eqx.Module):
    """The least-squares problem of n samples, about the centre of the window and in units of the mean turning radius.

    `basis` and `slope` are the values and the time derivatives of the Legendre polynomials at the samples. Padding has
    the weight 0.
    """

    basis: Float[Array, "n terms"]
    slope: Float[Array, "n terms"]  # [1/s]
    positions: Float[Array, "n 2"]
    velocities: Float[Array, "n 2"]  # [1/s]
    weights: Float[Array, " n"]
    velocity_weights: Float[Array, " n"]  # [s], 0 where no velocities are recorded
    bound_basis: Float[Array, "p terms"]  # the basis at the instants at which the bounds apply
    bounds: Float[Array, "2"]

    def errors(self, unknowns: Float[Array, " m"], shifts: Float[Array, "2 p"]) -> Float[Array, " k"]:
        """Return the weighted position and velocity errors, and the weighted violations of the bounds, in one vector.

        `shifts` are the multipliers of the lower and the upper bound, divided by the penalty. They are added to the
        violations at the p instants of the bounds.
        """
        axis, radius_coefficients, angle_coefficients = unknowns[:2], unknowns[2 : 2 + TERMS], unknowns[2 + TERMS :]
        coefficients, rates = jnp.stack([radius_coefficients, angle_coefficients]), jnp.stack([self.basis, self.slope])
        (radius, angle), (radial_rate, rate) = jnp.einsum("bnk,pk->bpn", rates, coefficients)
        cos, sin = jnp.cos(angle), jnp.sin(angle)
        tangential = radius * rate
        position = jnp.stack([axis[0] + radius * cos, axis[1] + radius * sin], axis=1)
        velocity = jnp.stack([radial_rate * cos - tangential * sin, radial_rate * sin + tangential * cos], axis=1)
        shifted_violations = jnp.maximum(self.bound_violations(unknowns) + shifts, 0.0)
        return jnp.concatenate(
            [
                jnp.ravel(self.weights[:, None] * (position - self.positions)),
                jnp.ravel(self.velocity_weights[:, None] * (velocity - self.velocities)),
                PENALTY * POINTS**-0.5 * jnp.ravel(shifted_violations),
            ]
        )

    def bound_violations(self, unknowns: Float[Array, " m"]) -> Float[Array, "2 p"]:
        """Return the violations of the lower and the upper bound of ρ, negative where the bound is satisfied."""
        radius = self.bound_basis @ unknowns[2 : 2 + TERMS]
        return jnp.stack([self.bounds[0] - radius, radius - self.bounds[1]])


def legendre_basis(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the Legendre polynomials over the window, and their time derivatives, (n, 4) each.

    `times` (n,) [s] are measured from the start of the window; the last one is its duration.
    """
    duration = times[-1]
    s = 2 * times / duration - 1
    slopes = [legendre.legval(s, legendre.legder(unit)) for unit in np.eye(TERMS)]
    return legendre.legvander(s, TERMS - 1), np.stack(slopes, axis=1) * 2 / duration


def problem(track: Track, centre: np.ndarray, scale: float, bounds: tuple[float, float], ratio: float) -> TurnProblem:
    """Build the least-squares problem of `track`, relative to `centre` [m] and in units of `scale` [m].

    `ratio` [s] is the position sigma divided by the velocity sigma. The arrays have JAX's default precision, not
    the precision of the track.
    """
    basis, slope = legendre_basis(elapsed_times(track))
    count = len(basis)
    velocities = np.zeros((count, 2)) if track.velocities is None else to_float64(track.velocities)[:, :2]
    weight = np.full(count, count**-0.5)
    n_padding = bucket(count) - count

    def padded(x: np.ndarray) -> Array:
        return as_array(np.pad(x, [(0, n_padding)] + [(0, 0)] * (x.ndim - 1)), float)

    return TurnProblem(
        basis=padded(basis),
        slope=padded(slope),
        positions=padded((to_float64(track.positions)[:, :2] - centre[:2]) / scale),
        velocities=padded(velocities / scale),
        weights=padded(weight),
        velocity_weights=padded(weight * (0.0 if track.velocities is None else ratio)),
        bound_basis=as_array(legendre.legvander(np.linspace(-1, 1, POINTS), TERMS - 1), float),
        bounds=as_array(np.array(bounds) / scale, float),
    )


class Search(NamedTuple):
    """The state of a batch of searches.

    `unknowns` are the current points, with their errors, Jacobians and sums of squared errors (`cost`). `trial` are the
    points to be evaluated next.
    """

    unknowns: Float[Array, "s m"]
    cost: Float[Array, " s"]
    errors: Float[Array, "s k"]
    jacobian: Float[Array, "s k m"]
    trial: Float[Array, "s m"]
    damping: Float[Array, " s"]
    converged: Bool[Array, " s"]
    steps: Int[Array, " s"]


@eqx.filter_jit
def minimise(
    turn: TurnProblem,
    starts: Float[Array, "s m"],
    shifts: Float[Array, "s 2 p"],
    free: Float[Array, " m"],
    max_steps: Int[Array, ""],
) -> tuple[Float[Array, "s m"], Float[Array, "s 2 p"], Float[Array, " s"], Bool[Array, " s"], Int[Array, " s"]]:
    """Solve the least-squares problem by the Levenberg–Marquardt method from each of `starts`.

    `free` is 1 for free and 0 for fixed unknowns. Returns, for each search, the unknowns, the violations of the bounds
    of ρ, the sum of squared errors of position and velocity, whether the search converged, and its number of steps. All
    searches run in one loop over arrays. This loop compiles much faster than a general solver, and only once for both
    motions.
    """
    count, dtype = starts.shape[0], starts.dtype
    tolerance = float(jnp.finfo(dtype).eps) ** 0.6

    def linearised(unknowns: Float[Array, " m"], shifts: Float[Array, "2 p"]) -> tuple[Array, Array]:
        jacobian, errors = jax.jacfwd(lambda x: (turn.errors(x, shifts),) * 2, has_aux=True)(unknowns)
        return errors, jacobian * free[None]

    def step(search: Search) -> Search:
        errors, jacobian = jax.vmap(linearised)(search.trial, shifts)
        cost = jnp.sum(errors**2, axis=1)
        better = ~search.converged & (cost < search.cost)

        def select(new: Array, old: Array) -> Array:
            return jnp.where(better.reshape(count, *(1,) * (new.ndim - 1)), new, old)

        unknowns, errors, jacobian = (
            select(search.trial, search.unknowns),
            select(errors, search.errors),
            select(jacobian, search.jacobian),
        )
        damping = search.damping * jnp.where(better, DAMPING_DECREASE, DAMPING_INCREASE)
        move = _damped(errors, jacobian, damping)
        converged = search.converged | ~(jnp.max(jnp.abs(move), axis=1) > tolerance)  # true for NaN as well
        cost = jnp.where(better, cost, search.cost)
        steps = search.steps + jnp.where(search.converged, 0, 1)
        return Search(unknowns, cost, errors, jacobian, unknowns + move, damping, converged, steps)

    n_errors = jax.eval_shape(turn.errors, starts[0], shifts[0]).shape[0]
    initial = Search(
        unknowns=starts,
        cost=jnp.full(count, jnp.inf, dtype),
        errors=jnp.zeros((count, n_errors), dtype),
        jacobian=jnp.zeros((count, n_errors, starts.shape[1]), dtype),
        trial=starts,
        damping=jnp.full(count, INITIAL_DAMPING / DAMPING_DECREASE, dtype),
        converged=jnp.zeros(count, bool),
        steps=jnp.zeros(count, jnp.int32),
    )
    final = jax.lax.while_loop(lambda s: jnp.any(~s.converged & (s.steps < max_steps)), step, initial)
    misfit = jnp.sum(final.errors[:, : -shifts[0].size] ** 2, axis=1)
    bound_violations = jax.vmap(turn.bound_violations)(final.unknowns)
    return final.unknowns, bound_violations, misfit, final.converged & jnp.isfinite(final.cost), final.steps


def _damped(
    errors: Float[Array, "s k"], jacobian: Float[Array, "s k m"], damping: Float[Array, " s"]
) -> Float[Array, "s m"]:
    """Return the steps p that minimise |J p + r|² + damping |D p|².

    J is the Jacobian, r are the errors, and the diagonal matrix D contains the norms of the columns of J. The normal
    equations square the condition number. This reduces the accuracy of a step but not of the solution, because later
    steps correct the error.
    """
    normal = jnp.einsum("skm,skn->smn", jacobian, jacobian)
    lengths = jnp.sqrt(jnp.diagonal(normal, axis1=1, axis2=2))
    lengths = jnp.where(lengths > 0, lengths, 1.0)
    # With a smaller damping the matrix might not be positive definite.
    min_damping = MIN_DAMPING * float(jnp.finfo(errors.dtype).eps)
    diagonal = jnp.maximum(damping, min_damping)[:, None, None] * jnp.eye(lengths.shape[1], dtype=errors.dtype)[None]
    factor = jnp.linalg.cholesky(normal / (lengths[:, :, None] * lengths[:, None]) + diagonal)
    gradient = (jnp.einsum("skm,sk->sm", jacobian, errors) / lengths)[..., None]
    half = jax.lax.linalg.triangular_solve(factor, gradient, left_side=True, lower=True)
    step = jax.lax.linalg.triangular_solve(factor, half, left_side=True, lower=True, transpose_a=True)
    return -step[..., 0] / lengths
