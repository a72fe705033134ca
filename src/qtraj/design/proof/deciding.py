"""Decide claims about many paths: all at once in bounded floats, and what remains open in exact integers."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from qtraj.algebra import bounded, subdivision
from qtraj.algebra.surd import Claim

FEWEST_FOR_FLOATS = 3
"""Fewer claims are decided at once in integers, because the overhead of NumPy is larger."""


class Decided(NamedTuple):
    """Which claims are proved and refuted, and the fractions of the durations `at` which they are refuted."""

    proved: Bool[np.ndarray, " n"]
    refuted: Bool[np.ndarray, " n"]
    at: Float[np.ndarray, " n"]


def decided(
    wanted: Bool[np.ndarray, " n"],
    in_floats: Callable[[], Claim | None],
    in_integers: Callable[[int], Claim],
    strict: bool = False,
    max_work: int = subdivision.MAX_WORK,
) -> Decided:
    """Decide the `wanted` claims: whether each is nonnegative on [0, 1], or positive if `strict`.

    `in_floats` returns the claims about all paths, or None; `in_integers` returns the claim about one path. A claim
    with an infinite or NaN coefficient is not decided.
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
        try:
            decision = subdivision.decide(in_integers(int(k)), strict, max_work)
        except (OverflowError, ValueError):  # a coefficient is infinite or NaN
            continue
        result.proved[k], result.refuted[k], result.at[k] = decision.proved, decision.refuted, decision.at
    return result
