"""The least-squares problem of a recorded turn in the horizontal plane: axis, radius and angle."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from numpy.polynomial import legendre

from qtraj.foundation.arrays import as_array
from qtraj.foundation.exported.kept import kept
from qtraj.foundation.types import Scalar
from qtraj.path.track import Track, known, known_elapsed

TERMS = 4
"""Coefficients of ρ and h: cubics."""

SMALLEST_BUCKET = 64
"""Samples are padded with weight 0 to a power of two from here on: windows of similar length share one compilation."""


class TurnProblem(eqx.Module):
    """Samples about the centre of a window, in lengths of `scale`; `weights` are 0 for padding."""

    basis: Float[Array, "n terms"]
    slope: Float[Array, "n terms"]  # [1/s]
    positions: Float[Array, "n 2"]
    velocities: Float[Array, "n 2"]  # [1/s]
    weights: Float[Array, " n"]
    velocity_weights: Float[Array, " n"]  # [s], 0 where no velocities are recorded
    bounds: Float[Array, "2"]

    def errors(self, unknowns: Float[Array, " m"]) -> tuple[Array, Array, Array]:
        """Weighted errors of position and velocity, and how far ρ leaves its bounds.

        `unknowns`: the axis (2,), then the coefficients of ρ and of φ in the basis.
        """
        axis, of_radius, of_angle = unknowns[:2], unknowns[2 : 2 + TERMS], unknowns[2 + TERMS :]
        terms = of_angle.shape[0]
        radius, stretch = self.basis @ of_radius, self.slope @ of_radius
        angle, rate = self.basis[:, :terms] @ of_angle, self.slope[:, :terms] @ of_angle
        along = jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=1)
        across = jnp.stack([-along[:, 1], along[:, 0]], axis=1)
        position = axis[None] + radius[:, None] * along
        velocity = stretch[:, None] * along + (radius * rate)[:, None] * across
        excess = jnp.maximum(self.bounds[0] - radius, 0.0) + jnp.maximum(radius - self.bounds[1], 0.0)
        return (
            self.weights[:, None] * (position - self.positions),
            self.velocity_weights[:, None] * (velocity - self.velocities),
            self.weights * excess,
        )


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
    basis, slope = basis_at(known_elapsed(track))
    count = len(basis)
    velocities = np.zeros((count, 2)) if track.velocities is None else known(track.velocities)[:, :2]
    weight = np.full(count, count**-0.5)
    missing = max(SMALLEST_BUCKET, 1 << (count - 1).bit_length()) - count

    def padded(x: np.ndarray) -> Array:
        return as_array(np.pad(x, [(0, missing)] + [(0, 0)] * (x.ndim - 1)), float)

    return TurnProblem(
        basis=padded(basis),
        slope=padded(slope),
        positions=padded((known(track.positions)[:, :2] - centre[:2]) / scale),
        velocities=padded(velocities / scale),
        weights=padded(weight),
        velocity_weights=padded(weight * (0.0 if track.velocities is None else ratio)),
        bounds=as_array(np.array(bounds) / scale, float),
    )


@kept()
def minimise(
    turn: TurnProblem, start: Float[Array, " m"], max_steps: int
) -> tuple[Float[Array, " m"], Scalar, Bool[Array, ""]]:
    """Unknowns that minimise the sum of squared errors, searched from `start`; that sum; whether the search ended."""
    import optimistix as optx

    small = float(jnp.finfo(start.dtype).eps)
    solution = optx.least_squares(
        lambda unknowns, turn: turn.errors(unknowns),
        optx.LevenbergMarquardt(rtol=small**0.6, atol=small**0.7),
        start,
        args=turn,
        max_steps=max_steps,
        throw=False,
    )
    cost = sum((jnp.sum(e**2) for e in turn.errors(solution.value)), jnp.zeros((), start.dtype))
    return solution.value, cost, solution.result == optx.RESULTS.successful
