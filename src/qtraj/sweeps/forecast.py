"""Predict the size and the duration of a sweep from some points of its first shard."""

import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from qtraj.sweeps.outputs import call
from qtraj.sweeps.preparation import Request, plan_of, store_of

ENOUGH = 1.0
"""Time [s] of calls of the function that is enough for a prediction."""


class Forecast(NamedTuple):
    """The numbers of points and shards, the size of the store [bytes], and the time [s] of one process for all points.

    `tried`: the number of points from which the time was predicted.
    """

    points: int
    shards: int
    size: int
    seconds: float
    tried: int


def forecast(request: Request) -> Forecast:
    """Call the function at points of the first shard, twice as many each time, until a prediction is possible.

    Nothing is stored.

    **Raises:** The errors of `sweep`.
    """
    with tempfile.TemporaryDirectory() as folder:
        plan = plan_of(request, store_of(request, Path(folder).resolve() / "store"))
        size = sum(np.dtype(x.dtype).itemsize * int(np.prod(x.shape, dtype=int)) for x in plan.arrays.values())
        tried, seconds = 1, 0.0
        while True:
            tried = min(tried, plan.store.span(0)[1])
            with jax.enable_x64(plan.x64):
                points = plan.rows.at(0, tried)
                call(plan.function, plan.batch, points, tried, plan.schema)  # the first call may compile
                began = time.perf_counter()
                call(plan.function, plan.batch, points, tried, plan.schema)
                seconds = time.perf_counter() - began
            if seconds > ENOUGH / 2 or tried == plan.store.span(0)[1]:
                break
            tried *= 4
        store = plan.store
        return Forecast(
            store.points, store.shards, size * store.shards * store.shard, seconds / tried * store.points, tried
        )
