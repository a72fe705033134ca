"""The paths between uncertain boundary states, and the largest values of limited quantities along them."""

from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from qtraj.design.limits import Limits
from qtraj.design.proof.certify import certify
from qtraj.design.robust.spread import Spread
from qtraj.design.robust.vehicles import with_vehicles
from qtraj.design.tuning.outcome import Tuned
from qtraj.path.boundary import BoundaryState
from qtraj.path.placement import Placement
from qtraj.path.quantity import quantity
from qtraj.path.spiral_helix import SpiralHelix

STATES = 12
"""Number of components of the states that deviate: position and velocity at both ends."""

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

    def largest(
        self, deviations: Float[np.ndarray, "n 12"], vehicle: Float[np.ndarray, "n 2"] | None = None
    ) -> Float[np.ndarray, "n k"]:
        """Return the largest values along the paths, the smallest for lower bounds, of the limited quantities.

        `deviations` of the states [m, m/s] and, unless None, of the `vehicle` (see `deviating`); NaN where a quantity
        is undefined somewhere on the path.
        """
        values = []
        for first in range(0, len(deviations), BLOCK):
            block = self.states + deviations[first : first + BLOCK]
            padded = np.concatenate([block, np.repeat(block[-1:], BLOCK - len(block), axis=0)])
            paths = _hermite(padded, self.duration, self.placement, self.turns)
            own = self.limits
            if vehicle is not None:
                own = with_vehicles(self.limits, vehicle[first : first + BLOCK])
            found = certify(_first(paths, len(block)), own)
            values.append(np.asarray(found.values))
        return np.concatenate(values)


def _first(paths: SpiralHelix, count: int) -> SpiralHelix:
    return jax.tree.map(lambda x: np.asarray(x)[:count], paths)


def driven(tuned: Tuned, limits: Limits) -> Driven:
    """Return the paths near a tuned path."""
    parts = (tuned.start.position, tuned.start.velocity, tuned.end.position, tuned.end.velocity)
    duration, turn = float(tuned.path.duration), _turn(tuned.path)
    turns = round((turn - np.arctan2(np.sin(turn), np.cos(turn))) / (2 * np.pi))
    return Driven(np.concatenate([np.asarray(x) for x in parts]), duration, turns, tuned.path.placement, limits)


def _turn(path: SpiralHelix) -> float:
    angle = np.polynomial.polynomial.Polynomial(np.asarray(path.angle))
    return float(angle(float(path.duration)) - angle(0.0))


@partial(jax.jit, static_argnums=3)
def _hermite(states: Any, duration: Any, placement: Any, turns: int) -> Any:
    def path(x: Any) -> SpiralHelix:
        start, end = BoundaryState(x[:3], x[3:6]), BoundaryState(x[6:9], x[9:])
        return SpiralHelix.hermite(start, end, duration, turns, placement)

    return jax.vmap(path)(states)


class Samples(NamedTuple):
    """Standard normal numbers: n deviations of the states, of k limits and, unless None, of the vehicle."""

    states: Float[np.ndarray, "n 12"]
    limits: Float[np.ndarray, "n k"]
    vehicle: Float[np.ndarray, "n 2"] | None = None


def samples_of(count: int, limits: int, seed: int, vehicle: bool = False) -> Samples:
    """Return scrambled Sobol points (a power of two of them), transformed to normal numbers."""
    from scipy.special import ndtri  # imported here, because scipy.stats is slow
    from scipy.stats import qmc

    last = STATES + limits
    points = qmc.Sobol(last + 2 * vehicle, rng=np.random.default_rng(seed)).random(count)
    normal = ndtri(np.clip(points, 1e-12, 1 - 1e-12))
    return Samples(normal[:, :STATES], normal[:, STATES:last], normal[:, last:] if vehicle else None)


def bounds_of(limits: Limits, spread: Spread | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the limits, their sides (1, or -1 for lower bounds) and their standard deviations."""
    given, known = limits.given(), {} if spread is None else spread.limits
    bounds = np.array([float(np.asarray(x)) for x in given.values()])
    sides = np.array([float(quantity(name).side) for name in given])
    sigmas = [known.get(name, known.get(quantity(name).base or name, 0.0)) for name in given]
    return bounds, sides, np.array(sigmas)
