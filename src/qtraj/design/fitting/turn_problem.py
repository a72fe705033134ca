"""The least-squares problem of a recorded turn in the horizontal plane: axis, radius and angle."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.polynomial import legendre

from qtraj.path.track import Track, elapsed_times, to_float64

TERMS = 4
"""Number of coefficients of the cubics ρ and h."""

POINTS = 129
"""Number of equally spaced instants at which the bounds of ρ apply; between them a cubic can violate them slightly."""

PENALTY = 10.0
"""Weight of violations of the radius bounds relative to position errors."""

INITIAL_DAMPING, DAMPING_DECREASE, DAMPING_INCREASE = 1e-2, 0.3, 2.0
"""The initial Levenberg–Marquardt damping, and the factors on the damping after accepted and rejected steps."""

MIN_DAMPING = 100 * float(np.finfo(np.float64).eps)
"""Minimum damping; with a smaller damping the normal matrix might be singular."""

TOLERANCE = float(np.finfo(np.float64).eps) ** 0.6
"""Size of a step below which a search has converged."""


class TurnProblem(NamedTuple):
    """The least-squares problem of n samples, about the centre of the window and in units of the mean turning radius.

    `basis` and `slope` are the values and the time derivatives of the Legendre polynomials at the samples. The unknowns
    are the axis (x, y), and the coefficients of ρ and of φ. All functions map a batch of s searches.
    """

    basis: Float[np.ndarray, "n terms"]
    slope: Float[np.ndarray, "n terms"]  # [1/s]
    positions: Float[np.ndarray, "n 2"]
    velocities: Float[np.ndarray, "n 2"]  # [1/s]
    weight: float
    velocity_weight: float  # [s], 0 if no velocities are recorded
    bound_basis: Float[np.ndarray, "p terms"]  # the basis at the instants at which the bounds apply
    bounds: tuple[float, float]

    def linearised(
        self, unknowns: Float[np.ndarray, "s m"], shifts: Float[np.ndarray, "s 2 p"]
    ) -> tuple[Float[np.ndarray, "s k"], Float[np.ndarray, "s k m"]]:
        """Return the errors and their Jacobian with respect to the unknowns.

        The errors are the weighted position and velocity errors, and the weighted violations of the bounds, in one
        vector. `shifts` are the multipliers of the lower and the upper bound, divided by the penalty. They are added to
        the violations at the p instants of the bounds.
        """
        values, jacobian = self._states(unknowns)
        count = len(unknowns)
        recorded = np.stack([self.positions.T, self.velocities.T])  # (2, 2, n)
        weights = np.array([self.weight, self.velocity_weight]).reshape(2, 1, 1)
        errors = weights * (values - recorded)
        jacobian = weights[..., None] * jacobian
        shifted = self.bound_violations(unknowns) + shifts
        weight = PENALTY * POINTS**-0.5
        bound_jacobian = np.zeros((*shifted.shape, unknowns.shape[1]))
        bound_jacobian[:, 0, :, 2 : 2 + TERMS], bound_jacobian[:, 1, :, 2 : 2 + TERMS] = (
            -weight * self.bound_basis,
            weight * self.bound_basis,
        )
        bound_jacobian *= (shifted > 0)[..., None]
        return (
            np.concatenate([errors.reshape(count, -1), weight * np.maximum(shifted, 0.0).reshape(count, -1)], axis=1),
            np.concatenate(
                [x.reshape(count, -1, unknowns.shape[1]) for x in (jacobian, bound_jacobian)],
                axis=1,
            ),
        )

    def _states(
        self, unknowns: Float[np.ndarray, "s m"]
    ) -> tuple[Float[np.ndarray, "s 2 2 n"], Float[np.ndarray, "s 2 2 n m"]]:
        """Return the position (x, y) and the velocity (x, y) at the samples, and their Jacobian."""
        radius_coefficients, angle_coefficients = unknowns[:, 2 : 2 + TERMS], unknowns[:, 2 + TERMS :]
        angle_terms = angle_coefficients.shape[1]
        angle_basis, angle_slope = self.basis[:, :angle_terms], self.slope[:, :angle_terms]
        radius, radial_rate = radius_coefficients @ self.basis.T, radius_coefficients @ self.slope.T
        angle, rate = angle_coefficients @ angle_basis.T, angle_coefficients @ angle_slope.T
        outward = np.stack([np.cos(angle), np.sin(angle)], axis=1)  # (s, 2, n)
        sideways = np.stack([-outward[:, 1], outward[:, 0]], axis=1)
        from_axis = radius[:, None] * outward
        tangential = (radius * rate)[:, None]
        velocity = radial_rate[:, None] * outward + tangential * sideways
        values = np.stack([unknowns[:, :2, None] + from_axis, velocity], axis=1)

        jacobian = np.zeros((*values.shape, unknowns.shape[1]))
        jacobian[:, 0, 0, :, 0] = jacobian[:, 0, 1, :, 1] = 1.0
        of_radius, of_angle = jacobian[..., 2 : 2 + TERMS], jacobian[..., 2 + TERMS :]
        of_radius[:, 0] = outward[..., None] * self.basis
        of_radius[:, 1] = outward[..., None] * self.slope + (rate[:, None] * sideways)[..., None] * self.basis
        turned = radial_rate[:, None] * sideways - tangential * outward
        of_angle[:, 0] = (radius[:, None] * sideways)[..., None] * angle_basis
        of_angle[:, 1] = turned[..., None] * angle_basis + (radius[:, None] * sideways)[..., None] * angle_slope
        return values, jacobian

    def bound_violations(self, unknowns: Float[np.ndarray, "s m"]) -> Float[np.ndarray, "s 2 p"]:
        """Return the violations of the lower and the upper bound of ρ, negative where the bound is satisfied."""
        radius = unknowns[:, 2 : 2 + TERMS] @ self.bound_basis.T
        return np.stack([self.bounds[0] - radius, radius - self.bounds[1]], axis=1)


def legendre_basis(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the Legendre polynomials over the window, and their time derivatives, (n, 4) each.

    `times` (n,) [s] are measured from the start of the window; the last one is its duration.
    """
    duration = times[-1]
    s = 2 * times / duration - 1
    slopes = [legendre.legval(s, legendre.legder(unit)) for unit in np.eye(TERMS)]
    return legendre.legvander(s, TERMS - 1), np.stack(slopes, axis=1) * 2 / duration


