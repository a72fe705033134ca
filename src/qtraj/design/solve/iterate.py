"""The iterates, states, rules and steps of the interior-point method."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from qtraj.design.solve.program import PerConstraint, Shift, Variables


class Iterate(NamedTuple):
    """The variables, slacks and multipliers, and the `margins`, the tightened bounds on the values.

    `excess` contains the violations e of elastic constraints, and is None if no constraint is elastic.
    """

    z: Variables
    slacks: PerConstraint
    multipliers: PerConstraint
    margins: PerConstraint
    excess: PerConstraint | None = None


@dataclass(frozen=True)
class Search:
    """The state of a search; it is `done` if the tolerance is reached, and `stuck` if no step makes progress.

    `hopeless`: the constraints seem to contradict each other. `indefinite`: a matrix was not positive definite while
    constraints were violated by much, which is where convex matrices make a difference (see `Rules`).
    """

    at: Iterate
    mu: float
    shift: Shift = 0.0
    penalty: float = 1.0
    error: float = np.inf
    steps: int = 0
    renewals: int = 0
    done: bool = False
    stuck: bool = False
    hopeless: bool = False
    indefinite: bool = False


@dataclass(frozen=True)
class Rules:
    """The rules of one search.

    The barrier parameter decreases to `least`. New margins are multiplied by `factor` < 1. With `inside`, once an
    iterate satisfies the constraints with full margins, all later iterates satisfy them, too, unless they are elastic.
    With `convex`, the second derivatives of the constraints are omitted where the matrix is not positive definite and a
    constraint is violated by much.
    """

    factor: PerConstraint
    least: float
    inside: bool = False
    convex: bool = False


class Step(NamedTuple):
    """A Newton step.

    `slope` is the derivative of the barrier function along the step, and `curvature` is zᵀHz, where H is the matrix of
    the linear system.
    """

    z: Variables
    slacks: PerConstraint
    multipliers: PerConstraint
    slope: float
    curvature: float
    excess: PerConstraint | None = None
