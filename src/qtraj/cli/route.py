"""`qtraj route`: fits a route to a whole recording, and finds where it violates its limits."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer
from rich.console import Console
from rich.text import Text

from qtraj.cli import layout, terminal
from qtraj.cli.report import PAGE
from qtraj.cli.terminal import Outcome
from qtraj.foundation.progress_bar import watching

if TYPE_CHECKING:
    from qtraj.design.fitting.fitted_route import FittedRoute
    from qtraj.design.proof.route_certificate import RouteCertificate

SAMPLES_PER_SEGMENT, MIN_SAMPLES, MAX_SAMPLES = 8, 513, 20_001
"""Number of instants of the dataset: per segment, and its bounds."""
LISTED = 12
"""Maximum number of intervals that the terminal lists; it counts the others."""


def route(
    recording: Path | None = typer.Argument(
        None,
        metavar="RECORDING",
        help="A recording (CSV or TUM), or a scenario (TOML) that names one (default: the built-in scenario).",
    ),
    out: Path = terminal.out_option(),
    as_json: bool = terminal.json_option(),
) -> None:
    """Fit a route to a whole recorded drive or flight, and check limits along all of it.

    Stops, straight parts and gaps are allowed. Every limit of the scenario is proved or disproved on every segment.
    Writes a dataset (paths.nc), the route (route.json), the fit and the findings (fit.json, certificate.json), a map
    and plots (route.png, route.svg), and an HTML report (report.html). Exit code 1 if the fit fails or a limit is not
    proved.
    """
    with terminal.guarded():
        outcome = run(recording, out)
    terminal.finish(outcome, as_json)


def run(file: Path | None, out: Path) -> Outcome:
    """Fit the route, check its limits and write the results.

    **Raises:** OSError or ValueError for bad input, before anything is written.
    """
    with watching() as watch:
        watch.say("reading")
        # Imported here so that --help does not wait for pydantic and xarray.
        from qtraj.cli.output import check_folder, header, provenance, write_all
        from qtraj.design.proof.certify import certify
        from qtraj.foundation import document
        from qtraj.foundation.plain import plain
        from qtraj.io.dataset import path_dataset, write_netcdf
        from qtraj.path.driving import default_frame
        from qtraj.scenario.route import fit_recording, read_route

        check_folder(out)
        loaded = read_route(file)
        watch.say("fitting the route")
        task = fit_recording(loaded)
        path = task.fitted.path
        watch.say("checking the limits")
        certificate = None if task.limits is None else certify(path, task.limits)
        watch.say("sampling")
        dataset = path_dataset(
            {"route": path},
            task.limits,
            task.track,
            samples=int(np.clip(SAMPLES_PER_SEGMENT * path.segments + 1, MIN_SAMPLES, MAX_SAMPLES)),
            attributes=provenance(loaded) | {"route_result": task.fitted.result},
            frame=default_frame(path),
            findings=None if certificate is None else {"route": certificate.whole},
        )
        content = header("route", loaded) | {
            "fit": plain(task.fitted.record()) | summary(task.fitted),
            "frame": dataset.attrs["frame"],
            "purpose": loaded.scenario.purpose,
            "certificate": None if certificate is None else plain(certificate.record()),
        }

        def draw(target: Path) -> None:
            from qtraj.viz.figures import route_figure, save  # imported last, because matplotlib loads slowly

            save(route_figure(dataset), target)

        def page(target: Path) -> None:
            from qtraj.viz.report.page import report_page

            target.write_text(report_page(dataset), encoding="utf-8", newline="\n")

        watch.say("writing")
        writers = {
            "paths.nc": lambda target: write_netcdf(dataset, target),
            "route.json": path.save,
            "fit.json": partial(document.save, task.fitted),
            **({} if certificate is None else {"certificate.json": partial(document.save, certificate)}),
            "route.png": draw,
            "route.svg": draw,
            PAGE: page,
        }
        content["files"] = [str(written) for written in write_all(out, writers)]
    failed = not bool(task.fitted.successful) or (certificate is not None and not certificate.met)
    return Outcome(content, lambda console: _show(console, content, task.fitted, certificate), failed)


def summary(fitted: "FittedRoute") -> dict[str, Any]:
    """Length, number of segments and time at standstill of a fitted route."""
    standstill = np.diff(np.asarray(fitted.stops), axis=1).sum() if len(fitted.stops) else 0.0
    return {
        "length": float(fitted.path.length()),
        "segments": fitted.path.segments,
        "time_standing": float(standstill),
    }


def _show(
    console: Console, content: dict[str, Any], fitted: "FittedRoute", certificate: "RouteCertificate | None"
) -> None:
    """Print the result, readable at 80 columns."""
    layout.print_scenario(console, content["scenario"])
    layout.heading(console, "Route against the recording")
    console.print(layout.facts_table(_facts(fitted, content["fit"])))
    if certificate is None:
        console.print(Text("No limits were checked: to check limits, write a scenario with a table [limits]."))
    else:
        _show_limits(console, certificate, content["purpose"])
    layout.print_files(console, content["files"])


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
        rows.append(("gaps", f"{len(fitted.gaps)}, interpolated without data by minimum jerk"))
    if fitted.attitude is not None:
        rows.append(("recorded attitude", f"differs by {np.degrees(float(fitted.attitude.rms)):.2f}° RMS"))
    return rows


def _millimetres(length: Any) -> str:
    return f"{1000 * float(length):.3g} mm" if float(length) < 1 else f"{float(length):.3g} m"


def _show_limits(console: Console, certificate: "RouteCertificate", purpose: dict[str, str]) -> None:
    from qtraj.foundation.units import symbol
    from qtraj.path.quantity import quantity

    layout.heading(console, "Limits on the whole route")
    table = layout.plain_table("limit", right=("largest", "limit", "at [s]", "segments violated"), last=("",))
    status = certificate.segments.status
    for finding in certificate.findings():
        unit = symbol(quantity(finding.name).unit) or "-"
        value = finding.value if np.isfinite(finding.value) else None
        violated = int(np.sum(np.asarray(status[finding.name]) == "broken"))
        name, cells = Text(f"{finding.name} [{unit}]"), (layout.number(value), layout.number(finding.limit))
        table.add_row(name, *cells, layout.number(finding.time, 6), str(violated), layout.verdict(finding.status))
    console.print(table)
    for name, text in purpose.items():
        console.print(Text(f"{name}: {text}"))
    for name in certificate.names:
        spans = certificate.intervals(name)
        if spans:
            listed = ", ".join(f"{a:.2f}-{b:.2f}" for a, b in spans[:LISTED])
            more = f" and {len(spans) - LISTED} more" if len(spans) > LISTED else ""
            console.print(Text(f"{name} is violated at t [s] = {listed}{more}"))
