"""Refine the solution of a search until its derivatives are accurate, and solve the linear system of the derivatives.

The matrix is that of the interior-point method (see `sensitivity`). Everything here runs in NumPy.
"""

import numpy as np

from qtraj.design.solve.chain import Chain
from qtraj.design.solve.nonconvex import Iterate, linearised, longest, newton, residual, restarted
from qtraj.design.solve.program import Program

STEPS = 60
"""Maximum number of Newton steps with which the last search is continued."""

BARRIERS, LEAST, TOLERANCE = (1e-3, 1e-5, 1e-7), 1e-7, 1e-10
"""Initial barrier parameters, tried from the largest down until one leads to convergence; the final barrier parameter,
for which the conditions are differentiated; and the largest residual accepted there. A smaller final parameter would
noticeably increase the rounding errors of the derivatives."""

REFINEMENTS = 2
"""Number of iterative refinements of the solution; the linear system is ill-conditioned."""

DECREASE, KEEP = 0.2, 0.995
"""The factor by which the barrier parameter decreases in each step, and the largest fraction by which a step may reduce
a slack or a multiplier."""


def solution(matrix: Chain, right: np.ndarray) -> np.ndarray:
    """Return the solution of the linear system; NaN if the matrix is singular."""
    solver = matrix.solver(indefinite=True)
    if solver is None:
        return np.full(right.shape, np.nan)
    found = solver(right)
    for _ in range(REFINEMENTS):
        found = found + solver(right - matrix.product(found))
    return found


def polished(program: Program, at: Iterate) -> tuple[Iterate, Chain, bool]:
    """Refine an iterate until it satisfies the optimality conditions; also return the matrix and whether it converged.

    The slacks and multipliers start from a larger barrier parameter, because with tiny slacks the steps would be too
    short.
    """
    with np.errstate(all="ignore"):  # a failed refinement ends with NaN
        found = _polished(program, restarted(program, at, BARRIERS[0]), BARRIERS[0])
        for barrier in BARRIERS[1:]:
            if not found[2]:
                found = _polished(program, restarted(program, at, barrier), barrier)
    return found


def _polished(program: Program, at: Iterate, mu: float) -> tuple[Iterate, Chain, bool]:
    """Refine an iterate by full Newton steps, starting with the barrier parameter `mu`.

    There is no line search, because the rounding errors of a merit function would stop it this close to the optimum,
    and the matrix may be indefinite until the slacks and multipliers fit together.
    """
    linear = linearised(program, at)
    for _ in range(STEPS):
        if mu <= LEAST and residual(at, linear, mu) <= TOLERANCE:
            return at, linear.matrix, True
        step = newton(at, linear, mu, indefinite=True)
        if step is None:
            break
        primal, dual = longest(at.slacks, step.slacks, KEEP), longest(at.multipliers, step.multipliers, KEEP)
        at = Iterate(
            at.z + primal * step.z,
            at.slacks + primal * step.slacks,
            at.multipliers + dual * step.multipliers,
            at.margins,
        )
        linear, mu = linearised(program, at), max(LEAST, DECREASE * mu)
    return at, linear.matrix, False
