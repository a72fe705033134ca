"""Compute one shard of a sweep: the only task that workers run."""

import time
import uuid
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import numpy as np

from qtraj.sweeps.metadata import STATUS, STATUS_OUTPUT
from qtraj.sweeps.outputs import OK, Outcome, Output, Schema, call
from qtraj.sweeps.rows import Rows
from qtraj.sweeps.store import Store
from qtraj.sweeps.summaries import Histogram, summarized

MOST_TEXTS = 3
"""Number of errors of single points whose texts an entry contains."""

LONGEST = 500
"""Maximum number of characters of such a text."""


@dataclass(frozen=True)
class Plan:
    """Everything that a worker needs to compute shards.

    `schema`: the outputs of the function. `x64`: whether JAX uses float64. `keep`: whether the store contains the
    parameters and the outputs of each point. `run`: the call of `sweep`, whose workers keep this plan.
    """

    store: Store
    rows: Rows
    function: Callable[..., Any]
    batch: bool
    schema: Schema
    fingerprint: str
    x64: bool
    keep: bool
    histograms: Mapping[str, Histogram]
    run: str = field(default_factory=lambda: uuid.uuid4().hex, compare=False)

    @property
    def arrays(self) -> dict[str, Output]:
        """All arrays of the store: the parameters, the outputs and the status."""
        kept = {**parameter_outputs(self.rows), **self.schema} if self.keep else {}
        return {**kept, STATUS: STATUS_OUTPUT}

    def is_finished(self, k: int) -> bool:
        """Return whether shard `k` is in the ledger, and its chunks are as they were written."""
        entry = self.store.entry(k, self.fingerprint)
        return entry is not None and self.store.is_complete(k, entry["checksums"], self.arrays)


class Done(NamedTuple):
    """A finished shard: its numbers of points and failed points, and the time [s] of the calls of the function."""

    points: int
    failed: int
    seconds: float


MOST_PLANS = 16
"""Number of plans that a process keeps."""

_PLANS: dict[str, Plan] = {}
"""The plans of this process by run: each task brings its own copy of the function, but only the first is compiled."""


def parameter_outputs(rows: Rows) -> dict[str, Output]:
    """Return the dtypes of the parameters in the store."""
    first = rows.at(0, 1)
    return {name: Output(values.dtype.newbyteorder("<").str, ()) for name, values in first.items()}


def compute(plan: Plan, k: int) -> Done:
    """Compute a shard, write its chunks and then its entry in the ledger; do nothing if it is finished.

    **Raises:** WrongOutputError for outputs that differ from the schema; OSError if the disk is full; errors of a
    function for batches.
    """
    plan = _first_copy(plan)
    start, stop = plan.store.span(k)
    if plan.is_finished(k):
        entry = plan.store.entry(k, plan.fingerprint) or {"failed": 0}
        return Done(stop - start, entry["failed"], 0.0)
    with jax.enable_x64(plan.x64):
        began = time.perf_counter()
        points = plan.rows.at(start, stop)
        outcome = call(plan.function, plan.batch, points, stop - start, plan.schema)
        seconds = time.perf_counter() - began
    checksums = _write(plan, k, points, outcome)
    failed = int(np.count_nonzero(outcome.status != OK))
    texts = [[start + at, text[:LONGEST]] for at, text in [*outcome.texts.items()][:MOST_TEXTS]]
    plan.store.write_entry(
        k,
        {
            "fingerprint": plan.fingerprint,
            "points": stop - start,
            "failed": failed,
            "texts": texts,
            "checksums": checksums,
            "summary": summarized(outcome, start, plan.histograms),
        },
    )
    return Done(stop - start, failed, seconds)


def _first_copy(plan: Plan) -> Plan:
    if len(_PLANS) > MOST_PLANS:
        _PLANS.clear()
    return _PLANS.setdefault(plan.run, plan)


def _write(plan: Plan, k: int, points: Mapping[str, np.ndarray], outcome: Outcome) -> dict[str, int]:
    """Write the chunks of a shard, and return their checksums."""
    checksums = {}
    for name, output in plan.arrays.items():
        values = points[name] if name in points else outcome.values.get(name, outcome.status)
        checksums[name] = plan.store.write_chunk(name, k, np.asarray(values, output.dtype), output.fill)
    return checksums
