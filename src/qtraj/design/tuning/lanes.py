"""Many searches at once: block by block on all cores, the unfinished ones gathered together from time to time.

Lanes that are computed together wait for the slowest of them. So each stage runs a few steps, and the lanes that are
not done by then move together into fewer blocks, those whose last steps were alike in effort side by side. The blocks
are independent calls of one compiled function, and the cores share them.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from qtraj.design.tuning.rows import Peaks
from qtraj.design.tuning.sqp import State, begin, proceed, step
from qtraj.design.tuning.task import Task
from qtraj.foundation import cores
from qtraj.foundation.exported.kept import kept

STAGES = (5, 8, 12, 18, 28, 48, 80)
"""Steps after which the unfinished lanes are gathered."""

Told = Callable[[int, int], None]


def search(tasks: Task, z: ArrayLike, most_steps: int, tell: Told | None = None) -> State:
    """The searches of stacked tasks, each from its own `z`: a state of NumPy arrays.

    `tell(done, lanes)` is called after every block.
    """
    stacked, rest = eqx.partition(tasks, eqx.is_array)
    given = jax.tree.map(np.asarray, stacked)
    states: Any = None  # arrays of all lanes, once the first block is known
    z = np.asarray(z)
    lanes = z.shape[0]
    left = np.arange(lanes)
    for steps in (0, *(s for s in STAGES if s < most_steps), most_steps):
        size = cores.size_for(left.size)
        parts = cores.split(left, size)
        call, until = (_begin, ()) if steps == 0 else (_proceed, (np.asarray(steps),))
        source = z if steps == 0 else states
        calls = [(*until, cores.take(given, part, size), rest, cores.take(source, part, size)) for part in parts]
        for part, found in zip(parts, cores.each(call, calls), strict=True):
            states = cores.room(lanes, found) if states is None else states
            cores.put(states, part, found)
            if tell is not None:
                tell(int(np.sum(states.done)), lanes)
        left = left[~states.done[left]]
        if left.size == 0:
            break
        left = left[np.argsort(states.effort[left], kind="stable")]
    return states


@kept(State, Peaks)
def _begin(given: Task, rest: Task, z: Float[Array, "lanes n"]) -> State:
    return jax.vmap(lambda task, z: begin(eqx.combine(task, rest), z))(given, z)


@kept(State, Peaks)
def _proceed(steps: Array, given: Task, rest: Task, states: State) -> State:
    advance = jax.vmap(lambda task, s: step(eqx.combine(task, rest), s))
    return proceed(lambda s: advance(given, s), states, steps)
