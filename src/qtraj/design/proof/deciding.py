"""Decide claims about many paths: all at once in bounded floats, and what remains open in exact integers."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from qtraj.algebra import bounded, subdivision
from qtraj.algebra.combined_claims import AnyClaim

FEWEST_FOR_FLOATS = 3
"""Fewer claims are decided at once in integers, because the overhead of NumPy is larger."""


IMPATIENT = 64
"""Divisor of the largest work after many claims stayed undecided."""

LITTLE_WORK = subdivision.MAX_WORK // IMPATIENT
"""Largest work for claims that smaller parts of a path make easier."""


class Decided(NamedTuple):
    """Which claims are proved and refuted, and the fractions of the durations `at` which they are refuted."""

    proved: Bool[np.ndarray, " n"]
    refuted: Bool[np.ndarray, " n"]
    at: Float[np.ndarray, " n"]


def decided(
    wanted: Bool[np.ndarray, " n"],
    in_floats: Callable[[], AnyClaim | None],
    in_integers: Callable[[int], AnyClaim],
    strict: bool = False,
    max_work: int = subdivision.MAX_WORK,
    patience: int | None = None,
) -> Decided:
    """Decide the `wanted` claims: whether each is nonnegative on [0, 1], or positive if `strict`.

    `in_floats` returns the claims about all paths, or None; `in_integers` returns the claim about one path. A claim
    with an infinite or NaN coefficient is not decided. After `patience` claims that stay undecided, the others may take
    only 1/`IMPATIENT` of `max_work`.
    """
    result = Decided(np.zeros(wanted.shape, bool), np.zeros(wanted.shape, bool), np.zeros(wanted.shape))
    if np.count_nonzero(wanted) >= FEWEST_FOR_FLOATS:
        with np.errstate(all="ignore"):
            claim = in_floats()
            if claim is not None:
                found = bounded.decide(claim, len(wanted), strict)
                result.proved[:], result.refuted[:] = found.proved & wanted, found.refuted & wanted
                result.at[:] = found.at
    for k in np.flatnonzero(wanted & ~(result.proved | result.refuted)):
        work = max_work if patience is None or patience > 0 else max_work // IMPATIENT
        try:
            decision = subdivision.decide(in_integers(int(k)), strict, work)
        except (OverflowError, ValueError):  # a coefficient is infinite or NaN
            continue
        result.proved[k], result.refuted[k], result.at[k] = decision.proved, decision.refuted, decision.at
        if patience is not None and not (decision.proved or decision.refuted):
            patience -= 1
    return result
