"""Implement `qtraj retime`, which finds the fastest timing along a path and the limits that bound the speed."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import typer
from rich.console import Console
from rich.text import Text

from qtraj.cli import layout, terminal
from qtraj.cli.terminal import Outcome
from qtraj.foundation.naming import naming
from qtraj.foundation.progress_bar import Watch

if TYPE_CHECKING:
    from qtraj.design.proof.certificate import Certificate
    from qtraj.design.speed_profile import SpeedProfile
    from qtraj.design.timing.outcome import Retimed
    from qtraj.foundation.folder import Writer
    from qtraj.scenario.reader import ScenarioFile
    from qtraj.scenario.route import RouteTask


@terminal.command()
def retime(
    watch: Watch,
    scenario: Path | None = typer.Argument(
        None,
        metavar="SCENARIO",
        help="A scenario (TOML) of a path or a recorded drive, a recording (CSV or TUM), or a saved path (default: the "
        "built-in scenario).",
    ),
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
) -> Outcome:
    """Find the fastest timing along a path of given shape, and prove that the limits are satisfied on the whole path.

    The path joins two states, is fitted to a recording, or is read from a file, as in `qtraj tune` and `qtraj route`.
    With a table [tune], the path is tuned first. Stops of a drive keep their durations. Limits that do not affect the
    timing, such as the curvature, are checked on the result. The command writes a dataset
    (paths.nc), the retimed path (path.json), the whole result (retimed.json), the timing over time and distance
    (timing.nc, timing.csv), a figure (retime.png, retime.svg) and an HTML report (report.html). The exit code is 1 if a
    limit is not satisfied, the path does not fit its recording, the tuning fails, or an end speed cannot be reached.
    """
    watch.say("reading")
    from qtraj.scenario.route import read_retiming  # imported here, so that --help does not wait for pydantic

    limits = _limits(limit or [])
    loaded = read_retiming(scenario, limits)
    options = {"start_speed": start_speed, "end_speed": end_speed, "knots": knots}
    options = {name: value for name, value in options.items() if value is not None}
    result = _found(loaded, limits, options, watch)
    watch.say("sampling")
    solved = [x for x in (result.timed, result.certificate, result.tuned, result.task.fitted) if x is not None]
    failed = not all(bool(x.successful) for x in solved)
    return Outcome(_content(loaded, result), partial(_show, result=result), loaded, failed, _files(loaded, result))


def _limits(texts: list[str]) -> dict[str, float]:
    """Parse the values of the option --limit."""
    from qtraj.path.quantity import QUANTITIES

    limits = {}
    for text in texts:
        name, _, value = text.partition("=")
        if name in limits:
            raise ValueError(f"--limit {name} was given more than once")
        if name not in QUANTITIES:
            raise ValueError(f"--limit: unknown limit {name!r}; the limits are {', '.join(QUANTITIES)}")
        try:
            limits[name] = float(value)
        except ValueError:
            raise ValueError(f"--limit needs NAME=VALUE, such as speed=13.9, but {text!r} was given") from None
    return limits


class Found(NamedTuple):
    """The task, the tuning result or None, the retimed path, the certificate for all limits, and the speed profile."""

    task: "RouteTask"
    tuned: Any
    timed: "Retimed"
    certificate: "Certificate"
    profile: "SpeedProfile"


def _found(loaded: "ScenarioFile[Any]", limits: dict[str, float], chosen: dict[str, Any], watch: Watch) -> Found:
    from qtraj.design.speed_profile import speed_profile
    from qtraj.design.timing.retime import retime
    from qtraj.design.whole_certificate import whole_certificate
    from qtraj.scenario.route import retiming

    recorded = getattr(loaded.scenario, "track", None) is not None
    watch.say("fitting the recording" if recorded else "constructing the path")
    task = retiming(loaded, limits)
    own = {} if loaded.scenario is None else loaded.scenario.retime.model_dump(exclude={"shape"}, exclude_none=True)
    with naming(f"{loaded.file}: "):
        tuned = None
        if task.tuning is not None:
            watch.say("tuning")
            tuned = task.tuning(watch.tuning)
        watch.say("retiming")
        timed = retime(task.path if tuned is None else tuned.path, task.limits.on_timing(), **own | chosen)
        watch.say("checking the limits")
        return Found(task, tuned, timed, whole_certificate(timed, task.limits), speed_profile(timed))


def _content(loaded: "ScenarioFile[Any]", result: Found) -> dict[str, Any]:
    """Return the result as JSON types."""
    from qtraj.design.fitting.route_facts import facts_of
    from qtraj.foundation.plain import plain

    task, tuned, timed, certificate, profile = result
    return {
        "fit": facts_of(task.fitted),
        "purpose": getattr(loaded.scenario, "purpose", {}),
        "tuned": None if tuned is None else plain(tuned.record()),
        "retimed": plain(timed.record()),
        "certificate": plain(certificate.record()),
        "profile": plain(profile.record()),
        "result": timed.result,
    }


def _files(loaded: "ScenarioFile[Any]", result: Found) -> "dict[str, Writer]":
    """Return the writers of the files."""
    from qtraj.design.fitting.fitted import Fitted
    from qtraj.io.retimed_dataset import retimed_dataset
    from qtraj.path.trihedral import Upright
    from qtraj.viz import result_files
    from qtraj.viz.figures import speed_profile_figure  # imported here, because matplotlib is slow to import

    task, tuned, timed, certificate, profile = result
    fitted = task.fitted if isinstance(task.fitted, Fitted) else None
    about = loaded.provenance() | ({} if tuned is None else {"tuning_result": tuned.result})
    dataset = retimed_dataset(timed, task.limits, certificate, profile, task.track, fitted, Upright(), about)
    timing = profile.to_xarray({name: about[name] for name in ("title", "scenario_file") if name in about})
    return {
        **result_files.netcdf("paths.nc", dataset),
        **result_files.documents({"path.json": timed.path, "retimed.json": timed}),
        **result_files.table(timing, "timing"),
        **result_files.figure("retime", speed_profile_figure(timing)),
        **result_files.report(dataset),
    }


def _show(console: Console, content: dict[str, Any], result: Found) -> None:
    """Print the fit, the tuning, the limits and the result."""
    from qtraj.design.retimed_facts import retimed_fact_rows

    profile = result.profile
    layout.print_fit(console, result.task.fitted)
    if result.tuned is not None:
        layout.heading(console, "Tuning")
        console.print(Text(result.tuned.result))
    title = "Limits on the retimed path, and where they bound the speed"
    shares = {name: f"{100 * profile.share(name):.1f} %" for name in profile.names}
    layout.print_findings(console, title, result.certificate.findings(), "reached on", shares, digits_of_time=4)
    layout.print_purposes(console, content["purpose"])
    layout.print_facts(console, "Result", retimed_fact_rows(result.timed, profile))
    console.print(Text(result.timed.result))
