"""What one search is about."""

import equinox as eqx

from qtraj.design.limits import Limits
from qtraj.design.tuning.problem import Problem, Variables
from qtraj.foundation.types import Scalar


class Task(eqx.Module):
    """A problem, limits, the box of its variables, and the weight of its cost (0: least excess over the limits)."""

    problem: Problem
    limits: Limits
    low: Variables
    high: Variables
    weight: Scalar
