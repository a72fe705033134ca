"""The objective "nearest" to a given path: the mean squared distance at equal fractions of the arc lengths."""

from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float

from qtraj.algebra.jets import cos, matrix_product, sin, spread, sqrt, weighted_sum
from qtraj.algebra.polynomial import taylor_terms
from qtraj.design.tuning import ends
from qtraj.design.tuning.objectives.objective import AbstractObjective
from qtraj.foundation.arrays import is_traced
from qtraj.foundation.namespace import matmul, stop_gradient, xp
from qtraj.path.components import dot
from qtraj.path.equal_arcs import equal_arcs
from qtraj.path.hodograph import AbstractHodograph, require_path
from qtraj.path.moving_basis import in_moving_basis

INTERVALS = 256
"""Number of intervals of equal length, between which a cubic spline represents the given path."""

PANELS, PANEL_NODES = 8, 8
"""Panels of equal duration, and Gauss–Legendre nodes in each, at which the distance is integrated."""


class NearestTo(AbstractObjective):
    """The mean squared distance [m²] from a given path, ∫₀¹ |r(σ) − r*(σ)|² dσ.

    r(σ) and r*(σ) are the positions on the tuned and on the given path at which the arc length from the start is the
    fraction σ of the length of the respective path. So the objective depends on the shapes of both paths and on the
    directions in which they are driven, but not on their timings. The integral is computed with 64 nodes. The given
    path is represented by a cubic spline through 257 points at equal distances along it.
    """

    name: ClassVar[str] = "nearest_to"
    points: Float[Any, "*batch n 3"]
    second: Float[Any, "*batch n 3"]  # second derivatives of the spline with respect to the number of intervals

    def __init__(self, path: AbstractHodograph):
        """Sample the given path.

        **Raises:** ValueError if `path` is not a path, if it is a batch, or if its positions are not finite.
        """
        require_path(path)
        if np.ndim(path.duration):
            raise ValueError("nearest_to must be one path, but a batch was given: use jax.vmap, or tune one by one")
        points = equal_arcs(path, INTERVALS)
        self.points = points if is_traced(points) else np.asarray(points)
        if not is_traced(points) and not np.isfinite(self.points).all():
            raise ValueError("nearest_to must be a path with finite positions and a finite length, but it has others")
        self.second = matmul(spline_matrix(INTERVALS), self.points - self.points[:1])

    def value(self, problem: Any, z: Any) -> Any:
        """Return the mean squared distance [m²]."""
        nodes, weights, integration = quadrature()
        u = nodes.reshape(-1, *[1] * problem.duration.ndim)
        radius, angle, height = (taylor_terms([spread(c) for c in cubic], u, 1) for cubic in problem.cubics(z))
        velocity = in_moving_basis(radius, [0] * 2, height, angle)[1]
        speed = sqrt(dot(velocity, velocity))  # per unit of u
        length = weighted_sum(speed, weights)
        target = self._at(matrix_product(integration, speed) / spread(length), problem.placement)
        position = radius[0] * cos(angle[0]), radius[0] * sin(angle[0]), height[0]
        offset = tuple(x - y for x, y in zip(position, target, strict=True))
        return weighted_sum(dot(offset, offset) * speed, weights) / length

    def scale(self, problem: Any) -> Any:
        """Return the mean squared change of position for a change of one boundary velocity by the reference speed."""
        # The mean of (u(1 − u)²)², the square of the cubic with the slope 1 at one end, is 1/105.
        return (problem.speed * problem.duration) ** 2 / 105

    def _at(self, share: Any, placement: Any) -> tuple[Any, Any, Any]:
        """Return the components of r* in the axes of a placement, at fractions (nodes, *batch) of the arc length."""
        along = share * INTERVALS
        value = stop_gradient(getattr(along, "value", along))
        cell = xp.clip(xp.floor(value), 0.0, INTERVALS - 1.0)
        index = cell.astype(int)
        low, high = ends.local(self.points, placement), ends.local(self.second, placement, False)
        first, last, bend, last_bend = (self._taken(x, index + k) for x in (low, high) for k in (0, 1))
        b = along - cell
        a = 1.0 - b
        cubic_a, cubic_b = (a * a * a - a) * (1 / 6), (b * b * b - b) * (1 / 6)
        return tuple(
            a * first[..., k] + b * last[..., k] + cubic_a * bend[..., k] + cubic_b * last_bend[..., k]
            for k in range(3)
        )  # type: ignore[return-value]

    @staticmethod
    def _taken(table: Any, index: Any) -> Any:
        """Return the elements (nodes, *batch, 3) of a table (*batch, n, 3)."""
        return xp.moveaxis(xp.take_along_axis(table, xp.moveaxis(index, 0, -1)[..., None], axis=-2), -2, 0)


@lru_cache(maxsize=1)
def quadrature() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return nodes and weights on [0, 1], and the matrix of the integrals from 0 to each node."""
    own, weights = np.polynomial.legendre.leggauss(PANEL_NODES)
    own, weights = (own + 1) / 2, weights / 2
    # The integrals of the polynomials through the nodes of a panel, from the powers of the unit interval.
    powers = np.arange(PANEL_NODES)
    within = (own[:, None] ** (powers + 1) / (powers + 1)) @ np.linalg.inv(own[:, None] ** powers)
    matrix = np.kron(np.eye(PANELS), within) + np.kron(np.tri(PANELS, k=-1), np.tile(weights, (PANEL_NODES, 1)))
    nodes = (np.arange(PANELS)[:, None] + own).ravel() / PANELS
    return nodes, np.tile(weights, PANELS) / PANELS, matrix / PANELS


@lru_cache(maxsize=1)
def spline_matrix(intervals: int) -> np.ndarray:
    """Return the matrix from values at integers to the second derivatives of their cubic spline there."""
    from scipy.interpolate import CubicSpline  # imported here, so that `import qtraj` does not import SciPy

    knots = np.arange(intervals + 1.0)
    return CubicSpline(knots, np.eye(intervals + 1))(knots, 2)
