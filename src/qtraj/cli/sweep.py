"""Implement `qtraj sweep`, which runs a scenario at many values of its keys."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from qtraj.cli import layout, terminal
from qtraj.cli.terminal import Outcome
from qtraj.foundation.progress_bar import Watch
from qtraj.foundation.size_text import duration_text

if TYPE_CHECKING:
    from qtraj.scenario.sweep import SweepTask
    from qtraj.sweeps.forecast import Forecast
    from qtraj.sweeps.swept import Swept

STORE = "sweep.zarr"
"""The name of the store in the folder for the results."""

MOST_FAILED = 10
"""Number of failed points that are printed."""

QUANTILES = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99)
"""Quantiles in the JSON output of outputs with a histogram."""

CONNECTION = 30
"""Time [s] after which a scheduler that does not answer is an error."""


@terminal.command(
    "qtraj sweep bus.toml --dry-run",
    "qtraj sweep bus.toml --out results  (run it again to complete it)",
    "qtraj sweep bus.toml --out /shared/results --scheduler tcp://10.0.0.1:8786",
)
def sweep(
    watch: Watch,
    scenario: Path = typer.Argument(..., metavar="SCENARIO.toml", help="A scenario with a table [sweep]."),
    workers: int | None = typer.Option(
        None, metavar="N", help="Number of processes on this machine; 0 for none. \\[default: one for each core]"
    ),
    scheduler: str | None = typer.Option(
        None, metavar="ADDRESS", help="Use the workers of this Dask scheduler, such as tcp://10.0.0.1:8786."
    ),
    retries: int = typer.Option(2, min=0, metavar="N", help="How often a shard that raises an error is tried again."),
    dry_run: bool = typer.Option(
        False, "--dry-run", help="Print the size and the duration; compute a few points only."
    ),
    report: bool = typer.Option(False, "--report", help="Also write report.html, a page for the browser."),
    folder: Path = Path("qtraj-out"),
) -> Outcome:
    """Run a scenario at many values of its keys, on all cores or on a Dask cluster, and store all results.

    The table [sweep] contains the parameters by the names of keys, such as limits.curvature = {from = 0.05, to = 0.2,
    steps = 16} or start.speed = {normal = [8.0, 0.5]}. The results are the Zarr store sweep.zarr in the folder --out,
    which xarray.open_zarr reads, with one row for each point and its parameters as coordinates.

    After an interrupt, or if a worker or the machine fails, run the same command again: it computes only what is
    missing. Points without a valid result have a status and NaN, and do not change the exit code. The exit code is 1 if
    some points could not be computed, and 2 if the store belongs to another sweep.
    """
    watch.say("reading")
    # Imported here, so that --help does not wait for pydantic and xarray.
    from qtraj.scenario.sweep import read_sweep
    from qtraj.sweeps.sweep import sweep as swept_over

    task = read_sweep(scenario)
    if dry_run:
        watch.say("computing some points")
        return _forecast(task)
    with _client(scheduler, watch) as client:
        watch.say("starting the workers" if client is None and workers != 0 else "computing")
        swept = swept_over(
            task.function,
            task.parameters,
            folder / STORE,
            client=client,
            workers=workers,
            retries=retries,
            progress=lambda progress: watch.working("computed", progress),
            **task.options,
        )
    hint = "" if swept.successful else "run the same command again to compute the rest"
    writers = {}
    if report:
        watch.say("writing the report")
        from qtraj.viz.sweep_report import write_sweep_report

        writers["report.html"] = partial(write_sweep_report, swept, title=task.loaded.scenario.name or "")
    return Outcome(_content(swept), _text(swept), task.loaded, not swept.successful, writers, hint=hint)


@contextmanager
def _client(scheduler: str | None, watch: Watch) -> Iterator[Any]:
    """Connect to a scheduler; without one, the value is None.

    **Raises:** OSError if the scheduler does not answer.
    """
    if scheduler is None:
        yield None
        return
    from qtraj.foundation.extras import require_package

    require_package("distributed", "a sweep on a Dask cluster", "sweep")
    from distributed import Client

    watch.say("connecting")
    try:
        client = Client(scheduler, timeout=CONNECTION)
    except (OSError, TimeoutError, ValueError) as error:
        raise OSError(f"--scheduler {scheduler}: there is no Dask scheduler at this address") from error
    with client:
        yield client


def _forecast(task: "SweepTask") -> Outcome:
    from qtraj.sweeps.forecast import forecast
    from qtraj.sweeps.preparation import Request

    found = forecast(Request(task.function, task.parameters, **task.options))
    return Outcome(found._asdict(), _size(found), task.loaded)


def _size(found: "Forecast") -> Iterator[layout.Part]:
    rows = [
        ("points", str(found.points)),
        ("shards", str(found.shards)),
        ("store", f"{found.size / 1e6:.6g} MB"),
        ("one process", f"{duration_text(found.seconds, 2)}, from {found.tried} points of the first shard"),
    ]
    yield layout.facts("Sweep", rows)


def _content(swept: "Swept") -> dict[str, Any]:
    summary = {
        name: {
            "mean": x.mean.tolist(),
            "minimum": x.minimum.tolist(),
            "minimum_point": x.minimum_point.tolist(),
            "maximum": x.maximum.tolist(),
            "maximum_point": x.maximum_point.tolist(),
            **({} if x.histogram is None else {"quantiles": {str(q): x.quantile(q).tolist() for q in QUANTILES}}),
        }
        for name, x in swept.summary.items()
    }
    errors = [{"first": x.first, "stop": x.stop, "parameters": x.parameters, "text": x.text} for x in swept.errors]
    return {
        "store": str(swept.folder),
        "points": swept.points,
        "computed": swept.done,
        "failed": swept.count_failed,
        "errors": errors,
        "summary": summary,
    }


def _text(swept: "Swept") -> Iterator[layout.Part]:
    yield swept.result
    scalars = [(name, x) for name, x in swept.summary.items() if x.mean.ndim == 0]
    rows = [(name, *(f"{float(v):.6g}" for v in (x.mean, x.minimum, x.maximum))) for name, x in scalars]
    if rows:
        table = layout.plain_table("Output", right=("Mean", "Minimum", "Maximum"))
        for row in rows:
            table.add_row(*row)
        yield layout.heading("Points without failure")
        yield table
    if swept.count_failed:
        yield layout.heading("Failed points")
        yield from _failed(swept)
    yield layout.heading("Store")
    yield str(swept.folder)


def _failed(swept: "Swept") -> Iterator[layout.Part]:
    failed = swept.failed
    for k in range(min(len(failed["point"]), MOST_FAILED)):
        values = ", ".join(f"{name} = {failed[name][k]:.6g}" for name in swept.plan.rows.names)
        text = f": {failed['text'][k]}" if failed["text"][k] else ""
        yield f"{failed['point'][k]}: {values} ({failed['status'][k].replace('_', ' ')}){text}"
    if (more := len(failed["point"]) - MOST_FAILED) > 0:
        yield f"… and {more} more; the store contains the status of each point"
