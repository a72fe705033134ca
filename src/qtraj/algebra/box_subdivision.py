"""Decide claims for all times and all parameters in a box, by Bernstein coefficients and subdivision.

The method is that of `subdivision`, in several variables. A cell that is not decided is divided in half, in the
variable that brings the coefficients closest to one sign. Floats decide most cells; the others are decided in integers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from qtraj.algebra.combined_claims import AnyClaim
from qtraj.algebra.signs import Signs
from qtraj.algebra.tensor_forms import Form

MAX_DEPTH = 80
"""Number of halvings after which a cell is undecided."""

FLOAT_WORK, INTEGER_WORK = (500_000_000, 100_000), (20_000_000, 5_000)
"""Number of additions after which a pass stops, and those that take as long as one cell's overhead.

A pass that decides nothing takes a second or two on most forms.
"""

USEFUL = 1e-2
"""Largest error of a form, relative to its coefficients, with which floats are tried."""

Cell = tuple[tuple[int, int], ...]
"""For each variable k, n of the interval [k, k + 1]/2ⁿ."""

PROVED = -1
"""The entry of a cell that is proved; other entries are the variables in which cells are divided."""


class BoxDecision(NamedTuple):
    """Whether a claim is `proved`, whether it is `refuted`, and a point `at`, whose first component is the time.

    At this point the claim was refuted or, if it is undecided, near it.
    """

    proved: bool
    refuted: bool
    at: tuple[float, ...] = ()


def decide(
    claim: AnyClaim,
    in_floats: Sequence[Form],
    in_integers: Callable[[], Sequence[Form] | None],
    strict: bool = False,
) -> BoxDecision:
    """Decide whether a claim is nonnegative in the whole box, or positive if `strict`.

    The forms are those of the claim's polynomials; `in_integers` returns None if they would take too long.
    """
    known: dict[Cell, int] = {}
    found = BoxDecision(False, False, (0.5,) * in_floats[0].numbers.ndim)
    if all(f.error <= USEFUL * np.abs(f.numbers).max() for f in in_floats):
        found = _subdivided(claim, in_floats, strict, known, FLOAT_WORK)
    if found.proved or found.refuted:
        return found
    forms = in_integers()
    if forms is None:
        return found
    # For high degrees, the errors of the floats are large: integers that are rounded once have much smaller ones.
    found = _subdivided(claim, [f.rounded() for f in forms], strict, known, FLOAT_WORK)
    return found if found.proved or found.refuted else _subdivided(claim, forms, strict, known, INTEGER_WORK)


def _subdivided(
    claim: AnyClaim, forms: Sequence[Form], strict: bool, known: dict[Cell, int], effort: tuple[int, int]
) -> BoxDecision:
    """Decide a claim; `known` contains the results of earlier passes, and gets those of this one."""
    variables, (max_work, overhead) = forms[0].numbers.ndim, effort
    stack: list[tuple[Cell, Sequence[Form]]] = [(((0, 0),) * variables, forms)]
    work, undecided = 0, None
    while stack:
        cell, forms = stack.pop()
        axis = known.get(cell)
        if axis == PROVED:
            continue
        inside = claim.sign([_on_cell(f) for f in forms])
        if inside.gt if strict else inside.ge:
            known[cell] = PROVED
            continue
        corner = _violated(claim, forms, strict)
        if corner is not None:
            return BoxDecision(False, True, _point(cell, corner))
        if sum(n for _, n in cell) >= MAX_DEPTH or work > max_work:
            undecided = _point(cell, (0.5,) * variables) if undecided is None else undecided
            if work > max_work:
                break
            continue
        if axis is None:
            axis = _best_axis(forms)
            known[cell] = axis
            work += variables * sum(f.numbers.size * max(f.numbers.shape) for f in forms)
        halves = [f.halved(axis) for f in forms]
        work += overhead + sum(f.numbers.size * f.numbers.shape[axis] for f in forms)
        for side in (1, 0):
            k, n = cell[axis]
            half = (*cell[:axis], (2 * k + side, n + 1), *cell[axis + 1 :])
            stack.append((half, [pair[side] for pair in halves]))
    return BoxDecision(True, False) if undecided is None else BoxDecision(False, False, undecided)


def _on_cell(form: Form) -> Signs:
    """Return what the Bernstein coefficients prove about the sign in their cell."""
    low, high, e = form.numbers.min(), form.numbers.max(), form.error
    ge, le = low >= e, high <= -e
    corners = form.corners() if ge or le else None
    return Signs(ge, le, ge and corners.min() > e, le and corners.max() < -e)  # pyright: ignore[reportOptionalMemberAccess]


def _violated(claim: AnyClaim, forms: Sequence[Form], strict: bool) -> tuple[int, ...] | None:
    """Return a corner at which the claim is violated, as zeros and ones."""
    signs = []
    for numbers, e in ((f.corners(), f.error) for f in forms):
        ge, le = numbers >= e, numbers <= -e
        signs.append(Signs(*(np.asarray(x, bool) for x in (ge, le, numbers > e, numbers < -e))))
    value = claim.sign(signs)
    found = np.argwhere(value.le if strict else value.lt)
    return tuple(int(x) for x in found[0]) if len(found) else None


def _best_axis(forms: Sequence[Form]) -> int:
    """Return the variable whose halving brings the coefficients of the forms closest to one sign."""
    unsettled = [f for f in forms if f.numbers.min() < f.error and f.numbers.max() > -f.error] or forms
    best, best_score = 0, None
    for axis in range(unsettled[0].numbers.ndim):
        if all(f.numbers.shape[axis] == 1 for f in unsettled):
            continue
        score = sum(_definiteness(half.numbers) / _size(f.numbers) for f in unsettled for half in f.halved(axis))
        if best_score is None or score > best_score:
            best, best_score = axis, score
    return best


def _definiteness(b: np.ndarray) -> float:
    """Return a number that is positive if all coefficients have the same sign, and otherwise negative."""
    return float(max(b.min(), -b.max()))


def _size(b: np.ndarray) -> float:
    return float(np.abs(b).max()) or 1.0


def _point(cell: Cell, within: Sequence[float]) -> tuple[float, ...]:
    return tuple(float(np.ldexp(k + x, -n)) for (k, n), x in zip(cell, within, strict=True))
