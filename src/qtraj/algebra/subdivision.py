"""Decide exactly whether a function is nonnegative, or positive, on [0, 1], by Bernstein coefficients and subdivision.

A polynomial lies between its smallest and its largest Bernstein coefficient, and its first and last coefficients are
its values at the ends. An interval that these facts do not decide is divided in half (de Casteljau). With integer
coefficients there are no rounding errors, so only a contact, where the function touches zero, can remain undecided.
"""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

from qtraj.algebra.exact import ExactPolynomial
from qtraj.algebra.signs import Signs
from qtraj.algebra.surd import Claim

MAX_DEPTH = 60
"""Number of halvings after which an interval is undecided; it then has the width 2^−60."""

MAX_WORK = 4_000_000
"""Total number of additions after which a claim is undecided; they take about a second."""


class Decision(NamedTuple):
    """Whether a claim is `proved`, whether it is `refuted`, and a point `at` in [0, 1].

    At this point the claim was refuted or, if it is undecided, the interval was too narrow to be divided further.
    """

    proved: bool
    refuted: bool
    at: float = 0.0


def decide(claim: Claim, strict: bool = False, max_work: int = MAX_WORK) -> Decision:
    """Decide whether a claim with `ExactPolynomial`s is nonnegative on [0, 1], or positive if `strict`.

    The claim is undecided after `max_work` additions. It is refuted if it is violated at an end of one of the intervals.
    """
    stack = [([_bernstein(p) for p in claim.polynomials], 0, 0)]
    work, undecided = 0, None
    while stack:
        forms, depth, place = stack.pop()
        inside = claim.sign([_on_interval(b) for b in forms])
        if inside.gt if strict else inside.ge:
            continue
        for end in (0, -1):
            value = claim.sign([_of_number(b[end]) for b in forms])
            if value.le if strict else value.lt:
                return Decision(False, True, math.ldexp(place - end, -depth))
        work += sum(len(b) ** 2 for b in forms)
        if depth >= MAX_DEPTH or work > max_work:
            undecided = math.ldexp(place, -depth) if undecided is None else undecided
            if work > max_work:
                break
            continue
        halves = [_halved(b) for b in forms]
        stack.append(([right for _, right in halves], depth + 1, 2 * place + 1))
        stack.append(([left for left, _ in halves], depth + 1, 2 * place))
    return Decision(True, False) if undecided is None else Decision(False, False, undecided)


def _on_interval(b: list[int]) -> Signs:
    """Return what the Bernstein coefficients prove about the sign of a polynomial on its interval."""
    low, high = min(b), max(b)
    if low < 0 < high:
        return Signs(False, False, False, False)
    ge, le = low >= 0, high <= 0
    ends = b[0] != 0 and b[-1] != 0
    return Signs(ge, le, ge and ends, le and ends)


def _of_number(x: int) -> Signs:
    return Signs(x >= 0, x <= 0, x > 0, x < 0)


def _bernstein(p: ExactPolynomial | Any) -> list[int]:
    """Return the Bernstein coefficients on [0, 1] of a positive multiple of a polynomial, as integers."""
    numbers = p.integers() if isinstance(p, ExactPolynomial) else [int(p)]
    b = [x * weight for x, weight in zip(numbers, _weights(len(numbers) - 1), strict=True)]
    for k in range(len(b) - 1):  # coefficient i is Σ_k C(i, k)·b_k: a table of sums, from the last entry backwards
        for i in range(len(b) - 1, k, -1):
            b[i] += b[i - 1]
    return b


@lru_cache
def _weights(degree: int) -> list[int]:
    """Return the least common multiple of the binomial coefficients C(degree, k), divided by each of them."""
    binomials = [math.comb(degree, k) for k in range(degree + 1)]
    multiple = math.lcm(*binomials)
    return [multiple // x for x in binomials]


def _halved(b: list[int]) -> tuple[list[int], list[int]]:
    """Return the Bernstein coefficients on both halves of the interval, all multiplied by 2^degree."""
    degree = len(b) - 1
    left, right, row = [0] * (degree + 1), [0] * (degree + 1), b
    for k in range(degree + 1):
        left[k] = row[0] << (degree - k)
        right[degree - k] = row[-1] << (degree - k)
        row = [x + y for x, y in pairwise(row)]
    return left, right