def problem(track: Track, centre: np.ndarray, scale: float, bounds: tuple[float, float], ratio: float) -> TurnProblem:
    """Return the problem of `track`; `ratio` [s] is position sigma divided by velocity sigma."""
    basis, slope = legendre_basis(elapsed_times(track))
    count = len(basis)
    velocities = np.zeros((count, 2)) if track.velocities is None else to_float64(track.velocities)[:, :2]
    return TurnProblem(
        basis=basis,
        slope=slope,
        positions=(to_float64(track.positions)[:, :2] - centre[:2]) / scale,
        velocities=velocities / scale,
        weight=count**-0.5,
        velocity_weight=0.0 if track.velocities is None else count**-0.5 * ratio,
        bound_basis=legendre.legvander(np.linspace(-1, 1, POINTS), TERMS - 1),
        bounds=(bounds[0] / scale, bounds[1] / scale),
    )


class Search(NamedTuple):
    """The results of a batch of searches.

    `misfit` are the sums of squared errors of position and velocity.
    """

    unknowns: Float[np.ndarray, "s m"]
    violations: Float[np.ndarray, "s 2 p"]
    misfit: Float[np.ndarray, " s"]
    converged: Bool[np.ndarray, " s"]
    steps: Int[np.ndarray, " s"]


def minimise(
    turn: TurnProblem, starts: Float[np.ndarray, "s m"], shifts: Float[np.ndarray, "s 2 p"], max_steps: int
) -> Search:
    """Solve the least-squares problem by the Levenberg–Marquardt method from each of `starts`.

    All searches run in one loop over arrays; a search that has converged leaves the loop.
    """
    count = len(starts)
    unknowns, trial, cost = starts.copy(), starts.copy(), np.full(count, np.inf)
    damping, steps = np.full(count, INITIAL_DAMPING / DAMPING_DECREASE), np.zeros(count, int)
    errors, jacobian = (np.zeros_like(x) for x in turn.linearised(starts, shifts))
    active = np.arange(count)
    for _ in range(max_steps):
        new_errors, new_jacobian = turn.linearised(trial[active], shifts[active])
        new_cost = np.sum(new_errors**2, axis=1)
        better = new_cost < cost[active]
        accepted = active[better]
        unknowns[accepted], cost[accepted] = trial[accepted], new_cost[better]
        errors[accepted], jacobian[accepted] = new_errors[better], new_jacobian[better]
        damping[active] *= np.where(better, DAMPING_DECREASE, DAMPING_INCREASE)
        steps[active] += 1
        move = _damped(errors[active], jacobian[active], damping[active])
        trial[active] = unknowns[active] + move
        active = active[np.max(np.abs(move), axis=1) > TOLERANCE]  # NaN ends a search as well
        if not active.size:
            break
    converged = np.isfinite(cost)
    converged[active] = False
    misfit = np.sum(errors[:, : -shifts[0].size] ** 2, axis=1)
    return Search(unknowns, turn.bound_violations(unknowns), misfit, converged, steps)


def _damped(
    errors: Float[np.ndarray, "s k"], jacobian: Float[np.ndarray, "s k m"], damping: Float[np.ndarray, " s"]
) -> Float[np.ndarray, "s m"]:
    """Return the steps p that minimise |J p + r|² + damping |D p|².

    J is the Jacobian, r are the errors, and the diagonal matrix D contains the norms of the columns of J. The normal
    equations square the condition number. This reduces the accuracy of a step but not of the solution, because later
    steps correct the error.
    """
    transposed = np.swapaxes(jacobian, 1, 2)
    normal = transposed @ jacobian
    lengths = np.sqrt(np.diagonal(normal, axis1=1, axis2=2))
    lengths = np.where(lengths > 0, lengths, 1.0)
    diagonal = np.maximum(damping, MIN_DAMPING)[:, None, None] * np.eye(lengths.shape[1])
    matrix = normal / (lengths[:, :, None] * lengths[:, None]) + diagonal
    gradient = (transposed @ errors[..., None]) / lengths[..., None]
    return -np.linalg.solve(matrix, gradient)[..., 0] / lengths
