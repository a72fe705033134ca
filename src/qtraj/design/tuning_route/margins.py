"""Compute the margins of limits at nodes, which account for larger values between the nodes."""

import numpy as np
from jaxtyping import Float

from qtraj.design.tuning_route import basis
from qtraj.design.tuning_route.constraints import values
from qtraj.design.tuning_route.problem import RouteProblem, Segments

LEAST_MARGIN = 0.5

FULL = 0.625
"""A node accounts fully for maxima within this fraction of a cell."""

FAR, CLOSE = 0.8, 0.9
"""A margin is 1 if the squared quantity is below the first fraction of the squared limit, and has its full effect if
the squared quantity is above the second fraction."""

Nodes = Float[np.ndarray, "constraints nodes n"]


def largest_near(problem: RouteProblem, s: Segments, most: float) -> tuple[Nodes, Nodes]:
    """Return the values at the nodes, and the largest values near them, for the segments `s`.

    Parabolas through the values on a finer grid give the maxima. A maximum counts in full up to a little more than half
    a cell away, and less towards the next node, so that margins are continuous functions of the variables. Jumps would
    prevent their convergence. Maxima that are too small for an effect on the margins are omitted (see `margins`).
    """
    fine = values(problem, s, fine=True)
    own = np.ascontiguousarray(fine[:, :: basis.FINER])
    middle, before, after = fine[:, 1:-1], fine[:, :-2], fine[:, 2:]
    bend, slope = before - 2 * middle + after, 0.5 * (after - before)
    at = np.nonzero((middle - bend > FAR * most) & (bend < 0) & (np.abs(slope) <= -bend))
    constraint, index, segment = at
    place = slope[at] / -bend[at]
    peak = middle[at] - 0.5 * place**2 * bend[at]
    position = (index + 1 + place) / basis.FINER
    largest = own.copy()
    for node in (np.floor(position), np.ceil(position)):
        weight = np.clip((1.0 - np.abs(position - node)) / (1.0 - FULL), 0.0, 1.0)
        where = constraint, node.astype(int), segment
        np.maximum.at(largest, where, own[where] + weight * (peak - own[where]))
    return own, largest


def margins(problem: RouteProblem, own: Nodes, largest: Nodes, most: float) -> Nodes:
    """Return margins with which the constraint at each node also bounds the maxima in the adjacent half cells.

    A margin is the ratio of the value at the node to the maximum; both are results of `largest_near`. No margin is
    needed where the values between two nodes do not exceed the larger of the two values at the nodes. `most` is the
    largest of the previous margins.
    """
    largest = _joined(largest, problem.used, problem.seam is not None)
    safe = largest > 1e-3
    ratio = np.where(safe, own / np.where(safe, largest, 1.0), 1.0)
    # The ratio matters only where the limit is nearly reached; elsewhere it would restrict the search needlessly.
    weight = np.clip((largest / most - FAR) / (CLOSE - FAR), 0.0, 1.0)
    return 1.0 - weight * (1.0 - np.maximum(ratio, LEAST_MARGIN))


def _joined(largest: Nodes, used: np.ndarray, closed: bool) -> Nodes:
    """Return the largest values near used nodes, including the values near unused neighbours of these nodes.

    The value at the end of a segment is assigned to the start of the next segment, unless the quantity may jump there.
    If a fixed joint has no used node, the value is assigned to the nearest node inside the segment. After the last
    segment of a `closed` route, the first one follows.
    """
    ends = largest[:, -1] * ~used[:, -1]
    before, after = np.roll(ends, 1, axis=1), np.roll(used[:, 0], -1, axis=1)
    if not closed:
        before[:, 0], after[:, -1] = 0.0, False
    largest[:, -2] = np.maximum(largest[:, -2], ends * ~after)
    largest[:, 1] = np.maximum(largest[:, 1], largest[:, 0] * ~used[:, 0])
    largest[:, 0] = np.maximum(largest[:, 0], before)
    return largest
