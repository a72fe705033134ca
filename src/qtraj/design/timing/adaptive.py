"""Choose the cells of a part of a path and search for its fastest timing on them.

The first cells approximate the relaxed timing. Where the timing is not smooth, cells are halved, and it is computed
again, until it is slower than the relaxed timing by less than the tolerance, or hardly changes if all cells are halved.
Until then, the limits are imposed only at the nodes: such a draft is too fast by little, and takes one search instead
of several.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool

from qtraj.design.ellipse import OfSpeed
from qtraj.design.timing.cells import (
    Cells,
    Profile,
    Shape,
    chosen,
    divided,
    finest,
    refined,
    relaxed_profile,
    with_positive,
)
from qtraj.design.timing.constraints import POWERS
from qtraj.design.timing.formula_limits import is_coupled
from qtraj.design.timing.part_search import Drafted, Posed, Searched, first_search, searched, shape_of, task_of
from qtraj.design.timing.parts import Part
from qtraj.design.timing.relaxed import Task
from qtraj.design.timing.rounds import GAPS, LEAST_ERROR, NOT_ROUGH, Rough
from qtraj.design.timing.sided import excludes_zero
from qtraj.design.varying import varies
from qtraj.path.quantity import quantity

FIRST, FIRST_UNEVEN, ACCURACY, ACCURACY_COUPLED = 2.0, 0.5, 0.8, 0.2
"""As fractions of the tolerance, the accuracies of the first cells without and with limits of `COUPLED` or limits that
change along the way, and of halved cells without and with a limit of `COUPLED`."""

ENOUGH, CHANGE, ATTEMPTS = 0.9, 0.2, 10
"""As fractions of the tolerance, the predicted distance from the relaxed timing, and the change of the duration of a
draft, at which the limits are imposed between the nodes, too; and how often cells are halved."""

AGAIN = 0.2
"""As a fraction of the tolerance, the accuracy of the first cells after a failed search."""

HALVED = 2
"""How often all cells are then halved: a search on a spline with kinks may fail on cells that are too large."""

COUPLED, FINER = {"acceleration", "yaw_acceleration", "vertical_acceleration", "jerk", "friction", "power"}, 0.2
"""Quantities with whose limits the relaxed timing is faster than the fastest one, and without which the accuracy of the
cells is multiplied by `FINER` if the duration hardly changes."""

NOTICED = 1e-4
"""Relative violation of a limit between the nodes, beyond that of all cells, with which a cell is halved."""

HOPELESS = 0.01
"""Optimality error above which a search from a timing on larger cells is repeated from another first iterate."""

COARSER = 3
"""Number of earlier drafts that are tried if the limits cannot be imposed between the nodes of the last one."""

LEAST_RATIO, LARGEST_RATIO = 0.6, 0.9
"""Bounds on the assumed ratio of the times that two successive halvings of all cells gain."""

ROUGH = Rough(draft=0.1, gap=0.01, violation=0.1, slack=0.01)
"""How rough searches are if the relaxed timing bounds the duration, so that the loss is known.

