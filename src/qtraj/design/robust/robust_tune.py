"""Tune within tightened limits, so that the limits are satisfied with a stated probability."""

from __future__ import annotations  # so that `help` shows short names

from typing import Any, overload

import numpy as np
from jaxtyping import Float

from qtraj.design.limits import Limits
from qtraj.design.obstacles.keep_out import refuse_obstacles
from qtraj.design.robust.box import Box
from qtraj.design.robust.box_outcome import BoxTuned
from qtraj.design.robust.driven import Driven, bounds_of, driven, samples_of
from qtraj.design.robust.outcome import RobustTuned
from qtraj.design.robust.spread import Spread
from qtraj.design.robust.tightened import tightened
from qtraj.design.robust.tune_in_box import tune_in_box
from qtraj.design.tuning.outcome import Tuned
from qtraj.design.tuning.tune import tune
from qtraj.foundation.argument import require_type
from qtraj.foundation.outcome import ResultCode
from qtraj.path.boundary import BoundaryState
from qtraj.path.quantity import quantity

CLOSE = 5e-4
"""Largest distance of the share from the wanted one."""

MAX_ROUNDS = 12
"""Maximum number of tunings."""

UPDATES = 3
"""Number of tunings whose paths determine the standard deviations; then only the factor changes.

Otherwise two paths with different standard deviations could alternate.
"""

SLOPES = 0.3, 3.0
"""Smallest and largest change of the quantile of the share per change of the factor; it is about 1."""


@overload
def robust_tune(start: BoundaryState, end: BoundaryState, limits: Limits, spread: Box, **options: Any) -> BoxTuned: ...
@overload
def robust_tune(
    start: BoundaryState,
    end: BoundaryState,
    limits: Limits,
    spread: Spread,
    share: float = 0.99,
    *,
    samples: int = 8192,
    seed: int = 0,
    **options: Any,
) -> RobustTuned: ...
def robust_tune(
    start: BoundaryState,
    end: BoundaryState,
    limits: Limits,
    spread: Spread | Box,
    share: float = 0.99,
    *,
    samples: int = 8192,
    seed: int = 0,
    **options: Any,
) -> RobustTuned | BoxTuned:
    """Tune so that limits are satisfied although states deviate: with the probability `share`, or always.

    With a `Box` of intervals, the limits are satisfied for all deviations in it, and `certify_box` proves this. Each
    limit is tightened by the difference of its worst value in the box from that of the path, until both agree; the
    worst values are found on a grid with the corners of the box, and at the counterexamples of
    the proof.

    With a `Spread`, the states at both ends of the tuned path deviate by independent normal errors; the vehicle then
    drives the spiral-helix between the states that it has, in the same time. Limits with a standard deviation deviate,
    too. Each limit is tightened by its margin, z standard deviations of its largest value. These standard deviations
    are of first order, from the changes of the largest value if each component of a state changes by one standard
    deviation. The factor z is the same for all limits, and such that the share of `samples` paths that satisfy all
    limits is `share` to 0.05 %: these paths are not linearised. Both are computed again for each new tuned path, until
    the share is reached; the standard deviations only for the first three.

    Args:
        start: The first state, as for `tune`; one problem, not a batch.
        end: The last state.
        limits: Limits that do not change along the way or with the speed, without obstacles.
        spread: The standard deviations, or a `Box`.
        share: The probability that all limits are satisfied, from 0.5 to 0.9999; `share`, `samples` and `seed` are only
            for a `Spread`.
        samples: Number of sampled paths, a power of two from 256 to 2²⁰; the error of the share is about
            √(share (1 − share) / samples) or less.
        seed: Seed of the samples; equal seeds give equal results.
        **options: Other arguments of `tune`, such as `motion="hermite"` or `fixed`.

    Returns:
        A `RobustTuned` with the tuned path, the tightened limits and the sampled share; for a `Box`, a `BoxTuned` with
        the proof in `certificate`.

    Raises:
        ValueError: For another `share` or number of samples, a batch, limits that change, and a limit in `spread` that
            is not limited; for a `Box` also the errors of `certify_box`.

    Example:
        >>> import qtraj as qt
        >>> start = qt.BoundaryState([20, 0, 0], [0, 6, 0])
        >>> end = qt.BoundaryState([0, 22, 1], [-6, 0, 0.2])
        >>> limits, spread = qt.Limits(lateral_acceleration=1.5), qt.Spread(start_velocity=0.1, end_velocity=0.1)
        >>> found = qt.robust_tune(start, end, limits, spread, motion="hermite")
        >>> round(float(found.sampled_share), 2)
        0.99
    """
    if isinstance(spread, Box):
        _require_one(start, end)
        if (share, samples, seed) != (0.99, 8192, 0):
            raise ValueError("share, samples and seed are only for a Spread: with a Box, all deviations count")
        return tune_in_box(start, end, limits, spread, **options)
    _require(start, end, limits, spread, share, samples)
    from scipy.special import ndtri  # imported here, so that `import qtraj` does not import SciPy

    points = samples_of(samples, len(limits.given()), seed)
    wanted = float(ndtri(share))
    tuned, tight, factor, rounds = tune(start, end, limits, **options), limits, 0.0, 1
    sigmas, slope, before = np.zeros(0), 1.0, (0.0, 0.0)
    while True:
        paths = driven(tuned, limits)
        found = float(points.satisfied(paths, spread).mean())
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
        tuned = tune(start, end, tight, **options)


