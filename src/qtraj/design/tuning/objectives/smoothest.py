"""The objective "smoothest", which is the integral of the squared jerk at fixed duration."""

from typing import Any, ClassVar

import numpy as np

from qtraj.algebra.jets import spread, weighted_sum
from qtraj.algebra.polynomial import taylor_terms
from qtraj.design.tuning.objectives.objective import AbstractObjective
from qtraj.path.components import dot
from qtraj.path.moving_basis import in_moving_basis

JERK_NODES = 16  # Gauss–Legendre nodes, exact for |r⃛|² of cubics with a cubic angle (degree 18 ≤ 31)


class Smoothest(AbstractObjective):
    """The integral ∫|r⃛|²dt of the squared jerk as the objective [m² s⁻⁵]."""

    name: ClassVar[str] = "smoothest"
    fixes_duration: ClassVar[bool] = True

    def value(self, problem: Any, z: Any) -> Any:
        """Return the integral over the path for the variables `z`, with the time in units of the duration."""
        nodes, weights = np.polynomial.legendre.leggauss(JERK_NODES)
        u = ((nodes + 1) / 2).reshape(-1, *[1] * problem.duration.ndim)
        radius, angle, height = (taylor_terms([spread(c) for c in cubic], u, 3) for cubic in problem.cubics(z))
        jerk = in_moving_basis(radius, [0] * 4, height, angle)[3]
        return weighted_sum(dot(jerk, jerk), weights / 2) * problem.duration**-5

    def scale(self, problem: Any) -> Any:
        """Return the value for the initial path, or 1 if it is zero."""
        size = self.value(problem, problem.zero)
        return size + (size == 0)
