"""What is judged about paths: limits, the parts of the paths, and the findings."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from qtraj.algebra import bernstein
from qtraj.design.ellipse import OfSpeed
from qtraj.path.path_quantity import PathQuantity


class Limit(NamedTuple):
    """A limit on one quantity: its value and the factor of the quantity (see `PathQuantity.factor`) for each path.

    A limit that changes in the window is the polynomial with the Bernstein coefficients `curve`, of which the strictest
    one is in `bounds`.
    """

    entry: PathQuantity
    bounds: Float[np.ndarray, " n"]
    factors: Float[np.ndarray, " n"]
    curve: Float[np.ndarray, "n terms"] | None = None
    by_speed: OfSpeed | None = None

    def at(self, u: np.ndarray) -> np.ndarray:
        """Return the values at the fractions `u` of the window."""
        return self.bounds if self.curve is None else bernstein.values(self.curve, u)


class Window(NamedTuple):
    """The part of each path that is judged, from `start` to `end` as fractions of the duration."""

    start: Float[np.ndarray, " n"]
    end: Float[np.ndarray, " n"]

    def at(self, u: np.ndarray) -> np.ndarray:
        """Return the fractions of the duration at the fractions `u` of the parts."""
        return self.start + (self.end - self.start) * u


class Findings(NamedTuple):
    """Status codes, times [s] and values for each path and limit."""

    codes: Int[np.ndarray, "n limits"]
    times: Float[np.ndarray, "n limits"]
    values: Float[np.ndarray, "n limits"]
