"""The paths between uncertain boundary states, and the largest values of limited quantities along them."""

from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float
from scipy.special import ndtri
from scipy.stats import qmc

from qtraj.design.limits import Limits
from qtraj.design.proof.certify import certify
from qtraj.design.robust.spread import Spread
from qtraj.design.tuning.outcome import Tuned
from qtraj.path.boundary import BoundaryState
from qtraj.path.placement import Placement
from qtraj.path.quantity import quantity
from qtraj.path.spiral_helix import SpiralHelix

BLOCK = 1024
"""Number of paths that are checked at once."""


class Driven(NamedTuple):
    """The paths between states near those of a tuned path: in the same time, about the same axis.

    Radius, azimuth and height are cubics, as along the tuned path, which is the path without deviations.
    """

    states: Float[np.ndarray, "12"]
    duration: float
    turns: int
    placement: Placement | None
    limits: Limits

    def largest(self, deviations: Float[np.ndarray, "n 12"]) -> tuple[Float[np.ndarray, "n k"], tuple[str, ...]]:
        """Return the largest values along the paths, the smallest for lower bounds, and the names of the limits.

        `deviations` of the states [m, m/s]; NaN where a quantity is undefined somewhere on the path.
        """
        values, names = [], ()
        for first in range(0, len(deviations), BLOCK):
            block = self.states + deviations[first : first + BLOCK]
            padded = np.concatenate([block, np.repeat(block[-1:], BLOCK - len(block), axis=0)])
            paths = _paths(padded, self.duration, self.placement, self.turns)
            found = certify(jax.tree.map(lambda x, n=len(block): np.asarray(x)[:n], paths), self.limits)
            values.append(np.asarray(found.values))
            names = found.names
        return np.concatenate(values), names


def driven(tuned: Tuned, limits: Limits) -> Driven:
    """Return the paths near a tuned path."""
    parts = (tuned.start.position, tuned.start.velocity, tuned.end.position, tuned.end.velocity)
    duration, turn = float(tuned.path.duration), _turn(tuned.path)
    turns = round((turn - np.arctan2(np.sin(turn), np.cos(turn))) / (2 * np.pi))
    return Driven(np.concatenate([np.asarray(x) for x in parts]), duration, turns, tuned.path.placement, limits)


def _turn(path: SpiralHelix) -> float:
    angle = np.polynomial.polynomial.Polynomial(np.asarray(path.angle))
    return float(angle(float(path.duration)) - angle(0.0))


@jax.jit
def _hermite(states: Any, duration: Any, placement: Any) -> Any:
    def path(x: Any) -> SpiralHelix:
        start, end = BoundaryState(x[:3], x[3:6]), BoundaryState(x[6:9], x[9:])
        return SpiralHelix.hermite(start, end, duration, 0, placement)

    return jax.vmap(path)(states)


def _paths(states: np.ndarray, duration: float, placement: Placement | None, turns: int) -> SpiralHelix:
    """Return the paths between states (n, 12); whole turns are added by the cubic from 0 to 1 without end rates."""
    paths = _hermite(states, duration, placement)
    if not turns:
        return paths
    cubic = 2 * np.pi * turns * np.array([0.0, 0.0, 3.0 / duration**2, -2.0 / duration**3])
    return SpiralHelix(paths.radius, np.asarray(paths.angle) + cubic, paths.height, paths.duration, placement)


class Samples(NamedTuple):
    """Standard normal numbers: n deviations of the states, and of k limits."""

    states: Float[np.ndarray, "n 12"]
    limits: Float[np.ndarray, "n k"]

    def satisfied(self, paths: Driven, spread: Spread) -> Bool[np.ndarray, " n"]:
        """Return for each sample whether all limits are satisfied on the whole path."""
        values, names = paths.largest(self.states * spread.states)
        bounds, sides, sigmas = bounds_of(paths.limits, names, spread)
        sampled = bounds + sigmas * self.limits[:, : len(names)]
        return (sides * (sampled - values) >= 0).all(axis=1)


def samples_of(count: int, limits: int, seed: int) -> Samples:
    """Return scrambled Sobol points (a power of two of them), transformed to normal numbers."""
    points = qmc.Sobol(12 + limits, rng=np.random.default_rng(seed)).random(count)
    normal = ndtri(np.clip(points, 1e-12, 1 - 1e-12))
    return Samples(normal[:, :12], normal[:, 12:])


def bounds_of(limits: Limits, names: tuple[str, ...], spread: Spread) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the limits, their sides (1, or -1 for lower bounds) and standard deviations, in the order of `names`."""
    given = limits.given()
    bounds = np.array([float(np.asarray(given[name])) for name in names])
    sides = np.array([float(quantity(name).side) for name in names])
    sigmas = [spread.limits.get(name, spread.limits.get(quantity(name).base or name, 0.0)) for name in names]
    return bounds, sides, np.array(sigmas)
