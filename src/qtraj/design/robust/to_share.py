"""Tighten limits until a stated share of samples satisfies all of them."""

from __future__ import annotations

import numbers
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from jaxtyping import Bool, Float

from qtraj.design.limits import Limits
from qtraj.design.obstacles.keep_out import refuse_obstacles
from qtraj.design.robust.driven import STATES, Samples, bounds_of, samples_of
from qtraj.design.robust.outcome import RobustTuned
from qtraj.design.robust.spread import Spread
from qtraj.design.robust.tightened import tightened
from qtraj.design.tuning.outcome import Tuned
from qtraj.design.tuning_route.tuned_route import TunedRoute
from qtraj.foundation.outcome import ResultCode
from qtraj.path.quantity import quantity
from qtraj.path.vehicle import Vehicle

CLOSE = 5e-4
"""Largest distance of the share from the wanted one."""

MAX_ROUNDS = 12
"""Maximum number of tunings."""

UPDATES = 3
"""Number of tunings whose paths determine the standard deviations; then only the factor changes.

Otherwise two paths with different standard deviations could alternate.
"""

MOST_DEVIATIONS = 8
"""No sample deviates by as many standard deviations."""

SMALLEST_SHARE, LARGEST_SHARE = 0.5, 0.9999
"""The range of probabilities that all limits are satisfied."""

SAMPLES = tuple(2**k for k in range(8, 21))
"""The possible numbers of samples."""

SLOPES = 0.3, 3.0
"""Smallest and largest change of the quantile of the share per change of the factor; it is about 1."""


class Deviating(Protocol):
    """The paths near a tuned one whose states deviate."""

    @property
    def limits(self) -> Limits:
        """The limits with which the paths are compared."""
        ...

    def largest(
        self, deviations: Float[np.ndarray, "n 12"], vehicle: Float[np.ndarray, "n 2"] | None = None
    ) -> Float[np.ndarray, "n k"]:
        """Return the largest values, the smallest for lower bounds, of the limited quantities."""
        ...


def satisfied(samples: Samples, paths: Deviating, spread: Spread) -> Bool[np.ndarray, " n"]:
    """Return for each sample whether all limits are satisfied on the whole path."""
    vehicle = None if samples.vehicle is None or not spread.vehicle.any() else samples.vehicle * spread.vehicle
    values = paths.largest(samples.states * spread.states, vehicle)
    bounds, sides, sigmas = bounds_of(paths.limits, spread)
    sampled = bounds + sigmas * samples.limits[:, : len(bounds)]
    return np.all(sides * (sampled - values) >= 0, axis=1)


def tuned_to_share(
    solve: Callable[[Limits], Any],
    around: Callable[[Any], Deviating],
    limits: Limits,
    spread: Spread,
    share: float,
    samples: int,
    seed: int,
) -> RobustTuned:
    """Return the result of `solve` within limits so tight that the share of samples is `share`; see `robust_tune`.

    `solve` tunes within limits, and `around` returns the paths near its result.
    """
    from scipy.special import ndtri  # imported here, so that `import qtraj` does not import SciPy

    points = samples_of(samples, len(limits.given()), seed, bool(spread.vehicle.any()))
    wanted = float(ndtri(share))
    tuned, tight, factor, rounds = solve(limits), limits, 0.0, 1
    sigmas, slope, before = np.zeros(0), 1.0, (0.0, 0.0)
    while True:
        paths = around(tuned)
        found = float(satisfied(points, paths, spread).mean())
        if not tuned.converged or abs(found - share) <= CLOSE or (factor == 0 and found > share):
            return _outcome(tuned, tight, share, found, factor, rounds, ResultCode(int(tuned.code)))
        if rounds == MAX_ROUNDS:
            return _outcome(tuned, tight, share, found, factor, rounds, ResultCode.not_converged)
        reached = float(ndtri(np.clip(found, 0.5 / samples, 1 - 0.5 / samples)))
        if rounds <= UPDATES:
            sigmas = _sigmas(paths, spread)
        elif rounds > UPDATES + 1 and factor != before[0]:  # the last two factors had the same standard deviations
            slope = float(np.clip((reached - before[1]) / (factor - before[0]), *SLOPES))
        before = factor, reached
        factor = max(0.0, factor + (wanted - reached) / slope)
        closer = tightened(limits, factor * sigmas)
        if closer is None:
            return _outcome(tuned, tight, share, found, factor, rounds, ResultCode.infeasible)
        tight, rounds = closer, rounds + 1
        tuned = solve(tight)


