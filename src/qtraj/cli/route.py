"""Implement `qtraj route`, which fits a route to a whole recording, checks its limits and tunes it."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import typer
from rich.console import Console
from rich.text import Text

from qtraj.cli import layout, terminal
from qtraj.cli.report import PAGE
from qtraj.cli.terminal import Outcome
from qtraj.foundation.folder import Writer
from qtraj.foundation.naming import naming
from qtraj.foundation.progress_bar import Watch, watching

if TYPE_CHECKING:
    import xarray

    from qtraj.design.fitting.fitted_route import FittedRoute
    from qtraj.design.proof.route_certificate import RouteCertificate
    from qtraj.design.tuning_route.tuned_route import TunedRoute
    from qtraj.scenario.reader import ScenarioFile
    from qtraj.scenario.route import RouteTask

SAMPLES_PER_SEGMENT, MIN_SAMPLES, MAX_SAMPLES = 8, 513, 20_001
"""Number of instants of the dataset for each segment, and bounds on the total number of instants."""
LISTED = 12
"""Maximum number of intervals that are listed; the other intervals are only counted."""


def route(
    recording: Path | None = typer.Argument(
        None,
        metavar="RECORDING",
        help="A recording (CSV or TUM), or a scenario (TOML) with a recording (default: the built-in scenario).",
    ),
    out: Path = terminal.out_option(),
    as_json: bool = terminal.json_option(),
) -> None:
    """Fit a route to a whole recorded drive or flight, check limits, and tune the route so that they are satisfied.

    Stops, straight segments and gaps are allowed. For each limit of the scenario, the command determines on every
    segment whether the limit is proved to be satisfied, violated, undecided, or undefined. If the scenario has a table
    `tune`, the route is changed within a tube until every limit is proved to be satisfied on the changed segments. The
    command writes a dataset (paths.nc), the route, the fit and the findings (route.json, fit.json, certificate.json),
    the tuning (tuning.json), a map and plots (route.png, route.svg), and an HTML report (report.html). The exit code is
    1 if a limit is not proved to be satisfied; after tuning, a limited quantity may be undefined at stops.
    """
    with terminal.guarded():
        outcome = run(recording, out)
    terminal.finish(outcome, as_json)


def run(file: Path | None, out: Path) -> Outcome:
    """Fit a route to a recording, check its limits, tune it and write the results.

    **Raises:** OSError or ValueError for bad input, before anything is written.
    """
    with watching() as watch:
        watch.say("reading")
        # Imported here, so that --help does not wait for pydantic and xarray.
        from qtraj.cli.output import check_folder, header, write_all
        from qtraj.foundation.plain import plain
        from qtraj.scenario.route import read_route

        check_folder(out)
        given = read_route(file)
        findings = _findings(given, watch)
        fitted, certificate, tuned = findings.task.fitted, findings.certificate, findings.tuned
        watch.say("sampling")
        dataset = _dataset(given, findings)
        content = header("route", given) | {
            "fit": plain(fitted.record()) | summary(fitted),
            "frame": dataset.attrs["frame"],
            "purpose": given.scenario.purpose,
            "certificate": None if certificate is None else plain(certificate.record()),
            "tuned": None if tuned is None else plain(tuned.record()),
        }
        watch.say("writing")
        content["files"] = [str(written) for written in write_all(out, _writers(findings, dataset))]
    checked = certificate if tuned is None else tuned
    failed = not bool(fitted.successful) or (checked is not None and not bool(checked.successful))
    return Outcome(content, lambda console: _show(console, content, findings), failed)


class Findings(NamedTuple):
    """The fitted route, its certificate (None without limits) and the tuned route (None without tuning)."""

    task: "RouteTask"
    certificate: "RouteCertificate | None" = None
    tuned: "TunedRoute | None" = None


def _findings(given: "ScenarioFile[Any]", watch: Watch) -> Findings:
    from qtraj.design.proof.certify import certify
    from qtraj.scenario.route import fit_recording

    watch.say("fitting the route")
    task = fit_recording(given)
    if task.limits is None:
        return Findings(task)
    watch.say("checking the limits")
    certificate = certify(task.fitted.path, task.limits)
    if task.tune is None:
        return Findings(task, certificate)
    watch.say("tuning")
    with naming(f"{given.file}: "):
        tuned = task.tuned()
    return Findings(task, certificate, tuned)


def _dataset(given: "ScenarioFile[Any]", findings: Findings) -> "xarray.Dataset":
    from qtraj.cli.output import provenance
    from qtraj.io.dataset import path_dataset

    task, certificate, tuned = findings
    path, about = task.fitted.path, {"route_result": task.fitted.result}
    paths, certificates = {"route": path}, {} if certificate is None else {"route": certificate.whole}
    if tuned is not None and certificate is not None:
        paths, about = {"before": path, "after": tuned.path}, about | {"tuning_result": tuned.result}
        certificates = {"before": certificate.whole, "after": tuned.certificate.whole}
    return path_dataset(
        paths,
        task.limits,
        task.track,
        samples=int(np.clip(SAMPLES_PER_SEGMENT * path.segments + 1, MIN_SAMPLES, MAX_SAMPLES)),
        attributes=provenance(given) | about,
        findings=certificates,
    )


def _writers(findings: Findings, dataset: "xarray.Dataset") -> dict[str, Writer]:
    from qtraj.foundation import document
    from qtraj.io.dataset import write_netcdf

    def draw(target: Path) -> None:
        from qtraj.viz.figures import route_figure, save  # imported last, because matplotlib loads slowly

        save(route_figure(dataset), target)

    def page(target: Path) -> None:
        from qtraj.viz.report.page import report_page

        target.write_text(report_page(dataset), encoding="utf-8", newline="\n")

    task, certificate, tuned = findings
    documents = {
        "route.json": task.fitted.path if tuned is None else tuned.path,
        "fit.json": task.fitted,
        "certificate.json": certificate if tuned is None else tuned.certificate,
        "tuning.json": tuned,
    }
    return {
        "paths.nc": lambda target: write_netcdf(dataset, target),
        **{name: partial(document.save, item) for name, item in documents.items() if item is not None},
        "route.png": draw,
        "route.svg": draw,
        PAGE: page,
    }


def summary(fitted: "FittedRoute") -> dict[str, Any]:
    """Return the length [m], the number of segments and the time at standstill [s] of a fitted route."""
    standstill = np.diff(np.asarray(fitted.stops), axis=1).sum() if len(fitted.stops) else 0.0
    return {
        "length": float(fitted.path.length()),
        "segments": fitted.path.segments,
        "time_standing": float(standstill),
    }


def _show(console: Console, content: dict[str, Any], findings: Findings) -> None:
    """Print scenario, results and files, for a terminal with 80 columns."""
    task, certificate, tuned = findings
    layout.print_scenario(console, content["scenario"])
    show_fit(console, task.fitted, content["fit"])
    if certificate is None:
        console.print(Text("No limits were checked: to check limits, write a scenario with a table [limits]."))
    else:
        _show_limits(console, "Limits on the whole route", certificate)
    if tuned is not None:
        _show_limits(console, "Limits on the tuned route", tuned.certificate)
        console.print(Text(tuned.result))
    for name, text in content["purpose"].items():
        console.print(Text(f"{name}: {text}"))
    layout.print_files(console, content["files"])


def show_fit(console: Console, fitted: "FittedRoute", fit: dict[str, Any]) -> None:
    """Print how well the fitted route follows its recording."""
    layout.heading(console, "Route against the recording")
    console.print(layout.facts_table(_facts(fitted, fit)))


def _facts(fitted: "FittedRoute", fit: dict[str, Any]) -> list[tuple[str, str]]:
    residual = fitted.residual
    spacing = float(fitted.path.duration) / fit["segments"]
    rows = [
        ("length", f"{fit['length'] / 1000:.3f} km in {float(fitted.path.duration):.2f} s"),
        ("segments", f"{fit['segments']}, {spacing:.3g} s each on average"),
        ("stops", f"{len(fitted.stops)}, {fit['time_standing']:.1f} s in total"),
        ("distance", f"{_millimetres(residual.distance_rms)} RMS, {_millimetres(residual.maximum)} maximum"),
        ("prediction error", f"{_millimetres(fitted.prediction_error)} RMS at held-out samples"),
    ]
    if residual.velocity_rms is not None:
        rows.append(("velocity", f"differs by {float(residual.velocity_rms):.3g} m/s RMS"))
    if len(fitted.outliers):
        rows.append(("outliers", f"{len(fitted.outliers)} samples, excluded from the fit"))
    if len(fitted.gaps):
        rows.append(("gaps", f"{len(fitted.gaps)}, bridged with minimum jerk"))
    if fitted.attitude is not None:
        rows.append(("recorded attitude", f"differs by {np.degrees(float(fitted.attitude.rms)):.2f}° RMS"))
    if fitted.rates is not None:
        values = zip(np.atleast_1d(fitted.rates.rms), np.atleast_1d(fitted.rates.correlation), strict=True)
        texts = [f"{rms:.4f} ({correlation:.3f})" for rms, correlation in values]
        axes = "x, y, z" if len(texts) == 3 else "yaw"
        rows.append(("recorded rates", f"differ by {', '.join(texts)} rad/s RMS (correlation), {axes}"))
    return rows


def _millimetres(length: Any) -> str:
    return f"{1000 * float(length):.3g} mm" if float(length) < 1 else f"{float(length):.3g} m"


def _show_limits(console: Console, title: str, certificate: "RouteCertificate") -> None:
    from qtraj.foundation.units import symbol
    from qtraj.path.quantity import quantity

    layout.heading(console, title)
    table = layout.plain_table("limit", right=("largest", "limit", "at [s]", "segments violated"), last=("",))
    status = certificate.segments.status
    for finding in certificate.findings():
        unit = symbol(quantity(finding.name).unit) or "-"
        value = finding.value if np.isfinite(finding.value) else None
        violated = int(np.sum(np.asarray(status[finding.name]) == "broken"))
        name, cells = Text(f"{finding.name} [{unit}]"), (layout.number(value), layout.number(finding.limit))
        table.add_row(name, *cells, layout.number(finding.time, 6), str(violated), layout.verdict(finding.status))
    console.print(table)
    for name in certificate.names:
        spans = certificate.intervals(name)
        if spans:
            listed = ", ".join(f"{a:.2f}-{b:.2f}" for a, b in spans[:LISTED])
            more = f" and {len(spans) - LISTED} more" if len(spans) > LISTED else ""
            console.print(Text(f"the limit on {name} is violated at t [s] = {listed}{more}"))
