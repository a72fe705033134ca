"""Implement `qtraj retime`, which finds the fastest timing along a path and the limits that bound the speed."""

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

    from qtraj.design.proof.certificate import Certificate
    from qtraj.design.speed_profile import SpeedProfile
    from qtraj.design.timing.outcome import Retimed
    from qtraj.scenario.reader import ScenarioFile
    from qtraj.scenario.retime import RetimeTask

LISTED = 12
"""Maximum number of stops that are listed; the other stops are only counted."""


def retime(
    scenario: Path | None = typer.Argument(
        None,
        metavar="SCENARIO",
        help="A scenario (TOML) of a path or a recorded drive, a recording (CSV or TUM), or a saved path (default: the "
        "built-in scenario).",
    ),
    out: Path = terminal.out_option(),
    as_json: bool = terminal.json_option(),
    limit: list[str] | None = typer.Option(
        None, metavar="NAME=VALUE", help="A limit, such as speed=13.9, in SI units. Overrides the scenario; repeatable."
    ),
    start_speed: float | None = typer.Option(
        None, metavar="V", help="Speed at the start in m/s, 0 for rest. Overrides the scenario."
    ),
    end_speed: float | None = typer.Option(
        None, metavar="V", help="Speed at the end in m/s, 0 for rest. Overrides the scenario."
    ),
    knots: int | None = typer.Option(
        None, metavar="N", help="Number of cells of the timing, a power of two. Overrides the scenario."
    ),
) -> None:
    """Find the fastest timing along a path of given shape, and prove that the limits are satisfied on the whole path.

    The path joins two states, is fitted to a recording, or is read from a file, as in `qtraj tune` and `qtraj route`.
    With a table [tune], the path is tuned first. Stops of a drive keep their durations. The command writes a dataset
    (paths.nc), the retimed path (path.json), the whole result (retimed.json), the timing over time and distance
    (timing.nc, timing.csv), a figure (retime.png, retime.svg) and an HTML report (report.html). The exit code is 1 if a
    limit is not satisfied, the tuning fails, or an end speed cannot be reached.
    """
    with terminal.guarded():
        chosen = {"start_speed": start_speed, "end_speed": end_speed, "knots": knots}
        outcome = run(scenario, out, {k: v for k, v in chosen.items() if v is not None}, limit or [])
    terminal.finish(outcome, as_json)


def run(file: Path | None, out: Path, chosen: dict[str, Any], limits: list[str]) -> Outcome:
    """Retime the path of a scenario and write the results; `chosen` settings and `limits` override the scenario.

    **Raises:** OSError or ValueError for bad input, before anything is written.
    """
    with watching() as watch:
        watch.say("reading")
        # Imported here so that --help does not wait for pydantic and xarray.
        from qtraj.cli.output import check_folder, header, write_all
        from qtraj.foundation.plain import plain
        from qtraj.scenario.retime import read_retiming

        check_folder(out)
        more = _limits(limits)
        loaded = read_retiming(file)
        found = _found(loaded, more, chosen, watch)
        watch.say("sampling")
        dataset = _dataset(loaded, found)
        content = header("retime", loaded) | {
            "fit": _fit(found.task),
            "purpose": getattr(loaded.scenario, "purpose", {}),
            "tuned": None if found.tuned is None else plain(found.tuned.record()),
            "retimed": plain(found.timed.record()),
            "certificate": plain(found.certificate.record()),
            "profile": plain(found.profile.record()),
            "result": found.timed.result,
        }
        watch.say("writing")
        content["files"] = [str(written) for written in write_all(out, _writers(found, dataset))]
    solved = [found.timed, found.certificate, *([] if found.tuned is None else [found.tuned])]
    solved += [] if found.task.fitted is None else [found.task.fitted]
    failed = not all(bool(result.successful) for result in solved)
    return Outcome(content, lambda console: _show(console, content, found), failed, loaded.warnings)


def _limits(texts: list[str]) -> dict[str, float]:
    """Parse the values of the option --limit."""
    from qtraj.path.quantity import QUANTITIES

    limits = {}
    for text in texts:
        name, _, number = text.partition("=")
        try:
            limits[name] = float(number)
        except ValueError:
            raise ValueError(f"--limit needs NAME=VALUE, such as speed=13.9, but {text!r} was given") from None
        if name not in QUANTITIES:
            raise ValueError(f"--limit: unknown limit {name!r}; the limits are {', '.join(QUANTITIES)}")
    return limits


class Found(NamedTuple):
    """The task, the tuning result or None, the retimed path, the certificate for all limits, and the speed profile."""

    task: "RetimeTask"
    tuned: Any
    timed: "Retimed"
    certificate: "Certificate"
    profile: "SpeedProfile"


def _found(loaded: "ScenarioFile[Any]", more: dict[str, float], chosen: dict[str, Any], watch: Watch) -> Found:
    from qtraj.design.speed_profile import speed_profile
    from qtraj.design.timing.retime import retime
    from qtraj.scenario.retime import retiming

    recorded = getattr(loaded.scenario, "track", None) is not None
    watch.say("fitting the recording" if recorded else "constructing the path")
    task = retiming(loaded, more)
    own = {} if loaded.scenario is None else loaded.scenario.retime.model_dump(exclude={"shape"}, exclude_none=True)
    with naming(f"{loaded.file}: "):
        watch.say("tuning")
        tuned = None if task.tuning is None else task.tuning(watch.tuning)
        watch.say("retiming")
        timed = retime(task.path if tuned is None else tuned.path, task.limits_of(timing=True), **own | chosen)
        watch.say("checking the limits")
        return Found(task, tuned, timed, task.checked(timed), speed_profile(timed))


