"""Evaluate a few paths at a few instants in NumPy, which compiles nothing."""

from typing import Any

import jax
import numpy as np

from qtraj.batch.channels import channels
from qtraj.batch.stacking import results, stacked
from qtraj.batch.task import Task
from qtraj.foundation.namespace import in_numpy, needs_jax
from qtraj.path.channel import CHANNELS

FEW, FEW_OF_ONE = 4096, 65536
"""Largest number of instants that are evaluated in NumPy: in total over a batch of paths, and of a single path.

More instants are evaluated by JAX. JAX is twice as fast for a single path, but compiling takes more than a second.
"""


def is_small(task: Task, work: Any, times: Any) -> bool:
    """Return whether a request is evaluated in NumPy: small, concrete, with a path and a frame that support NumPy.

    `work` consists of a path or a batch of paths, a frame, and a vehicle or None.
    """
    paths, frame, _ = work
    if task.reduce is not None or not (paths.supports_numpy and frame.supports_numpy):
        return False
    if task.batched and paths.polynomials() is None:
        return False
    few = times.shape[-1] <= FEW_OF_ONE
    if task.batched:
        few = paths.duration.shape[0] * times.shape[-1] <= FEW
    return few and not needs_jax(jax.tree.leaves((work, times)))


@in_numpy
def evaluated(task: Task, work: Any, times: Any) -> dict[str, Any]:
    """Return the arrays of the outputs by name, computed in NumPy."""
    driven, frame = stacked(task, work)
    about = frame if driven.vehicle is None else (*frame[:2], driven.vehicle)
    rows: Any = np.atleast_2d(times)
    found = channels(driven.paths, rows, about, task.names)
    lead = next(iter(found.values()))[0].shape if found else ()
    lead = lead if task.batched else lead[1:]
    raw: Any = {name: np.stack(x).reshape(*CHANNELS[name].shape, *lead) for name, x in found.items()}
    return results(task, raw)
