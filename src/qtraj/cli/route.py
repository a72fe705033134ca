"""Implement `qtraj route`, which fits a route to a whole recording, checks its limits and tunes it."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from qtraj.cli import layout, limit_option, terminal
from qtraj.cli.margins import margins, with_certificate
from qtraj.cli.terminal import Outcome
from qtraj.foundation.naming import naming
from qtraj.foundation.progress_bar import Watch

if TYPE_CHECKING:
    from qtraj.design.proof.route_certificate import RouteCertificate
    from qtraj.design.robust.box_outcome import BoxTuned
    from qtraj.design.robust.outcome import RobustTuned
    from qtraj.design.tuning_route.tuned_route import TunedRoute
    from qtraj.scenario.reader import ScenarioFile
    from qtraj.scenario.route import RouteTask


@terminal.command(
    "qtraj route  (the built-in scenario)",
    "qtraj route drive.csv --out drive",
    "qtraj route log.csv --axes ned --units velocity=km/h",
    "qtraj route drive.csv --limit speed=13.9 --limit lateral_acceleration=2",
    "qtraj route bus.toml --out results",
)
def route(
    watch: Watch,
    recording: Path | None = typer.Argument(
        None,
        metavar="RECORDING",
        help="A recording (a table, TUM, KITTI, GPX or NMEA), or a scenario (TOML) with a recording (default: the "
        "built-in scenario).",
    ),
    limit: list[str] | None = typer.Option(
        None,
        metavar="NAME=VALUE",
        help=limit_option.HELP,
    ),
    track: dict[str, Any] | None = None,
) -> Outcome:
    """Fit a route to a whole recorded drive or flight, check limits, and tune the route so that they are satisfied.

    Stops, straight segments and gaps are allowed. For each limit and every segment, the command determines whether the
    limit is proved to be satisfied, is violated, is undecided, or is undefined. If the scenario has a table `tune`, the
    route is changed within a tube until every limit is proved to be satisfied on the changed segments. The command
    writes a dataset (paths.nc), the route, the fit and the findings (route.json, fit.json, certificate.json), the
    tuning (tuning.json), a map and plots (route.png, route.svg), and an HTML report (report.html). The exit code is 1
    if the fit fails or a limit is not proved to be satisfied; after tuning, a limited quantity may be undefined at
    stops.

    With a table `spread` or `box` of deviations, the command tightens the limits, so that they are satisfied with a
    stated probability, or for all deviations. It then also writes the result of `qtraj.robust_tune_route`
    (robust.json).
    """
    watch.say("reading")
    # Imported here, so that --help does not wait for pydantic and xarray.
    from qtraj.design.fitting.route_facts import route_facts
    from qtraj.foundation.plain import plain
    from qtraj.io.route_dataset import route_dataset
    from qtraj.io.track.reading import recorded, recording_residual
    from qtraj.scenario.route import read_route

    loaded = read_route(recording, limit_option.limits(limit), track or {})
    task, certificate, tuned, robust = _tuned(loaded, watch)
    line = recording_residual(task.recording, task.fitted.path)
    watch.say("sampling")
    from qtraj.viz.command_files import route_files  # imported after the computation, because matplotlib is slow

    about = loaded.provenance() | ({} if robust is None else {"tuning_robust": robust.result})
    dataset = route_dataset(task.fitted, task.limits, certificate, tuned, task.track, about)
    content = {
        "recording": recorded(task.recording),
        "fit": route_facts(task.fitted),
        "race_line": None if line is None else line._asdict(),
        "frame": dataset.attrs["frame"],
        "purpose": loaded.scenario.purpose,
        "certificate": None if certificate is None else plain(certificate.record()),
        "tuned": None if tuned is None else plain(tuned.record()),
        **({} if robust is None else {"robust": margins(robust)}),
    }
    checked = robust or (certificate if tuned is None else tuned)
    failed = not bool(task.fitted.successful) or (checked is not None and not bool(checked.successful))
    text = [
        *layout.recording(task.recording),
        *layout.fit(task.fitted, () if line is None else line.rows()),
        *_limits("Limits on the whole route", certificate),
        *([] if tuned is None else [*_limits("Limits on the tuned route", tuned.certificate)]),
        *([] if tuned is None else [tuned.result if robust is None else robust.result]),
        *(f"{name}: {reason}" for name, reason in loaded.scenario.purpose.items()),
    ]
    writers = route_files(dataset, task.fitted, certificate, tuned, task.limits, robust)
    optional = ("certificate.json", "tuning.json", "robust.json")
    return Outcome(content, text, loaded, failed, writers, optional=optional)


def _tuned(
    loaded: "ScenarioFile[Any]", watch: Watch
) -> tuple["RouteTask", "RouteCertificate | None", "TunedRoute | None", "RobustTuned | BoxTuned | None"]:
    """Return the fitted route, its certificate, the tuned route, and the result of a tuning with margins.

    The certificate is None without limits, and each result is None without such a tuning. The certificate of the tuned
    route is that of the specified limits, also with margins.
    """
    from qtraj.design.proof.certify import certify
    from qtraj.scenario.route import fit_recording

    watch.say("fitting the route")
    task = fit_recording(loaded)
    if not (task.limits.given() or task.limits.keep_out):
        return task, None, None, None
    watch.say("checking the limits")
    certificate = certify(task.fitted.path, task.limits)
    if task.tuning is None:
        return task, certificate, None, None
    watch.say("tuning")
    with naming(f"{loaded.file}: "):
        if task.robust_tuning is None:
            return task, certificate, task.tuning(watch.tuning), None
        robust = task.robust_tuning(watch.tuning)
        tuned: Any = with_certificate(robust.tuned, certify(robust.tuned.path, task.limits))
        return task, certificate, tuned, robust


def _limits(title: str, certificate: "RouteCertificate | None") -> list[layout.Part]:
    """Return the findings on the limits as text, or how to check limits if there is no certificate."""
    from qtraj.design.proof.limit_rows import route_limit_rows, violation_texts

    if certificate is None:
        return ["No limits were checked: to check limits, pass --limit NAME=VALUE, or write a scenario with [limits]."]
    table = layout.limits(title, route_limit_rows(certificate), "segments violated")
    return [table, *violation_texts(certificate)]
