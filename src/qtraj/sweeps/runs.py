"""Run the shards of a sweep: one after the other in this process, or on the workers of a Dask cluster."""

import errno
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from typing import Any

from qtraj.sweeps.outputs import WrongOutputError
from qtraj.sweeps.shards import Done, Plan, compute

AHEAD = 3
"""Number of tasks for each thread of the cluster that wait or run at the same time."""

NO_SPACE = (errno.ENOSPC, errno.EDQUOT)

LOST = (
    "the connection to the Dask scheduler was lost. All finished shards are in the store: run the same sweep again to "
    "complete it"
)

Ended = tuple[int, Done | Exception]
"""The number of a shard, and its result or its error."""


def run_here(plan: Plan, shards: Iterable[int], retries: int) -> Iterator[Ended]:
    """Yield the results of shards that are computed in this process.

    **Raises:** OSError if the disk is full.
    """
    for k in shards:
        ended: Done | Exception | None = None
        for _ in range(retries + 1):
            ended = _attempt(plan, k)
            if isinstance(ended, Done | WrongOutputError):
                break
        if ended is not None:
            require_space(ended)
            yield k, ended


def run_on(client: Any, plan: Plan, shards: Sequence[int], retries: int) -> Iterator[Ended]:
    """Yield the results of shards that the workers of a client compute, in the order in which they end.

    A few tasks for each thread are submitted at a time, so that the scheduler stays small, whatever the size of the
    sweep. Their number follows the threads of the cluster, which may grow and shrink during the sweep.

    **Raises:** OSError if the disk is full, or the connection to the scheduler is lost.
    """
    from distributed import CancelledError, as_completed  # imported here, because the extra is optional

    waiting = iter(shards)
    numbers: dict[Any, int] = {}

    def submit(count: int) -> list[Any]:
        chosen = [*islice(waiting, count)]
        keys = [f"sweep-{plan.fingerprint}-{k}" for k in chosen]
        futures = [
            client.submit(_attempt_on_worker, plan, k, key=key, pure=False, retries=retries)
            for k, key in zip(chosen, keys, strict=True)
        ]
        numbers.update(zip(futures, chosen, strict=True))
        return futures

    try:
        completed = as_completed(submit(_most(client)))
        for future in completed:
            if future.cancelled():
                raise ConnectionError(LOST)
            ended: Any = future.exception() or future.result()
            require_space(ended)
            yield numbers.pop(future), ended
            completed.update(submit(max(_most(client) - len(numbers), 0)))
    except (CancelledError, TimeoutError) as error:
        raise ConnectionError(LOST) from error
    finally:
        client.cancel([*numbers])


def _most(client: Any) -> int:
    """Return the number of tasks that may wait or run at the same time.

    **Raises:** ConnectionError if the connection to the scheduler is lost.
    """
    try:
        return AHEAD * max(sum(client.nthreads().values()), 1)
    except OSError as error:
        raise ConnectionError(LOST) from error


def require_space(ended: Any) -> None:
    """Raise an OSError if a shard failed because the disk is full."""
    if isinstance(ended, OSError) and ended.errno in NO_SPACE:
        text = f"{ended.strerror}: all finished shards are in the store; free some space and run the same sweep again"
        raise OSError(ended.errno, text, ended.filename)


def _attempt(plan: Plan, k: int) -> Done | Exception:
    try:
        return compute(plan, k)
    except Exception as error:
        return error


def _attempt_on_worker(plan: Plan, k: int) -> Done | Exception:
    """Return an error that another attempt would repeat, and raise all others, so that Dask tries again."""
    ended = _attempt(plan, k)
    if isinstance(ended, WrongOutputError) or (isinstance(ended, OSError) and ended.errno in NO_SPACE):
        return ended
    if isinstance(ended, Exception):
        raise ended
    return ended
