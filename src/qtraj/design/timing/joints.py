"""Find the knots of a retimed path at which its velocity or its acceleration jumps."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from qtraj.design.timing.constraints import UPPER
from qtraj.design.timing.formula_limits import of_third_order
from qtraj.design.timing.parts import CONTINUOUS
from qtraj.design.timing.retimed_cells import Cells, motion_at
from qtraj.design.timing.sided import SLOWEST
from qtraj.design.timing.timing import RetimedPath
from qtraj.foundation.arrays import is_traced
from qtraj.foundation.namespace import namespace
from qtraj.path.own_facts import rate_degree
from qtraj.path.quantity import quantity


def jumps(path: RetimedPath, cells: Cells, names: tuple[str, ...]) -> Bool[Any, "limits moving"]:
    """Return a mask of the cells in which the vehicle moves: true where a jump at an end affects the quantity.

    The jump makes the quantity infinite or undefined. A jump of the velocity makes all quantities infinite except those
    that depend only on the speed and the shape of the path, such as the yaw rate. A jump of the acceleration makes the
    jerk infinite. At a stop, and at an end at rest, the acceleration may jump. If an end is declared to be at rest but
    the speed there is not zero, all quantities are undefined.
    """
    moving = cells.grid.half.shape[0]
    xp: Any = jnp if is_traced(path) else np
    cell, both = np.tile(np.arange(moving), 2), np.repeat([0.0, 1.0], moving)
    (r1, r2, _), (a, slope, _) = motion_at(path, cells, cell, both)
    a = xp.maximum(a, 0.0)
    velocity, acceleration = xp.sqrt(a)[None] * r1, a[None] * r2 + 0.5 * slope[None] * r1
    start, end = cells.columns[0] == 0, cells.columns[-1] == path.timing.coefficients.shape[0] - 1
    rest = np.array(path.timing.rest)
    moves = (xp.sqrt(a) > CONTINUOUS * xp.sqrt(xp.max(a))).reshape(2, moving)
    wrong = (rest[0] & start & moves[0, 0]) | (rest[1] & end & moves[1, -1])
    faster, harder = (_jump(x.reshape(3, 2, moving), cells) for x in (velocity, acceleration))
    of_name = {name: faster | harder for name in names if of_third_order([name])} | dict.fromkeys(
        (*UPPER, SLOWEST), xp.zeros_like(faster)
    )
    of_name |= {name: xp.zeros_like(faster) for name in names if rate_degree(quantity(name))}
    return wrong | xp.stack([of_name.get(name, faster) for name in names])


def _jump(x: Float[Any, "3 2 moving"], cells: Cells) -> Bool[Any, " moving"]:
    """Return the cells at whose ends a vector differs from its value in the adjacent cell."""
    xp = namespace(x)
    change = xp.linalg.norm(x[:, 1, :-1] - x[:, 0, 1:], axis=0)
    adjacent = (cells.columns[1:] - cells.columns[:-1] == 1) & ~(cells.stops[1][:-1] | cells.stops[0][1:])
    found = adjacent & (change > CONTINUOUS * xp.max(xp.linalg.norm(x, axis=0)))
    none = xp.zeros(1, bool)
    return xp.concatenate([found, none]) | xp.concatenate([none, found])