def _outcome(
    tuned: Tuned, tight: Limits, share: float, found: float, factor: float, rounds: int, code: ResultCode
) -> RobustTuned:
    return RobustTuned(tuned, tight, share, found, factor, rounds, int(code))


def _sigmas(paths: Driven, spread: Spread) -> Float[np.ndarray, " k"]:
    """Return the standard deviations of the distances of the largest values from their limits, to first order.

    Each component of the states changes by one standard deviation in both directions; the larger increase counts, which
    is right also if two maxima of a quantity have almost the same value.
    """
    steps = np.diag(spread.states)[spread.states > 0]
    values = paths.largest(np.concatenate([np.zeros((1, 12)), steps, -steps]))
    _, sides, own = bounds_of(paths.limits, spread)
    changes = (sides * (values[1:] - values[0])).reshape(2, len(steps), len(sides))
    return np.sqrt(own**2 + np.sum(np.maximum(changes.max(axis=0), 0.0) ** 2, axis=0))


def _require_one(start: BoundaryState, end: BoundaryState) -> None:
    for state, name in ((start, "start"), (end, "end")):
        require_type(state, BoundaryState, name, "a BoundaryState")
        if np.ndim(state.position) != 1:
            raise ValueError(
                f"robust_tune tunes one problem, but the states have the batch shape {np.shape(state.position)[:-1]}"
            )


def _require(
    start: BoundaryState, end: BoundaryState, limits: Limits, spread: Spread, share: float, samples: int
) -> None:
    _require_one(start, end)
    if not isinstance(spread, Spread):
        raise ValueError(
            f"spread must be a Spread, such as Spread(start_velocity=0.1), or a Box, but {spread!r} was given"
        )
    if not 0.5 <= share <= 0.9999:
        raise ValueError(f"share must be a probability from 0.5 to 0.9999, but {share} was given")
    if samples not in {2**k for k in range(8, 21)}:
        raise ValueError(f"samples must be a power of two from 256 to 2**20, but {samples} was given")
    refuse_obstacles(limits, "robust_tune", "omit keep_out")
    limits.require_constant("robust_tune", "pass one value for the whole path")
    names = {each for name in limits.given() for each in (name, quantity(name).base or name)}
    if unknown := sorted(spread.limits.keys() - names):
        raise ValueError(f"spread.limits contains {unknown[0]!r}, but there is no such limit in limits")
