"""Find a change of the problem of a route with which every limit can be satisfied, and verify it by a search."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from qtraj.design.tuning_route.rounds import Found
from qtraj.path.quantity import quantity

MORE = (1.01, 1.1, 1.5, 4.0, 16.0)
"""Limits are raised by these multiples of their violations, one after the other."""

LEAST = 1e-3
"""Lower bounds of quantities that are never negative are reduced to this fraction of the given ones at most."""

BOUND_CHANGES = (
    *({name} for name in ("acceleration", "longitudinal_acceleration", "combined_acceleration", "friction", "jerk")),
    {"longitudinal_acceleration_min", "longitudinal_acceleration_max"},
)
"""Limits that bound changes of the speed on both sides."""

BISECTIONS = 3
"""Number of bisections for the smallest raised limits."""


class Change(NamedTuple):
    """A changed problem: the limits by name, whether the states at the ends are free, and the objective."""

    limits: dict[str, float]
    free_ends: bool
    objective: str


def remedy(
    limits: dict[str, float], found: Found, objective: str, ends_fixed: bool, solves: Callable[[Change], bool]
) -> str:
    """Return advice for limits that cannot be satisfied together; `solves` searches for a route of a changed problem.

    The advice is what the first successful search changed, or the reason why there is none.
    """
    least = reached(limits, found)
    ends = [False, True] if ends_fixed and _at_ends(found) else [False]
    objectives = [objective, "nearest"] if objective == "smoothest" else [objective]
    for kind, free in itertools.product(objectives, ends):
        change = Change(limits, free, kind)
        if (kind, free) != (objective, False) and solves(change):
            return _text(change, objective)
    raised = _raised(limits, least, lambda values: solves(Change(limits | values, False, objective)))
    if raised is None:
        return "Widen the tube, relax these limits further, or fix fewer states."
    texts = [f"{name} = {value:.4g} {quantity(name).label.strip('-')}".rstrip() for name, value in raised.items()]
    return f"With {' and '.join(texts)}, every limit is satisfied, as another search has proved."


def _raised(
    limits: dict[str, float], least: dict[str, float], solves: Callable[[dict[str, float]], bool]
) -> dict[str, float] | None:
    """Return limits, between the given ones and those in `least` or a little above, that can be satisfied."""

    def between(part: float) -> dict[str, float]:
        found = {name: limits[name] + part * (value - limits[name]) for name, value in least.items()}
        return {name: _wider(name, _allowed(name, value, limits[name])) for name, value in found.items()}

    if not least:
        return None
    low, high = 0.0, next((part for part in MORE if solves(between(part))), None)
    if high is None:
        return None
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if solves(between(middle)) else (middle, high)
    return between(high)


def unbounded_jumps(names: Sequence[str], objective: str) -> str:
    """Return advice for a search for the fastest route if no limit prevents jumps of the speed, or an empty text.

    Then there is no fastest route: the time decreases while the bends become shorter and sharper, and the speed jumps
    before and after them. Searches shift the bends to and fro.
    """
    if objective != "fastest" or any(sides <= {*names} for sides in BOUND_CHANGES):
        return ""
    return (
        "No limit bounds changes of the speed, so that bends become shorter and sharper without end, and there is no "
        "fastest route: also limit longitudinal_acceleration."
    )


def _text(change: Change, objective: str) -> str:
    causes, remedies = [], []
    if change.free_ends:
        causes.append("the states at the ends of the route")
        remedies.append("fixed=np.zeros(number of joints, bool)")
    if change.objective != objective:
        causes.append("the duration")
        remedies.append("objective='nearest' or 'fastest'")
    return (
        f"The cause is that {' and '.join(causes)} cannot change. If they can, every limit is satisfied, as another "
        f"search has proved: pass {' and '.join(remedies)}."
    )


def reached(limits: dict[str, float], found: Found) -> dict[str, float]:
    """Return the worst values of the limits that are violated, by name.

    The search may violate a limit between its reduced margin and its value, which counts as satisfied.
    """
    certificate, missed = found.judged.certificate, found.missed
    if missed is None:
        return {}
    names = [name for k, name in enumerate(limits) if missed[k].any()]
    worst = {name: np.asarray(certificate.segments.worst[name][1]) for name in names}
    values = {name: float(np.nanmin(x) if quantity(name).lower else np.nanmax(x)) for name, x in worst.items()}
    return {name: x for name, x in values.items() if (x < limits[name] if quantity(name).lower else x > limits[name])}


def _at_ends(found: Found) -> bool:
    missed: Any = found.missed
    return missed is not None and bool(missed[:, [0, -1]].any())


def _allowed(name: str, value: float, given: float) -> float:
    """Return the limit, or, for a lower bound of a quantity that is never negative, at least a small positive one."""
    entry = quantity(name)
    return max(value, LEAST * given) if entry.lower and not entry.bounds_side else value


def _wider(name: str, value: float) -> float:
    """Round a limit to four digits, which are printed, such that it allows more."""
    if value == 0:
        return value
    digit = 10.0 ** (np.floor(np.log10(abs(value))) - 3)
    side = quantity(name).side
    return float(side * np.ceil(side * value / digit - 1e-12 * abs(value / digit)) * digit)