def _fit(task: "RetimeTask") -> dict[str, Any] | None:
    from qtraj.cli.route import summary
    from qtraj.design.fitting.facts import facts
    from qtraj.design.fitting.fitted import Fitted
    from qtraj.foundation.plain import plain

    if task.fitted is None or isinstance(task.fitted, Fitted):
        return None if task.fitted is None else facts(task.fitted)
    return plain(task.fitted.record()) | summary(task.fitted)


def _dataset(loaded: "ScenarioFile[Any]", found: Found) -> "xarray.Dataset":
    from qtraj.cli.output import provenance
    from qtraj.design.fitting.fitted import Fitted
    from qtraj.io.retimed_dataset import retimed_dataset
    from qtraj.path.trihedral import Upright

    about = {} if found.tuned is None else {"tuning_result": found.tuned.result}
    fitted = found.task.fitted if isinstance(found.task.fitted, Fitted) else None
    return retimed_dataset(
        found.timed,
        found.task.limits,
        found.certificate,
        found.profile,
        found.task.track,
        fitted,
        Upright(),
        provenance(loaded) | about,
    )


def _writers(found: Found, dataset: "xarray.Dataset") -> dict[str, Writer]:
    from qtraj.foundation import document
    from qtraj.io.dataset import write_netcdf
    from qtraj.io.instants_csv import csv_headers, write_csv

    titles = {name: dataset.attrs[name] for name in ("title", "scenario_file") if name in dataset.attrs}
    timing = found.profile.to_xarray(titles)
    over_time = timing[[name for name in timing.data_vars if timing[name].dims == ("time",)]]
    columns = {str(name): over_time[name].values for name in over_time.variables}

    def draw(target: Path) -> None:
        from qtraj.viz.figures import save, speed_profile_figure  # imported last, because matplotlib loads slowly

        save(speed_profile_figure(timing), target)

    def page(target: Path) -> None:
        from qtraj.viz.report.page import report_page

        target.write_text(report_page(dataset), encoding="utf-8", newline="\n")

    return {
        "paths.nc": partial(write_netcdf, dataset),
        "path.json": found.timed.path.save,
        "retimed.json": partial(document.save, found.timed),
        "timing.nc": partial(write_netcdf, timing),
        "timing.csv": partial(write_csv, columns, csv_headers(over_time)),
        "retime.png": draw,
        "retime.svg": draw,
        PAGE: page,
    }


def _show(console: Console, content: dict[str, Any], found: Found) -> None:
    """Print the results, readable at 80 columns."""
    from qtraj.cli.route import show_fit as show_route
    from qtraj.cli.tune import show_fit
    from qtraj.design.fitting.fitted_route import FittedRoute

    layout.print_scenario(console, content["scenario"])
    if isinstance(found.task.fitted, FittedRoute):
        show_route(console, found.task.fitted, content["fit"])
    elif content["fit"] is not None:
        show_fit(console, content["fit"])
    if found.tuned is not None:
        layout.heading(console, "Tuning")
        console.print(Text(found.tuned.result))
    _show_limits(console, found)
    for name, text in content["purpose"].items():
        console.print(Text(f"{name}: {text}"))
    layout.heading(console, "Result")
    console.print(layout.facts_table(_facts(found)))
    console.print(Text(found.timed.result))
    layout.print_files(console, content["files"])


def _show_limits(console: Console, found: Found) -> None:
    from qtraj.foundation.units import symbol
    from qtraj.path.quantity import quantity

    layout.heading(console, "Limits on the retimed path, and where they bound the speed")
    table = layout.plain_table("limit", right=("largest", "limit", "at [s]", "reached on"), last=("",))
    for finding in found.certificate.findings():
        unit = symbol(quantity(finding.name).unit) or "-"
        timed = finding.name in found.profile.names
        share = f"{100 * found.profile.share(finding.name):.1f} %" if timed else "-"
        value = layout.number(finding.value if np.isfinite(finding.value) else None)
        cells = value, layout.number(finding.limit), layout.number(finding.time, 4), share
        table.add_row(Text(f"{finding.name} [{unit}]"), *cells, layout.verdict(finding.status))
    console.print(table)


def _facts(found: Found) -> list[tuple[str, str]]:
    profile = found.profile
    length, (before, after) = float(profile.distance[-1]), np.asarray(profile.durations).tolist()
    start, end = np.asarray(found.timed.speeds).tolist()
    rows = [
        ("duration", f"{after:.4f} s instead of {before:.4f} s"),
        ("length", f"{length:.2f} m, at {length / after:.2f} m/s on average"),
        ("speed", f"{start:.3f} m/s at the start, {end:.3f} m/s at the end"),
    ]
    stops = [(a, b) for a, b in np.asarray(profile.stops).tolist() if b > a]
    if stops:
        listed = ", ".join(f"{a:.2f}-{b:.2f}" for a, b in stops[:LISTED])
        more = f" and {len(stops) - LISTED} more" if len(stops) > LISTED else ""
        rows.append(("stops", f"{len(stops)}, at t [s] = {listed}{more}"))
    return rows
