"""Tune within tightened limits, so that the limits are satisfied with a stated probability."""

from __future__ import annotations  # so that `help` shows short names

from typing import Any, overload

import numpy as np

from qtraj.design.limits import Limits, require_limits
from qtraj.design.robust.box import Box
from qtraj.design.robust.box_outcome import BoxTuned
from qtraj.design.robust.box_problem import BoxProblem
from qtraj.design.robust.box_requirements import require_box, require_box_limits, require_states
from qtraj.design.robust.driven import driven
from qtraj.design.robust.outcome import RobustTuned
from qtraj.design.robust.spread import Spread
from qtraj.design.robust.to_share import require_share, tuned_to_share
from qtraj.design.robust.tune_in_box import tune_in_box
from qtraj.design.tuning.outcome import Tuned
from qtraj.design.tuning.tune import tune
from qtraj.foundation.argument import require_type
from qtraj.foundation.devices import of_one_device
from qtraj.foundation.signature import require_options
from qtraj.path.boundary import BoundaryState


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
@of_one_device
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
    require_options(robust_tune, options, tune)
    if isinstance(spread, Box):
        _require_one(start, end)
        if (share, samples, seed) != (0.99, 8192, 0):
            raise ValueError("share, samples and seed are only for a Spread: with a Box, all deviations count")
        return _tuned_in_box(start, end, limits, spread, options)
    _require_one(start, end)
    require_share("robust_tune", limits, spread, share, samples, seed)
    return tuned_to_share(
        lambda tight: tune(start, end, tight, **options),
        lambda tuned: driven(tuned, limits),
        limits,
        spread,
        share,
        samples,
        seed,
    )


def _tuned_in_box(
    start: BoundaryState, end: BoundaryState, limits: Limits, box: Box, options: dict[str, Any]
) -> BoxTuned:
    require_limits(limits)
    require_box_limits(limits, box, "robust_tune")
    require_states(box, of_route=False)

    def around(tuned: Tuned) -> BoxProblem:
        require_box(tuned.path, limits, box)
        return BoxProblem.of(tuned.path, limits, box)

    return tune_in_box(lambda tight: tune(start, end, tight, **options), around, limits, box)


def _require_one(start: BoundaryState, end: BoundaryState) -> None:
    for state, name in ((start, "start"), (end, "end")):
        require_type(state, BoundaryState, name, "a BoundaryState")
        if np.ndim(state.position) != 1:
            raise ValueError(
                f"robust_tune tunes one problem, but the states have the batch shape {np.shape(state.position)[:-1]}"
            )
