"""`qtraj route`: a whole recording as a route, and where it breaks its limits."""

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
"""Instants of the dataset."""
LISTED = 12
"""More intervals are counted, not listed, on the terminal."""


def route(
    recording: Path | None = typer.Argument(
        None,
        metavar="RECORDING",
        help="A recording (CSV or TUM), or a scenario (TOML) with one. Without it: the embedded scenario.",
    ),
    out: Path = terminal.out_option(),
    as_json: bool = terminal.json_option(),
) -> None:
    """Fit a route to a whole recorded drive or flight, and check limits along all of it.

    Stops, straight parts and gaps are allowed. Every limit of the scenario is proved or disproved on every segment.
    Writes a dataset (paths.nc), the route (route.json), the fit and the findings (fit.json, certificate.json), a map
    and plots (route.png, route.svg), and a page for the browser (report.html). Exit code 1 if a limit is not proved.
    """
    with terminal.guarded():
        outcome = run(recording, out)
    terminal.finish(outcome, as_json)


def run(file: Path | None, out: Path) -> Outcome:
    """Fit, check and write.

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
        given = read_route(file)
        watch.say("fitting the route")
        task = fit_recording(given)
        path = task.fitted.path
        watch.say("checking the limits")
        certificate = None if task.limits is None else certify(path, task.limits)
        watch.say("sampling")
        dataset = path_dataset(
            {"route": path},
            task.limits,
            task.track,
            samples=int(np.clip(SAMPLES_PER_SEGMENT * path.segments + 1, MIN_SAMPLES, MAX_SAMPLES)),
            attributes=provenance(given) | {"route_result": task.fitted.result},
            frame=default_frame(path),
            findings=None if certificate is None else {"route": certificate.whole},
        )
        content = header("route", given) | {
            "fit": plain(task.fitted.record()) | summary(task.fitted),
            "frame": dataset.attrs["frame"],
            "purpose": given.scenario.purpose,
            "certificate": None if certificate is None else plain(certificate.record()),
        }

        def draw(target: Path) -> None:
            from qtraj.viz.figures import route_figure, save  # here, so that matplotlib is loaded last

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
    """Numbers of a fit that follow from the route."""
    standing = np.diff(np.asarray(fitted.stops), axis=1).sum() if len(fitted.stops) else 0.0
    return {
        "length": float(fitted.path.length()),
        "segments": fitted.path.segments,
        "time_standing": float(standing),
    }


def _show(
    console: Console, content: dict[str, Any], fitted: "FittedRoute", certificate: "RouteCertificate | None"
) -> None:
    """The outcome, readable at 80 columns."""
    layout.print_scenario(console, content["scenario"])
    layout.heading(console, "Route against the recording")
    console.print(layout.facts_table(_facts(fitted, content["fit"])))
    if certificate is None:
        console.print(Text("No limits were given: a scenario with a table [limits] has them checked."))
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
        ("distance", f"{_millimetres(residual.distance_rms)} RMS, {_millimetres(residual.maximum)} at most"),
        ("prediction error", f"{_millimetres(fitted.prediction_error)} RMS at samples that are left out"),
    ]
    if residual.velocity_rms is not None:
        rows.append(("velocity", f"differs by {float(residual.velocity_rms):.3g} m/s RMS"))
    if len(fitted.outliers):
        rows.append(("outliers", f"{len(fitted.outliers)} samples are left out"))
    if len(fitted.gaps):
        rows.append(("gaps", f"{len(fitted.gaps)}, bridged with the least jerk: a guess"))
    if fitted.attitude is not None:
        rows.append(("recorded attitude", f"differs by {np.degrees(float(fitted.attitude.rms)):.2f}° RMS"))
    return rows


def _millimetres(length: Any) -> str:
    return f"{1000 * float(length):.3g} mm" if float(length) < 1 else f"{float(length):.3g} m"


def _show_limits(console: Console, certificate: "RouteCertificate", purpose: dict[str, str]) -> None:
    from qtraj.foundation.units import symbol
    from qtraj.path.quantity import quantity

    layout.heading(console, "Limits on the whole route")
    table = layout.plain_table("limit", right=("largest", "limit", "at [s]", "segments broken"), last=("",))
    status = certificate.segments.status
    for found in certificate.findings():
        unit = symbol(quantity(found.name).unit) or "-"
        known = found.value if np.isfinite(found.value) else None
        broken = int(np.sum(np.asarray(status[found.name]) == "broken"))
        name, cells = Text(f"{found.name} [{unit}]"), (layout.number(known), layout.number(found.limit))
        table.add_row(name, *cells, layout.number(found.time, 6), str(broken), layout.verdict(found.status))
    console.print(table)
    for name, text in purpose.items():
        console.print(Text(f"{name}: {text}"))
    for name in certificate.names:
        spans = certificate.intervals(name)
        if spans:
            listed = ", ".join(f"{a:.2f}-{b:.2f}" for a, b in spans[:LISTED])
            more = f" and {len(spans) - LISTED} more" if len(spans) > LISTED else ""
            console.print(Text(f"{name} is broken at t [s] = {listed}{more}"))
