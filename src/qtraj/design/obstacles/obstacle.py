"""Define the base class of obstacles."""

from __future__ import annotations

import abc
import dataclasses
from fractions import Fraction
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra import subdivision
from qtraj.algebra.combined_claims import AnyClaim
from qtraj.algebra.exact import ExactPolynomial
from qtraj.design.obstacles.place import Place
from qtraj.foundation.arrays import as_float, concrete, require_finite
from qtraj.foundation.namespace import xp
from qtraj.foundation.types import ArrayInput


class AbstractObstacle(eqx.Module):
    """A closed set of points that no ball of the body may enter."""

    @abc.abstractmethod
    def distance(self, points: Float[Any, "*n 3"], times: Float[Any, "*n"]) -> Float[Any, "*n"]:
        """Return the distances [m] of points [m] from the obstacle at the times [s], negative inside."""

    @abc.abstractmethod
    def outside(self, place: Place, reach: Fraction) -> AnyClaim:
        """Return the claim that a ball with the radius `reach` [m], whose centre is `place`, does not enter.

        A touching ball does not enter. A negative reach is that of a point that may enter by −reach. Except for an
        ellipsoid with a positive reach, the claim is refuted only if it is false.
        """

    @abc.abstractmethod
    def occupancy(self, centre: Any, reach: float) -> Any:
        """Return a function that is at most 1 if a ball with the radius `reach` [m] does not enter, for searches.

        The components of the centre are arrays or jets. The obstacle does not move.
        """

    @property
    def occupied_length(self) -> bool:
        """Whether `occupancy` minus 1 is a length [m]; otherwise it is a squared length relative to the size."""
        return False

    @property
    def rounding(self) -> float:
        """The smallest reach [m] with which a search rounds the corners of the obstacle; 0 without corners."""
        return 0.0

    def checked(self) -> AbstractObstacle:
        """Return this obstacle in NumPy, made again: numbers that were traced when it was made are checked now.

        **Raises:** ValueError as when it is made.
        """
        return type(self)(*(np.asarray(getattr(self, field.name), float) for field in dataclasses.fields(self)))

    @property
    def track(self) -> Float[Array, "terms 3"] | None:
        """The coefficients of the point that moves with the obstacle; None for an obstacle that has none."""
        return None

    @property
    def moves(self) -> bool:
        """Whether the obstacle moves."""
        return self.track is not None and self.track.shape[0] > 1

    def at_rest(self) -> AbstractObstacle:
        """Return an obstacle that does not move: this one, or one that moves as seen from its moving point."""
        return self

    def at_least(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        """Return a lower bound on the distances [m] from an obstacle that does not move, up to rounding errors."""
        return np.asarray(self.distance(points, np.zeros(points.shape[:-1])))

    @property
    def size(self) -> float:
        """The sum of the magnitudes of all numbers [m] that a distance is computed from."""
        return float(sum(np.abs(np.asarray(x)).sum() for x in jax.tree.leaves(self)))

    @property
    def approximate(self) -> bool:
        """Whether `outside` is stricter than necessary on long parts of a path, and is not refuted by its failure."""
        return False

    def enters(self, place: Place, reach: Fraction) -> bool:
        """Return whether a ball with a constant `place` is proved to enter the obstacle."""
        return subdivision.decide(self.outside(place, reach)).refuted


def moving_point(given: ArrayInput, name: str) -> Float[Array, "terms 3"]:
    """Return a point (3,) [m], or the coefficients (terms, 3) of a polynomial of the time, as coefficients.

    **Raises:** ValueError for another shape, and for numbers that are not finite.
    """
    try:
        found = as_float(given)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must be three numbers [m], but {given!r} was given") from error
    if found.shape[-1:] != (3,) or found.ndim not in (1, 2) or 0 in found.shape:
        raise ValueError(
            f"{name} must have shape (3,), or (terms, 3) for ascending coefficients of a polynomial of the time, but "
            f"its shape is {found.shape}"
        )
    require_finite(found, name)
    return found.reshape(-1, 3)


def point_at(coefficients: Float[Any, "terms 3"], times: Any) -> Any:
    """Return the positions (..., 3) of a moving point at times (...) [s]."""
    t = xp.asarray(times)[..., None]
    shape = (*t.shape[:-1], 3)
    found = xp.broadcast_to(coefficients[-1], shape)
    for k in range(coefficients.shape[0] - 2, -1, -1):
        found = xp.broadcast_to(coefficients[k], shape) + t * found
    return found


def exact_point(coefficients: Float[Array, "terms 3"], place: Place) -> list[ExactPolynomial]:
    """Return the positions of a moving point as polynomials in the variable of `place`."""
    columns = np.asarray(coefficients, float).T
    if coefficients.shape[0] == 1:
        return [ExactPolynomial.of(x[0]) for x in columns]
    return [ExactPolynomial.from_floats(x).composed(place.time) for x in columns]


def shown_point(coefficients: Float[Array, "terms 3"]) -> str:
    """Return the text of a point, or of a moving one."""
    known = concrete(coefficients)
    if known is None:
        return repr(coefficients)
    numbers = [[float(f"{x:.6g}") for x in row] for row in known]
    return repr(numbers[0] if len(numbers) == 1 else numbers)
