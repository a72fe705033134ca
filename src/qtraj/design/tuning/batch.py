"""Many searches at once: block by block on all cores, the unfinished ones gathered together from time to time.

Searches that are computed together wait for the slowest of them. So each stage runs a few steps, and what is not done
by then moves together into fewer blocks, side by side with others whose last steps took as much effort. The blocks are
independent calls of one compiled function, and the cores share them.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import ArrayLike

from qtraj.design.tuning.sqp import State, proceed, unstarted
from qtraj.design.tuning.task import Present, Task
from qtraj.foundation import cores

STAGES = (5, 8, 12, 18, 28, 48, 80)
"""Steps after which the unfinished searches are gathered."""

Told = Callable[[int, int], None]


def search(tasks: Task, which: Present, z: ArrayLike, most_steps: int, tell: Told | None = None) -> State:
    """The searches of stacked tasks, each from its own `z`: a state of NumPy arrays.

    `tell(done, searches)` is called after every block.
    """
    given = jax.tree.map(np.asarray, tasks)
    z = np.asarray(z)
    count = z.shape[0]
    states: Any = ()  # arrays of all searches, once the first block is known
    left = np.arange(count)
    for steps in (*(s for s in STAGES if s < most_steps), most_steps):
        size = cores.size_for(left.size)
        parts = cores.split(left, size)
        call, source = (_begin, z) if states == () else (_proceed, states)
        calls = [
            (np.asarray(steps, np.int32), cores.take(given, part, size), which, cores.take(source, part, size))
            for part in parts
        ]
        for part, found in zip(parts, cores.each(call, calls), strict=True):
            states = cores.room(count, found) if states == () else states
            cores.put(states, part, found)
            if tell is not None:
                tell(int(np.sum(states.done)), count)
        left = left[~states.done[left]]
        if left.size == 0:
            break
        left = left[np.argsort(states.effort[left], kind="stable")]
    return states


def _begin(steps: Any, tasks: Task, which: Present, z: np.ndarray) -> State:
    states = unstarted(tasks.low, tasks.high, tasks.weight, z)
    return _proceed(steps, tasks, which, states)


@eqx.filter_jit
def _proceed(steps: Any, tasks: Task, which: Present, states: State) -> State:
    return proceed(tasks, which, states, steps)
