"""Find the multiple of the identity, or of a part of it, that makes the matrix of a Newton step positive definite."""

import numpy as np

from qtraj.design.solve.program import Linear, Shift

SHIFT, MOST_SHIFT = 1e-6, 1e10
"""The first and the largest multiple of the identity that is added to the second derivatives."""

CLOSE = 1e-3
"""If the barrier parameter is below this number, only parts of the identity are added. Far from the solution, a shift
of all groups also limits the steps, which makes the searches shorter."""

LOCAL, REACH = 40, 2
"""Groups are shifted one by one, at most as many as the first number. The factorisation fails at the last group of an
indefinite part of unknown length. Therefore groups on both sides are shifted with it: first the second number, then
twice as many each time that the factorisation fails there again."""


def positive_shift(linear: Linear, previous: Shift, mu: float) -> Shift:
    """Return a shift with which the matrix is positive definite, or `MOST_SHIFT` or more if there is none.

    First the shift of all groups is increased from a third of the largest `previous` one. If the barrier parameter `mu`
    is small, it is then applied only to the groups where the factorisation fails: with a shift, steps converge slowly,
    so the other groups should have none.
    """
    level = max(SHIFT, float(np.max(previous)) / 3)
    while level < MOST_SHIFT and linear.solver(level) is None:
        level *= 8.0
    return _of_parts(linear, level) if mu < CLOSE and level < MOST_SHIFT else level


def _of_parts(linear: Linear, level: float) -> Shift:
    """Return the shift `level` for the groups where the matrix is indefinite; for all groups, if they are many."""
    shift, reach, last = np.zeros(len(linear.gradient)), REACH, None
    for _ in range(LOCAL):
        group = linear.indefinite_group(shift)
        if group is None:
            return shift
        reach = 2 * reach if group == last else REACH
        if 2 * reach >= len(shift):
            break
        shift[np.arange(group - reach, group + reach + 1) % len(shift)] = level
        last = group
    return level
