"""Start a Dask cluster on this machine: one process for each core, with one thread each."""

import logging
import multiprocessing
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from qtraj.foundation.cores import CORES
from qtraj.foundation.extras import require_package

ATTEMPTS = 20
"""Number of workers that may die with a shard before the shard counts as the cause."""

GUARD = (
    "the workers of a sweep could not start. If this is a script, its main part must be guarded, because each worker "
    "imports the script: put the call of sweep into a block that starts with  if __name__ == '__main__':  . Or pass "
    "workers=0 to compute in this process"
)

LOST = "5 minutes"
"""Time after which a worker that ended and has not started again is given up: on a busy machine a start takes long."""

RESTARTS = 10.0
"""Interval [s] at which workers are started instead of those that were given up."""

ENVIRONMENT = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


@contextmanager
def local_client(workers: int | None) -> Iterator[Any]:
    """Start a cluster of `workers` processes, by default one for each core, and return its client.

    **Raises:** ModuleNotFoundError with the extra to install, if Dask is missing; RuntimeError with advice if the
    workers cannot start.
    """
    require_package("distributed", "a sweep with several workers", "sweep")
    if _in_child():
        raise RuntimeError(GUARD)
    import dask.config
    from distributed import Client, LocalCluster

    count = workers or CORES
    settings = {
        "distributed.worker.profile.enabled": False,  # its history of an hour takes some 10 MB in each worker
        "distributed.scheduler.allowed-failures": ATTEMPTS,
        "distributed.admin.low-level-log-length": 0,
        "distributed.deploy.lost-worker-timeout": LOST,
    }
    options: dict[str, Any] = {
        "n_workers": count,
        "threads_per_worker": 1,
        "processes": True,
        "dashboard_address": None,
        "silence_logs": logging.CRITICAL,
        "env": _environment(),
    }
    with dask.config.set(settings):
        try:
            cluster = LocalCluster(**options)
        except RuntimeError as error:
            raise RuntimeError(GUARD) from error
        with cluster, Client(cluster) as client, _kept(cluster, count):
            yield client


@contextmanager
def _kept(cluster: Any, count: int) -> Iterator[None]:
    """Keep the number of workers; a Dask cluster alone does not replace those that it gives up."""
    from tornado.ioloop import PeriodicCallback

    again = PeriodicCallback(lambda: cluster.scale(count), 1e3 * RESTARTS)
    cluster.loop.add_callback(again.start)
    try:
        yield
    finally:
        cluster.loop.add_callback(again.stop)


def _in_child() -> bool:
    """Return whether this process is importing the main script of its parent process."""
    return multiprocessing.parent_process() is not None and getattr(
        multiprocessing.current_process(), "_inheriting", False
    )


def _environment() -> dict[str, str]:
    flags = os.environ.get("XLA_FLAGS", "")
    own = {"JAX_PLATFORMS": os.environ.get("JAX_PLATFORMS") or "cpu"}
    own["XLA_FLAGS"] = f"{flags} --xla_cpu_multi_thread_eigen=false".strip()
    return ENVIRONMENT | own
