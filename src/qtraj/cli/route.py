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
    from qtraj.scenario.reader import ScenarioFile
    from qtraj.scenario.route import RouteTask


@terminal.command
def route(
    watch: Watch,
    recording: Path | None = typer.Argument(
        None,
        metavar="RECORDING",
        help="A recording (CSV or TUM), or a scenario (TOML) with a recording (default: the built-in scenario).",
    ),
    out: Path = terminal.out_option(),
    as_json: bool = terminal.json_option(),
) -> Outcome:
    """Fit a route to a whole recorded drive or flight, check limits, and tune the route so that they are satisfied.

    Stops, straight segments and gaps are allowed. For each limit of the scenario, the command determines on every
    segment whether the limit is proved to be satisfied, violated, undecided, or undefined. If the scenario has a table
    `tune`, the route is changed within a tube until every limit is proved to be satisfied on the changed segments. The
    command writes a dataset (paths.nc), the route, the fit and the findings (route.json, fit.json, certificate.json),
    the tuning (tuning.json), a map and plots (route.png, route.svg), and an HTML report (report.html). The exit code is
    1 if a limit is not proved to be satisfied; after tuning, a limited quantity may be undefined at stops.
    """
    watch.say("reading")
    # Imported here, so that --help does not wait for pydantic, xarray and matplotlib.
    from qtraj.design.fitting.route_facts import route_facts
    from qtraj.foundation.plain import plain
    from qtraj.io.route_dataset import route_dataset
    from qtraj.scenario.route import read_route
    from qtraj.viz import result_files
    from qtraj.viz.figures import route_figure

    loaded = read_route(recording)
    task, certificate, tuned = _tuned(loaded, watch)
    fitted = task.fitted
    watch.say("sampling")
    dataset = route_dataset(fitted, task.limits, certificate, tuned, task.track, loaded.provenance())
    content = terminal.header("route", loaded) | {
        "fit": route_facts(fitted),
        "frame": dataset.attrs["frame"],
        "purpose": loaded.scenario.purpose,
        "certificate": None if certificate is None else plain(certificate.record()),
        "tuned": None if tuned is None else plain(tuned.record()),
    }
    documents = {
        "route.json": fitted.path if tuned is None else tuned.path,
        "fit.json": fitted,
        "certificate.json": certificate if tuned is None else tuned.certificate,
        "tuning.json": tuned,
    }
    writers = {
        **result_files.netcdf("paths.nc", dataset),
        **result_files.documents(documents),
        **result_files.figure("route", route_figure(dataset)),
        **result_files.report(dataset),
    }
    checked = certificate if tuned is None else tuned
    failed = not bool(fitted.successful) or (checked is not None and not bool(checked.successful))
    show = partial(_show, content=content, task=task, certificate=certificate, tuned=tuned)
    return Outcome(content, show, failed, loaded.warnings, out, writers)


def _tuned(
    loaded: "ScenarioFile[Any]", watch: Watch
) -> tuple["RouteTask", "RouteCertificate | None", "TunedRoute | None"]:
    """Return the fitted route, its certificate (None without limits) and the tuned route (None without tuning)."""
    from qtraj.design.proof.certify import certify
    from qtraj.scenario.route import fit_recording

    watch.say("fitting the route")
    task = fit_recording(loaded)
    if task.limits is None:
        return task, None, None
    watch.say("checking the limits")
    certificate = certify(task.fitted.path, task.limits)
    if task.tune is None:
        return task, certificate, None
    watch.say("tuning")
    with naming(f"{loaded.file}: "):
        return task, certificate, task.tuned()


def _show(
    console: Console,
    content: dict[str, Any],
    task: "RouteTask",
    certificate: "RouteCertificate | None",
    tuned: "TunedRoute | None",
) -> None:
    """Print scenario, results and files, for a terminal with 80 columns."""
    layout.print_scenario(console, content["scenario"])
    layout.print_fit(console, task.fitted)
    if certificate is None:
        console.print(Text("No limits were checked: to check limits, write a scenario with a table [limits]."))
    else:
        _show_limits(console, "Limits on the whole route", certificate)
    if tuned is not None:
        _show_limits(console, "Limits on the tuned route", tuned.certificate)
        console.print(Text(tuned.result))
    layout.print_purposes(console, content["purpose"])
    layout.print_files(console, content["files"])


def _show_limits(console: Console, title: str, certificate: "RouteCertificate") -> None:
    status = certificate.segments.status
    violated = {name: str(int(np.sum(np.asarray(status[name]) == "broken"))) for name in certificate.names}
    layout.print_findings(console, title, certificate.findings(), "segments violated", violated, digits_of_time=6)
    for name in certificate.names:
        if spans := certificate.intervals(name):
            console.print(Text(f"the limit on {name} is violated at t [s] = {intervals(spans)}"))
