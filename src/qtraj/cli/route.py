"""Implement `qtraj route`, which fits a route to a whole recording, checks its limits and tunes it."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer
from rich.console import Console
from rich.text import Text

from qtraj.cli import layout, terminal
from qtraj.cli.terminal import Outcome
from qtraj.foundation.naming import naming
from qtraj.foundation.number_text import intervals
from qtraj.foundation.progress_bar import Watch

if TYPE_CHECKING:
    from qtraj.design.proof.route_certificate import RouteCertificate
    from qtraj.design.tuning_route.tuned_route import TunedRoute
    from qtraj.foundation.folder import Writer
    from qtraj.scenario.reader import ScenarioFile
    from qtraj.scenario.route import RouteTask


@terminal.command()
def route(
    watch: Watch,
    recording: Path | None = typer.Argument(
        None,
        metavar="RECORDING",
        help="A recording (CSV or TUM), or a scenario (TOML) with a recording (default: the built-in scenario).",
    ),
) -> Outcome:
    """Fit a route to a whole recorded drive or flight, check limits, and tune the route so that they are satisfied.

    Stops, straight segments and gaps are allowed. For each limit of the scenario, the command determines on every
    segment whether the limit is proved to be satisfied, violated, undecided, or undefined. If the scenario has a table
    `tune`, the route is changed within a tube until every limit is proved to be satisfied on the changed segments. The
    command writes a dataset (paths.nc), the route, the fit and the findings (route.json, fit.json, certificate.json),
    the tuning (tuning.json), a map and plots (route.png, route.svg), and an HTML report (report.html). The exit code is
    1 if the fit fails or a limit is not proved to be satisfied; after tuning, a limited quantity may be undefined at
    stops.
    """
    watch.say("reading")
    # Imported here, so that --help does not wait for pydantic and xarray.
    from qtraj.design.fitting.route_facts import route_facts
    from qtraj.foundation.plain import plain
    from qtraj.scenario.route import read_route

    loaded = read_route(recording)
    task, certificate, tuned = _tuned(loaded, watch)
    watch.say("sampling")
    frame, writers = _files(loaded, task, certificate, tuned)
    content = {
        "fit": route_facts(task.fitted),
        "frame": frame,
        "purpose": loaded.scenario.purpose,
        "certificate": None if certificate is None else plain(certificate.record()),
        "tuned": None if tuned is None else plain(tuned.record()),
    }
    checked = certificate if tuned is None else tuned
    failed = not bool(task.fitted.successful) or (checked is not None and not bool(checked.successful))
    show = partial(_show, task=task, certificate=certificate, tuned=tuned)
    return Outcome(content, show, loaded, failed, writers, optional=("certificate.json", "tuning.json"))


def _tuned(
    loaded: "ScenarioFile[Any]", watch: Watch
) -> tuple["RouteTask", "RouteCertificate | None", "TunedRoute | None"]:
    """Return the fitted route, its certificate (None without limits) and the tuned route (None without tuning)."""
    from qtraj.design.proof.certify import certify
    from qtraj.scenario.route import fit_recording

    watch.say("fitting the route")
    task = fit_recording(loaded)
    if not task.limits.given():
        return task, None, None
    watch.say("checking the limits")
    certificate = certify(task.fitted.path, task.limits)
    if task.tuning is None:
        return task, certificate, None
    watch.say("tuning")
    with naming(f"{loaded.file}: "):
        return task, certificate, task.tuning(watch.tuning)


def _files(
    loaded: "ScenarioFile[Any]",
    task: "RouteTask",
    certificate: "RouteCertificate | None",
    tuned: "TunedRoute | None",
) -> tuple[str, "dict[str, Writer]"]:
    """Return the name of the frame of the dataset, and the writers of the files."""
    from qtraj.io.route_dataset import route_dataset
    from qtraj.viz import result_files
    from qtraj.viz.figures import route_figure  # imported after the computation, because matplotlib is slow to import

    dataset = route_dataset(task.fitted, task.limits, certificate, tuned, task.track, loaded.provenance())
    documents = {
        "route.json": task.fitted.path if tuned is None else tuned.path,
        "fit.json": task.fitted,
        "certificate.json": certificate if tuned is None else tuned.certificate,
        "tuning.json": tuned,
    }
    return dataset.attrs["frame"], {
        **result_files.netcdf("paths.nc", dataset),
        **result_files.documents(documents),
        **result_files.figure("route", route_figure(dataset)),
        **result_files.report(dataset),
    }


def _show(
    console: Console,
    content: dict[str, Any],
    task: "RouteTask",
    certificate: "RouteCertificate | None",
    tuned: "TunedRoute | None",
) -> None:
    """Print the fit and the limits."""
    layout.print_fit(console, task.fitted)
    if certificate is None:
        console.print(Text("No limits were checked: to check limits, write a scenario with a table [limits]."))
    else:
        _show_limits(console, "Limits on the whole route", certificate)
    if tuned is not None:
        _show_limits(console, "Limits on the tuned route", tuned.certificate)
        console.print(Text(tuned.result))
    layout.print_purposes(console, content["purpose"])


def _show_limits(console: Console, title: str, certificate: "RouteCertificate") -> None:
    status = certificate.segments.status
    violated = {name: str(int(np.sum(np.asarray(status[name]) == "broken"))) for name in certificate.names}
    layout.print_findings(console, title, certificate.findings(), "segments violated", violated, digits_of_time=6)
    for name in certificate.names:
        if spans := certificate.intervals(name):
            console.print(Text(f"the limit on {name} is violated at t [s] = {intervals(spans)}"))
