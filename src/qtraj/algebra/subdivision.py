"""Decide whether a function is nonnegative, or positive, on [0, 1], by Bernstein coefficients and subdivision.

A polynomial lies between its smallest and its largest Bernstein coefficient, and its first and last coefficients are
its values at the ends. An interval that these facts do not decide is divided in half (de Casteljau). The coefficients
are integers. They are first cut off after `PRECISION` bits, with a bound on the error, because long integers are slow;
what remains undecided is decided without cutting off, as soon as the errors hide all signs on an interval. Then only a
contact, where the function touches zero, can remain undecided.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from itertools import compress, pairwise
from typing import Any, NamedTuple

from qtraj.algebra.combined_claims import AnyClaim, reduced
from qtraj.algebra.exact import ExactPolynomial
from qtraj.algebra.signs import Signs

PRECISION = 256
"""Number of bits of the largest coefficient in the first attempt."""

MAX_DEPTH = 60
"""Number of halvings after which an interval is undecided; it then has the width 2^−60."""

MAX_WORK = 4_000_000
"""Total number of additions after which a claim is undecided; they take about a second."""


Form = tuple[list[int], int]
"""Bernstein coefficients on an interval, and a bound on their errors."""

Halving = Callable[[list[int], int], tuple[Form, Form]]


class Decision(NamedTuple):
    """Whether a claim is `proved`, whether it is `refuted`, and a point `at` in [0, 1].

    At this point the claim was refuted or, if it is undecided, the interval was too narrow to be divided further.
    """

    proved: bool
    refuted: bool
    at: float = 0.0


def decide(claim: AnyClaim, strict: bool = False, max_work: int = MAX_WORK) -> Decision:
    """Decide whether a claim with `ExactPolynomial`s is nonnegative on [0, 1], or positive if `strict`.

    The claim is undecided after `max_work` additions. It is refuted if it is violated at an end of an interval.
    """
    exact = [(_bernstein(p), 0) for p in claim.polynomials]
    decision = _subdivided(claim, [_cut(b) for b, _ in exact], _halved_with_error, strict, max_work)
    if decision.proved or decision.refuted:
        return decision
    return _subdivided(claim, exact, _halved, strict, max_work)


def _subdivided(claim: AnyClaim, forms: list[Form], halved: Halving, strict: bool, max_work: int) -> Decision:
    stack = [(claim, forms, 0, 0)]
    work, undecided = 0, None
    while stack:
        claim, forms, depth, place = stack.pop()
        signs = [_on_interval(*form) for form in forms]
        inside = claim.sign(signs)
        if inside.gt if strict else inside.ge:
            continue
        for end in (0, -1):
            value = claim.sign([_of_number(b[end], e) for b, e in forms])
            if value.le if strict else value.lt:
                return Decision(False, True, math.ldexp(place - end, -depth))
        claim, kept = reduced(claim, signs)
        forms = [*compress(forms, kept)]
        if all(e > max(max(b), -min(b)) for b, e in forms):
            return Decision(False, False, math.ldexp(place, -depth))  # so they do on all parts of the interval
        work += sum(len(b) ** 2 for b, _ in forms)
        if depth >= MAX_DEPTH or work > max_work:
            undecided = math.ldexp(place, -depth) if undecided is None else undecided
            if work > max_work:
                break
            continue
        halves = [halved(*form) for form in forms]
        stack.append((claim, [right for _, right in halves], depth + 1, 2 * place + 1))
        stack.append((claim, [left for left, _ in halves], depth + 1, 2 * place))
    return Decision(True, False) if undecided is None else Decision(False, False, undecided)


def _on_interval(b: list[int], e: int) -> Signs:
    """Return what the Bernstein coefficients, with errors of at most `e`, prove about the sign on their interval."""
    low, high = min(b), max(b)
    ge, le = low >= e, high <= -e
    return Signs(ge, le, ge and min(b[0], b[-1]) > e, le and max(b[0], b[-1]) < -e)


def _of_number(x: int, e: int) -> Signs:
    return Signs(x >= e, x <= -e, x > e, x < -e)


def _cut(b: list[int]) -> Form:
    """Return the leading bits of the coefficients, and a bound on the errors in units of the last bit.

    Small integers are scaled up, because halving rounds.
    """
    shift = max(max(b), -min(b)).bit_length() - PRECISION
    return ([x >> shift for x in b], 1) if shift > 0 else ([x << -shift for x in b], 0)


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


def _halved(b: list[int], e: int) -> tuple[Form, Form]:
    """Return the Bernstein coefficients on both halves of the interval, all multiplied by 2^degree."""
    degree = len(b) - 1
    left, right, row = [0] * (degree + 1), [0] * (degree + 1), b
    for k in range(degree + 1):
        left[k] = row[0] << (degree - k)
        right[degree - k] = row[-1] << (degree - k)
        row = [x + y for x, y in pairwise(row)]
    return (left, e << degree), (right, e << degree)


def _halved_with_error(b: list[int], e: int) -> tuple[Form, Form]:
    """Return the Bernstein coefficients on both halves of the interval, rounded to integers."""
    degree = len(b) - 1
    left, right, row = [0] * (degree + 1), [0] * (degree + 1), b
    for k in range(degree + 1):
        left[k], right[degree - k] = row[0], row[-1]
        row = [(x + y) >> 1 for x, y in pairwise(row)]
    return (left, e + degree), (right, e + degree)  # each mean is rounded by at most 1/2
