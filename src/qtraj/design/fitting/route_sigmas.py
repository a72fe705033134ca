"""Check the standard deviations of recorded positions and velocities, and convert them to weights."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.foundation.arrays import concrete
from qtraj.foundation.types import ArrayInput


class Sigmas(NamedTuple):
    """Relative weights (n,) or (n, 3) with mean 1, and `unit`, the standard deviation of an error of weight 1.

    The weights are inversely proportional to the variances. If no standard deviations were given, all weights are 1 and
    `unit` is None.
    """

    weights: Float[np.ndarray, "n *axes"]
    unit: float | None

    def of(self, samples: np.ndarray) -> Float[np.ndarray, "n *axes"]:
        """Return the weights multiplied by factors (n,), one for each sample."""
        return self.weights * _column(samples, self.weights)

    def squares(self, errors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Return the weighted sums of squares of errors (n, 3)."""
        weighted = errors if self.unit is None else _column(self.weights, errors) * errors
        return np.einsum("nk,nk->n", weighted, errors)

    def scaled(self, errors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Return errors (n, 3) multiplied by the square roots of the weights."""
        return errors if self.unit is None else np.sqrt(_column(self.weights, errors)) * errors

    def per(self, unit: float) -> "Sigmas":
        """Return the weights of errors that are measured in another unit."""
        return self if self.unit is None else self._replace(unit=self.unit / unit)

    def part(self, samples: np.ndarray | slice) -> "Sigmas":
        """Return the weights of the samples in the mask or slice `samples`; their mean may differ from 1."""
        return self._replace(weights=self.weights[samples])


def _column(values: np.ndarray, like: np.ndarray) -> np.ndarray:
    return values[:, None] if values.ndim < like.ndim else values


def read_sigmas(sigma: ArrayInput | None, name: str, count: int) -> Sigmas:
    """Check the standard deviations `sigma` of `count` samples: a number, (count,), (count, 3) or None.

    **Raises:** ValueError for the wrong shape, for values that are not positive and finite, and for traced values.
    """
    if sigma is None:
        return Sigmas(np.ones(count), None)
    stored = concrete(sigma)
    if stored is None:
        raise ValueError(f"{name} must have concrete values, but they are traced inside jit, grad or vmap")
    values = np.asarray(stored, np.float64)
    if values.shape not in {(), (count,), (count, 3)}:
        raise ValueError(
            f"{name} must be a number, or an array of shape ({count},), one for each sample, or ({count}, 3), one for "
            f"each component, but an array of shape {values.shape} was given"
        )
    wrong = np.argwhere(~(np.isfinite(values) & (values > 0)))
    if len(wrong):
        at = tuple(map(int, wrong[0]))
        where = f"{name}[{', '.join(map(str, at))}]" if at else name
        raise ValueError(f"{name} must be positive and finite, but {where} is {values[at]:g}")
    values = values if values.ndim else np.full(count, values)
    smallest = values.min()
    precisions = (smallest / values) ** 2
    mean = float(precisions.mean())
    return Sigmas(precisions / mean, float(smallest / np.sqrt(mean)))
