"""Run many searches in blocks on all cores, and regroup the unfinished searches from time to time.

All searches of a block run until the slowest of them is done. Therefore each stage runs only a few steps. The searches
that are not done are then packed into fewer blocks, each with searches whose last steps had similar computational
costs. The blocks are independent calls of one compiled function, distributed over the cores.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import ArrayLike

from qtraj.design.tuning.search import AbstractSearch
from qtraj.design.tuning.task import LimitSlots, Task
from qtraj.foundation import cores

Callback = Callable[[int, int], None]


def search(
    method: AbstractSearch, tasks: Task, slots: LimitSlots, z: ArrayLike, callback: Callback | None = None
) -> Any:
    """Return the final state (NumPy arrays) of a batch of searches, each from its own start in `z`.

    After every block, `callback` is called with the number of searches that are done, and the total number of searches.
    """
    tasks = jax.tree.map(np.asarray, tasks)
    z = np.asarray(z)
    count = z.shape[0]
    states: Any = ()  # arrays of all searches, allocated after the first block
    unfinished = np.arange(count)
    max_steps = int(method.step_limit)
    for steps in (*(s for s in method.stages if s < max_steps), max_steps):
        size = cores.block_size(unfinished.size)
        parts = cores.split(unfinished, size)
        call, source = (_start, z) if states == () else (_run, states)
        calls = [
            (
                method,
                np.asarray(steps, np.int32),
                cores.take(tasks, part, size),
                slots,
                cores.take(source, part, size),
            )
            for part in parts
        ]
        for part, block in zip(parts, cores.map_blocks(call, calls), strict=True):
            states = cores.allocate(count, block) if states == () else states
            cores.put(states, part, block)
            if callback is not None:
                callback(int(np.sum(states.done)), count)
        unfinished = unfinished[~states.done[unfinished]]
        if unfinished.size == 0:
            break
        unfinished = unfinished[np.argsort(states.effort[unfinished], kind="stable")]
    return states


def _start(method: AbstractSearch, steps: Any, tasks: Task, slots: LimitSlots, z: np.ndarray) -> Any:
    return _run(method, steps, tasks, slots, method.init(tasks, z))


@eqx.filter_jit
def _run(method: AbstractSearch, steps: Any, tasks: Task, slots: LimitSlots, states: Any) -> Any:
    return method.run(tasks, slots, states, steps)
