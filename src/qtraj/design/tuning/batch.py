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

from qtraj.design.tuning.search import AbstractSearch
from qtraj.design.tuning.task import Present, Task
from qtraj.foundation import cores

Told = Callable[[int, int], None]


def search(method: AbstractSearch, tasks: Task, which: Present, z: ArrayLike, tell: Told | None = None) -> Any:
    """The searches of stacked tasks, each from its own `z`: a state of NumPy arrays.

    `tell(done, searches)` is called after every block.
    """
    given = jax.tree.map(np.asarray, tasks)
    z = np.asarray(z)
    count = z.shape[0]
    states: Any = ()  # arrays of all searches, once the first block is known
    left = np.arange(count)
    most = int(method.most_steps)
    for steps in (*(s for s in method.stages if s < most), most):
        size = cores.size_for(left.size)
        parts = cores.split(left, size)
        call, source = (_begin, z) if states == () else (_proceed, states)
        calls = [
            (
                method,
                np.asarray(steps, np.int32),
                cores.take(given, part, size),
                which,
                cores.take(source, part, size),
            )
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


def _begin(method: AbstractSearch, steps: Any, tasks: Task, which: Present, z: np.ndarray) -> Any:
    return _proceed(method, steps, tasks, which, method.unstarted(tasks, z))


@eqx.filter_jit
def _proceed(method: AbstractSearch, steps: Any, tasks: Task, which: Present, states: Any) -> Any:
    return method.proceed(tasks, which, states, steps)