def _outcome(
    tuned: Tuned | TunedRoute, tight: Limits, share: float, found: float, factor: float, rounds: int, code: ResultCode
) -> RobustTuned:
    return RobustTuned(tuned, tight, share, found, factor, rounds, int(code))


def _sigmas(paths: Deviating, spread: Spread) -> Float[np.ndarray, " k"]:
    """Return the standard deviations of the distances of the largest values from their limits, to first order.

    Each component of the states and of the vehicle changes by one standard deviation in both directions; the larger
    increase counts, which is right also if two maxima of a quantity have almost the same value.
    """
    sizes = np.concatenate([spread.states, spread.vehicle])
    steps = np.diag(sizes)[sizes > 0]
    points = np.concatenate([np.zeros((1, len(sizes))), steps, -steps])
    values = paths.largest(points[:, :STATES], points[:, STATES:] if spread.vehicle.any() else None)
    _, sides, own = bounds_of(paths.limits, spread)
    changes = (sides * (values[1:] - values[0])).reshape(2, len(steps), len(sides))
    return np.sqrt(own**2 + np.sum(np.maximum(changes.max(axis=0), 0.0) ** 2, axis=0))


def require_share(call: str, limits: Limits, spread: Spread, share: float, samples: int, seed: int) -> None:
    """Raise a ValueError for arguments of `call` with which no share is possible."""
    if not isinstance(spread, Spread):
        raise ValueError(
            f"spread must be a Spread, such as Spread(start_velocity=0.1), or a Box, but {spread!r} was given"
        )
    if isinstance(share, bool) or not isinstance(share, numbers.Real) or not SMALLEST_SHARE <= share <= LARGEST_SHARE:
        text = f"a probability from {SMALLEST_SHARE} to {LARGEST_SHARE}"
        raise ValueError(f"share must be {text}, but {share!r} was given")
    if not isinstance(samples, int | np.integer) or samples not in SAMPLES:
        raise ValueError(f"samples must be a power of two from 256 to 2**20, but {samples!r} was given")
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise ValueError(f"seed must be an integer, 0 or more, but {seed!r} was given")
    refuse_obstacles(limits, call, "omit keep_out")
    limits.require_constant(call, "pass one value for the whole path")
    if spread.vehicle.any():
        _require_vehicle(limits.vehicle, spread)
    names = {each for name in limits.given() for each in (name, quantity(name).base or name)}
    if unknown := sorted(spread.limits.keys() - names):
        raise ValueError(f"spread.limits contains {unknown[0]!r}, but there is no such limit in limits")


def _require_vehicle(vehicle: Vehicle | None, spread: Spread) -> None:
    if vehicle is None:
        raise ValueError("the vehicle deviates, but limits have none: pass Limits(..., vehicle=Vehicle(mass=...))")
    if np.ndim(vehicle.mass) or vehicle.on_changing_road:
        raise ValueError("one vehicle on a road that does not change is needed: pass bank and friction as numbers")
    if not MOST_DEVIATIONS * spread.mass < float(np.asarray(vehicle.mass)):
        raise ValueError(
            f"the mass {float(np.asarray(vehicle.mass)):g} kg must be more than {MOST_DEVIATIONS} standard deviations, "
            f"so that it stays positive, but a standard deviation of {spread.mass:g} kg was given"
        )