The errors are fractions of the tolerance."""

COARSE = 0.03
"""Accuracy of the first cells with a limit on the jerk, because the relaxed timing ignores it."""


class Doubled(NamedTuple):
    """The time that twice as many cells gain [s], and the estimated minimum duration [s].

    As in Richardson's extrapolation, the gains of further halvings are assumed to decrease in the ratio of the last two
    gains, but by no more than `LEAST_RATIO` each. A smooth timing gains less.
    """

    gain: float = np.inf
    least: float = -np.inf

    def next(self, time: float, halved: float, allowed: float) -> Doubled:
        """Return the estimate for a duration `time` on all cells and a duration `halved` on their halves.

        A minimum of −inf means that the gains hardly decrease and exceed `allowed`, so that smaller cells do not help.
        """
        gain = max(time - halved, 0.0)
        ratio = LEAST_RATIO if gain <= LEAST_RATIO * self.gain else min(gain / max(self.gain, 1e-300), LARGEST_RATIO)
        least = halved - gain * ratio / (1 - ratio)
        return Doubled(gain, least if ratio < LARGEST_RATIO or time - least <= allowed else -np.inf)


def on_chosen_cells(p: Posed, part: Part, ends: Any, rest: tuple[bool, bool]) -> tuple[Searched, float]:
    """Return the result of the last search, and the estimated difference to the minimum duration [s].

    Without a limit of `COUPLED`, the relaxed timing is a lower bound on the minimum. With such a limit, the minimum is
    extrapolated from the durations on all cells and on their halves. Where this is not possible, because the gains do
    not decrease or a search fails, the bound of the relaxed timing is used, which is far from the minimum.
    """
    shape = shape_of(p.path, part, [path for path, _ in p.others])
    task = task_of(p, ends, part, rest, shape)
    limited = {quantity(name).base or name for name in p.names}
    by_speed = any(isinstance(x, OfSpeed) for x in p.bounds.values())
    coupled = bool(p.others or COUPLED & limited or by_speed or excludes_zero(p.bounds) or is_coupled(p.bounds))
    even = not (coupled or varies(p.bounds))
    first = (FIRST if even else FIRST_UNEVEN) * p.tolerance
    cells, bounds = chosen(shape, task, COARSE if p.limits_jerk else first)
    exact = bounds and not coupled

    enough = max(GAPS[0], LEAST_ERROR * p.tolerance)
    rough = ROUGH.times(p.tolerance) if exact else NOT_ROUGH

    def draft_on(cells: Cells, before: Drafted | Searched | None = None) -> Drafted:
        grid = cells.grid(shape.spans, part.first)
        found = first_search(p, part, grid, ends, rest, before, rough)
        if before is None or found.error < HOPELESS:
            return found
        again = first_search(p, part, grid, ends, rest, None, rough)
        return found if found.error <= again.error else again

    cells, draft = _positive(shape, cells, draft_on, None)
    if not np.isfinite(draft.powers).all():  # a search may fail on large cells
        cells, draft = _positive(shape, chosen(shape, task, AGAIN * p.tolerance)[0], draft_on, None)
    for _ in range(HALVED):
        if np.isfinite(draft.powers).all():
            break
        cells, draft = _positive(shape, cells.halved(np.ones(cells.half.size, bool)), draft_on, None)
    if not np.isfinite(draft.powers).all():  # the limits contradict each other, and smaller cells do not help
        return draft.completed(p.limits_jerk), np.nan

    def estimated(slower: float) -> float:
        """Return the estimated difference of a completed timing to the minimum duration."""
        own = slower - finest(shape, task, cells)
        own = own if exact else min(own, slower - least)
        return own if np.isfinite(own) else np.inf

    accuracy = (ACCURACY if exact else ACCURACY_COUPLED) * p.tolerance
    time, change = draft.times().sum(), np.inf
    gained, best, excess, drafts, doubled, least = np.inf, None, np.inf, [], Doubled(), -np.inf
    for attempt in range(ATTEMPTS + 1):
        profile = relaxed_profile(shape, task, cells)
        time, change = draft.times().sum(), abs(gained)
        latest: Drafted | Searched = draft
        near = time + draft.lost.sum() - profile.least <= ENOUGH * p.tolerance * time
        last, finer = attempt == ATTEMPTS or cells.half.size >= shape.most, None
        settled = near or last or change <= CHANGE * p.tolerance * time
        if settled and not (exact or near) and cells.half.size <= shape.most // 2:
            finer = _positive(shape, cells.halved(np.ones(cells.half.size, bool)), draft_on, draft)
            allowed, halves = p.tolerance * time, finer[1].times().sum()
            doubled = doubled.next(time, halves, allowed) if finer[1].error < enough else Doubled()
            least, last = doubled.least, last or not np.isfinite(doubled.least)
        if near or last or (settled and (exact or time - least <= p.tolerance * time)):
            latest, slower = _completed(p, part, draft, (ends, rest), rough)
            own = estimated(slower)
            rank = not _converged(p, latest), own
            if best is None or rank < (not _converged(p, best), excess):
                best, excess = latest, own
            if last or own <= p.tolerance * slower or not np.isfinite(latest.powers).all():
                break
        exceeding = _exceeding(p, latest)
        if finer is None or exceeding.any():
            halved = _halved(shape, task, accuracy, cells, latest, profile)
            halved = divided(shape, cells, exceeding) if exceeding.any() else halved
            if exact and halved.half.size == cells.half.size:
                accuracy *= FINER
                continue
            if halved.half.size == cells.half.size:
                gained = 0.0  # shows whether the duration still changes if all cells are halved
                continue
            finer = _positive(shape, halved, draft_on, latest)
        if not finer[1].error < enough:
            break
        drafts.append(draft)
        cells, draft = finer
        gained = time - draft.times().sum()
        if exact and not abs(gained) > CHANGE * p.tolerance * time:
            accuracy *= FINER
    if best is None:
        best, slower = _completed(p, part, draft, (ends, rest), rough)
        excess = estimated(slower)
    for earlier in drafts[: -COARSER - 1 : -1]:
        if _converged(p, best) or not np.isfinite(best.powers).all():
            break
        coarser, slower = _completed(p, part, earlier, (ends, rest), rough)
        if _converged(p, coarser):
            best, excess = coarser, estimated(slower)
    return best._replace(enough=max(best.enough, enough)), float(np.maximum(excess, 0.0))


def _halved(
    shape: Shape, task: Task, accuracy: float, cells: Cells, latest: Drafted | Searched, profile: Profile
) -> Cells:
    """Return the cells of the next draft."""
    times = latest.times()
    if not np.isfinite(times).all():
        return with_positive(shape, cells, latest.powers, times)
    return refined(shape, task, accuracy, cells, (latest.powers, times, latest.lost, profile))


def _exceeding(p: Posed, found: Drafted | Searched) -> Bool[np.ndarray, " cells"]:
    """Return the cells between whose nodes limits are exceeded so much that the whole timing was slowed down."""
    if isinstance(found, Drafted) or _converged(p, found):
        return np.zeros(found.grid.cells, bool)
    slower = 1 - 2 * float(found.found.error)  # see `search`
    if slower <= 0:
        return np.zeros(found.grid.cells, bool)
    others = slower ** np.array([POWERS.get(name, 0.0) for name in p.rows])
    return np.asarray((np.asarray(found.found.usage) > others[:, None] * (1 + NOTICED)).any(axis=0))


def _positive(shape: Shape, cells: Cells, draft_on: Any, before: Drafted | Searched | None) -> tuple[Cells, Drafted]:
    """Return cells on which the squared speed of the draft is positive everywhere, if possible, and the draft."""
    draft = draft_on(cells, before)
    for _ in range(ATTEMPTS):
        # Smaller cells do not help a search that failed.
        if np.isfinite(draft.times()).all() or not np.isfinite(draft.powers).all() or cells.half.size > shape.most // 2:
            break
        cells = with_positive(shape, cells, draft.powers, draft.times())
        draft = draft_on(cells)
    return cells, draft


def _converged(p: Posed, found: Searched) -> bool:
    return bool(found.found.error < max(found.enough, LEAST_ERROR * p.tolerance))


def _completed(
    p: Posed, part: Part, draft: Drafted, at: tuple[Any, tuple[bool, bool]], rough: Rough
) -> tuple[Searched, float]:
    """Return the timing with the limits between the nodes, too, and its duration [s]."""
    found = draft.completed(p.limits_jerk, rough)
    if not _converged(p, found):
        again = searched(p, part, draft.grid, *at)
        found = again if again.found.error < found.found.error or np.isnan(found.found.error) else found
    return found, float(found.times().sum())
