"""Find the knots of a retimed path at which its velocity or its acceleration jumps."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from qtraj.design.timing.constraints import UPPER
from qtraj.design.timing.parts import CONTINUOUS
from qtraj.design.timing.retimed_cells import Cells, motion_at
from qtraj.design.timing.timing import RetimedPath


def jumps(path: RetimedPath, cells: Cells, names: tuple[str, ...]) -> Bool[Array, "limits moving"]:
    """Return a mask of the cells in which the vehicle moves: true where a jump at an end affects the quantity.

    The jump makes the quantity infinite or undefined. A jump of the velocity makes all quantities infinite except those
    that depend only on the speed and the shape of the path, such as the yaw rate. A jump of the acceleration makes the
    jerk infinite. At a stop, and at an end at rest, the acceleration may jump. If an end is declared to be at rest but
    the speed there is not zero, all quantities are undefined.
    """
    moving = cells.grid.half.shape[0]
    cell, both = jnp.tile(jnp.arange(moving), 2), jnp.repeat(jnp.array([0.0, 1.0]), moving)
    (r1, r2, _), (a, slope, _) = motion_at(path, cells, cell, both.astype(path.duration.dtype))
    a = jnp.maximum(a, 0.0)
    velocity, acceleration = jnp.sqrt(a)[None] * r1, a[None] * r2 + 0.5 * slope[None] * r1
    start, end = cells.columns[0] == 0, cells.columns[-1] == path.timing.coefficients.shape[0] - 1
    rest = np.array(path.timing.rest)
    moves = (jnp.sqrt(a) > CONTINUOUS * jnp.sqrt(jnp.max(a))).reshape(2, moving)
    wrong = (rest[0] & start & moves[0, 0]) | (rest[1] & end & moves[1, -1])
    faster, harder = (_jump(x.reshape(3, 2, moving), cells) for x in (velocity, acceleration))
    of_name = {"jerk": faster | harder} | dict.fromkeys(UPPER, jnp.zeros_like(faster))
    return wrong | jnp.stack([of_name.get(name, faster) for name in names])


def _jump(x: Float[Array, "3 2 moving"], cells: Cells) -> Bool[Array, " moving"]:
    """Return the cells at whose ends a vector differs from its value in the adjacent cell."""
    change = jnp.linalg.norm(x[:, 1, :-1] - x[:, 0, 1:], axis=0)
    adjacent = (jnp.diff(jnp.asarray(cells.columns)) == 1) & ~(cells.stops[1][:-1] | cells.stops[0][1:])
    found = adjacent & (change > CONTINUOUS * jnp.max(jnp.linalg.norm(x, axis=0)))
    return jnp.pad(found, (0, 1)) | jnp.pad(found, (1, 0))
