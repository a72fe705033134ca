"""Compute a function at many points, in shards on the workers of a Dask cluster, into one store that can be resumed."""

from __future__ import annotations  # so that `help` shows short names

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from qtraj.foundation.argument import require_type, require_whole
from qtraj.foundation.extras import require_package
from qtraj.foundation.progress import Progress, Report
from qtraj.foundation.reporting import reporting
from qtraj.foundation.size_text import duration_text
from qtraj.sweeps.local_cluster import local_client
from qtraj.sweeps.lock import locked
from qtraj.sweeps.outputs import WrongOutputError
from qtraj.sweeps.preparation import Request, plan_of, store_of
from qtraj.sweeps.runs import Ended, run_here, run_on
from qtraj.sweeps.shards import Done, Plan
from qtraj.sweeps.swept import ShardError, Swept


def sweep(
    function: Callable[..., Any],
    parameters: Mapping[str, Any],
    out: str | Path,
    *,
    client: Any = None,
    workers: int | None = None,
    samples: int | None = None,
    design: str = "random",
    seed: int = 0,
    batch: bool | None = None,
    shard: int | None = None,
    keep: bool = True,
    histograms: Mapping[str, Sequence[float]] | None = None,
    units: Mapping[str, str] | None = None,
    retries: int = 2,
    progress: Report | bool | None = None,
) -> Swept:
    """Compute a function at many points, and store the results as one dataset; running it again completes it.

    Args:
        function: A function of one point, a dictionary of named numbers, which returns a dictionary of named numbers or
            arrays. With `batch`, a function of many points at once: the dictionaries contain arrays with one row for
            each point, which is faster. The functions in `qtraj.sweeps`, such as `qtraj.sweeps.tune`, create functions
            for batches. The output "failed", a bool, tells which points have no valid result.
        parameters: The values of each parameter: a list or an array (a grid), `sweeps.Uniform`, `sweeps.Normal`,
            `sweeps.Column`, or a function of the dictionary of all parameters before it, as arrays. The points are all
            combinations of the grids with the samples.
        out: The folder for the store. All workers must see it under this name.
        client: A client of `dask.distributed`. By default, a cluster is started on this machine.
        workers: The number of processes on this machine, by default one for each core; 0 computes in this process,
            without Dask.
        samples: The number of samples of random parameters.
        design: How samples are drawn: "random" (independently), "latin" (Latin hypercube) or "sobol" (scrambled).
        seed: The seed of the samples.
        batch: Whether the function computes many points at once; by default, its attribute `batch`, otherwise False.
        shard: The number of points of each task; by default, the attribute `shard` of the function, otherwise 16384 for
            a batch and 1024 for single points, and less for small sweeps.
        keep: Whether the parameters and the outputs of each point are stored. Otherwise only its status is stored; the
            summaries are always available.
        histograms: For outputs whose quantiles are needed: (low, high), or (low, high, bins).
        units: Units of parameters and outputs by name, in netCDF notation, such as "m s-1"; by default, the attribute
            `units` of the function.
        retries: How often a shard that raises an error is tried again.
        progress: A function that is called with a `Progress`, or True to display the progress (extra `cli`).

    Returns:
        A `Swept`: `failed` (the failed points with their parameters), `summary` (mean, extremes and quantiles of each
        output), `errors` (shards that raised errors) and `to_xarray()`.

    Raises:
        ValueError: For invalid parameters or options; for a folder that contains another sweep, naming the difference,
            or that another process is writing; if the function fails at all of the first points; or, after all other
            shards are stored, if it returns other names or shapes at some point.
        OSError: If the disk is full or the scheduler is lost; finished shards are kept.
        RuntimeError: If the workers cannot start, for example from a script without a main guard.
        ModuleNotFoundError: If a package of the extra `sweep` is missing.

    Example:
        >>> import tempfile
        >>> def area(point):
        ...     return {"area": point["a"] * point["b"]}
        >>> swept = sweep(area, {"a": [1.0, 2.0], "b": [3.0, 4.0, 5.0]}, tempfile.mkdtemp(), workers=0)
        >>> swept.result
        '6 of 6 points were computed, of which 0 failed.'
        >>> swept.summary["area"].maximum.item(), swept.parameters(5)
        (10.0, {'a': 2.0, 'b': 5.0})
    """
    require_package("zarr", "the store of a sweep", "sweep")
    require_whole(retries, "retries")
    if workers is not None:
        require_whole(workers, "workers")
    if client is not None and workers is not None:
        raise ValueError("client and workers were both given: pass one of them")
    request = Request(function, parameters, samples, design, seed, batch, shard, keep, histograms or {}, units)
    folder = Path(_folder(out)).absolute()
    prepared = store_of(request, folder)
    with locked(prepared.store.own / "lock"), reporting(progress) as report:
        plan = plan_of(request, prepared)
        missing = [k for k in range(plan.store.shards) if not plan.is_finished(k)]
        with _runner(client, workers, bool(missing)) as run:
            swept = _collected(plan, missing, run(plan, missing, retries), report)
        plan.store.clear_staging()
        return swept


def _folder(out: Any) -> Any:
    require_type(out, str | Path, "out", "the name of a folder")
    return out


@contextmanager
def _runner(client: Any, workers: int | None, needed: bool) -> Iterator[Callable[..., Iterator[Ended]]]:
    """Return the function that runs shards; start a cluster if it is needed."""
    if client is not None:
        yield lambda *arguments: run_on(client, *arguments)
    elif workers == 0 or not needed:
        yield run_here
    else:
        with local_client(workers) as own:
            yield lambda *arguments: run_on(own, *arguments)


def _collected(plan: Plan, missing: Sequence[int], ended: Iterator[Ended], report: Report | None) -> Swept:
    """Return the result of a sweep after all missing shards have ended.

    **Raises:** WrongOutputError if a shard ended with it.
    """
    store = plan.store
    start = store.points - sum(stop - first for first, stop in map(store.span, missing))
    done, began = start, time.monotonic()
    errors: list[ShardError] = []
    wrong: WrongOutputError | None = None
    for k, result in ended:
        first, stop = store.span(k)
        if isinstance(result, Done):
            done += result.points
        else:
            text = f"{type(result).__name__}: {result}"
            errors.append(ShardError(first, stop, plan.rows.point(first), text))
            wrong = result if isinstance(result, WrongOutputError) else wrong
        if report is not None:
            report(Progress(_rate(done - start, store.points - done, time.monotonic() - began), done, store.points))
    if wrong is not None:
        raise wrong
    failed = sum(entry["failed"] for _, entry in store.entries(plan.fingerprint))
    return Swept(store.folder, store.points, done, failed, tuple(sorted(errors, key=lambda x: x.first)), plan)


def _rate(done: int, left: int, seconds: float) -> str:
    """Return the rate and the time left as text."""
    if not done:
        return "points"
    rate = done / max(seconds, 1e-9)
    return f"points, {rate:.3g} per second, {duration_text(left / rate, 2)} left"
