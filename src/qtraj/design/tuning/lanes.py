"""Many searches at once: block by block on all cores, the unfinished ones gathered together from time to time.

Lanes that are computed together wait for the slowest of them. So each stage runs a few steps, and the lanes that are
not done by then move together into fewer blocks. The blocks are independent calls of one compiled function, and the
cores share them.
"""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from qtraj.design.tuning.sqp import State, begin, proceed
from qtraj.design.tuning.task import Task

BLOCKS = (8, 64)
"""Lanes computed together, in a small search and in a large one, whose numbers still stay in the cache."""

FEW = 16
"""So few lanes for each core make a small search."""

STAGES = (5, 8, 12, 18, 28, 48, 80)
"""Steps after which the unfinished lanes are gathered."""

CORES = os.cpu_count() or 1

Told = Callable[[int, int], None]


def search(tasks: Task, z: ArrayLike, most_steps: int, tell: Told | None = None) -> State:
    """The searches of stacked tasks, each from its own `z`. `tell(done, lanes)` is called after every block."""
    stacked, rest = eqx.partition(tasks, eqx.is_array)
    given = jax.tree.map(np.asarray, stacked)
    states: Any = None  # arrays of all lanes, once the first block is known
    x64 = bool(jax.config.read("jax_enable_x64"))
    z = np.asarray(z)
    lanes = z.shape[0]
    left = np.arange(lanes)
    known: set[tuple[int, bool]] = set()  # kinds of blocks that are compiled by now
    with ThreadPoolExecutor(CORES) as pool:
        for steps in (0, *(s for s in STAGES if s < most_steps), most_steps):
            size = BLOCKS[0] if left.size <= FEW * CORES else BLOCKS[1]
            blocks = [left[k : k + size] for k in range(0, left.size, size)]
            source = z if steps == 0 else states
            calls = [(_take(given, b, size), rest, _take(source, b, size), steps, x64) for b in blocks]
            kind = (size, steps == 0)
            for block, found in zip(blocks, _all(pool, calls, 0 if kind in known else 1), strict=True):
                if states is None:
                    states = jax.tree.map(lambda x: np.zeros((lanes, *x.shape[1:]), x.dtype), found)
                _put(states, block, found)
                if tell is not None:
                    tell(int(np.sum(states.done)), lanes)
            known.add(kind)
            left = left[~np.asarray(states.done)[left]]
            if left.size == 0:
                break
    return jax.tree.map(jnp.asarray, states)


def _all(pool: ThreadPoolExecutor, calls: list[tuple[Any, ...]], alone: int) -> Iterator[State]:
    """What the calls give, in their order; the first `alone` of them alone, so that no two threads compile the same."""
    yield from (_run(*call) for call in calls[:alone])
    jobs = [pool.submit(_run, *call) for call in calls[alone:]]
    yield from (job.result() for job in jobs)


def _run(given: Task, rest: Task, source: Any, steps: int, x64: bool) -> State:
    with jax.enable_x64(x64):  # a thread does not have the settings of its parent
        call = _begin(given, rest, source) if steps == 0 else _proceed(given, rest, source, jnp.asarray(steps))
        return jax.tree.map(np.asarray, call)


@eqx.filter_jit
def _begin(given: Task, rest: Task, z: Float[Array, "lanes n"]) -> State:
    return jax.vmap(lambda task, z: begin(eqx.combine(task, rest), z))(given, z)


@eqx.filter_jit
def _proceed(given: Task, rest: Task, states: State, steps: Array) -> State:
    return jax.vmap(lambda task, s: proceed(eqx.combine(task, rest), s, steps))(given, states)


def _take(tree: Any, block: np.ndarray, size: int) -> Any:
    """The lanes of a block, filled up with its first to the size for which the search is compiled."""
    full = np.concatenate([block, np.full(size - block.size, block[0])])
    return jax.tree.map(lambda x: x[full], tree)


def _put(states: Any, block: np.ndarray, found: Any) -> None:
    for whole, part in zip(jax.tree.leaves(states), jax.tree.leaves(found), strict=True):
        whole[block] = part[: block.size]
