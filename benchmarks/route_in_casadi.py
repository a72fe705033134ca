"""Represent one segment of a route in the variables of `tune_route` as expressions of CasADi, for IPOPT."""

from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from qtraj.design.tuning_route import basis

MOVES = 10
"""Number of variables at each joint: the moves of position, velocity and acceleration, and the delay."""


class Segment(NamedTuple):
    """The expressions of one segment.

    `variables` are the variables at both joints, `data` the arrays of the problem and `given` their symbols.
    `duration` is the duration, which was `before` at first. `ends` are the end data of the given route, and `change` is
    their change.
    """

    variables: tuple[Any, Any]
    data: dict[str, np.ndarray]
    given: dict[str, Any]
    duration: Any
    before: Any
    ends: Any
    change: Any

    def at_nodes(self, count):
        """Yield velocity, acceleration and displacement at `count` − 1 equal steps, without the end of the segment."""
        tables = basis.at_nodes(np.linspace(0, 1, count)[:-1], 2)
        y = self.ends + self.change
        for j in range(count - 1):
            v, a = (ca.DM(tables[k, j]).T @ y / self.duration**k for k in (1, 2))
            yield v, a, ca.DM(tables[0, j]).T @ self.change

    def positions(self, count):
        """Yield the position at the same steps; the problem must contain `origins`."""
        tables = basis.at_nodes(np.linspace(0, 1, count)[:-1], 0)
        for row in tables[0]:
            yield ca.DM(row).T @ (self.ends + self.change) + self.given["origins"].T


def segment(problem, *more):
    """Return the segment; the arrays of the problem are those of the change of the route, and `more`."""
    data = {name: np.asarray(getattr(problem, name)) for name in ("ends", "durations", *more)}
    data["axes"] = np.moveaxis(np.stack([problem.axes[:-1], problem.axes[1:]]), 1, -1)
    given = {name: ca.SX.sym(name, int(np.prod(x.shape[:-1], dtype=int))) for name, x in data.items()}
    variables = ca.SX.sym("z0", MOVES), ca.SX.sym("z1", MOVES)
    moves, before = [z * np.asarray(problem.scale) for z in variables], given["durations"]
    h = before + moves[1][9] - moves[0][9]
    shifts = []
    for side in range(2):
        axes = ca.reshape(given["axes"][9 * side : 9 * side + 9], 3, 3)  # one column for each axis
        shifts += [axes @ moves[side][3 * k : 3 * k + 3] for k in range(3)]
    ends = ca.reshape(given["ends"], 3, 6).T
    change = [h**e * shifts[k].T + ((h**e / before**e) - 1) * ends[k, :] for k, e in enumerate(basis.POWERS)]
    return Segment(variables, data, given, h, before, ends, ca.vertcat(*change))
