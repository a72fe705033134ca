"""Implement `qtraj retime`, which finds the fastest timing along a path and the limits that bound the speed."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import typer

from qtraj.cli import layout, limit_option, terminal
from qtraj.cli.console import message
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


@terminal.command(
    "qtraj retime  (the built-in scenario)",
    "qtraj retime bus.toml --out results",
    "qtraj retime drive.csv --limit speed=13.9 --limit acceleration=2",
    "qtraj retime centre_line.csv --limit speed=60 --limit lateral_acceleration=15 --limit longitudinal_acceleration=8",
)
def retime(
    watch: Watch,
    scenario: Path | None = typer.Argument(
        None,
        metavar="SCENARIO",
        help="A scenario (TOML) of a path or a recorded drive, a recording, a curve without times (CSV, GPX, GeoJSON), "
        "or a saved path (default: the built-in scenario).",
    ),
    limit: list[str] | None = typer.Option(
        None,
        metavar="NAME=VALUE",
        help=limit_option.HELP,
    ),
    start_speed: float | None = typer.Option(
        None, metavar="V", help="Speed at the start in m/s, 0 for rest. Overrides the scenario."
    ),
    end_speed: float | None = typer.Option(
        None, metavar="V", help="Speed at the end in m/s, 0 for rest. Overrides the scenario."
    ),
    knots: int | None = typer.Option(
        None,
        metavar="N",
        help="Minimum number of timing cells between two stops, a power of two. Overrides the scenario.",
    ),
    track: dict[str, Any] | None = None,
) -> Outcome:
    """Find the fastest timing along a path of given shape, and prove that the limits are satisfied on the whole path.

    The path joins two states, is fitted to a recording, or is read from a file, as in `qtraj tune` and `qtraj route`.
    A curve without times, such as the centre line of a race track, needs no scenario; a closed one is timed as a flying
    lap, unless --start-speed or --end-speed is given. With a table `tune`, the path is tuned first. Stops of a drive
    keep their durations. Limits that the search does not support, such as the curvature, are checked on the result. The
    command writes a dataset (paths.nc), the retimed path (path.json), the whole result (retimed.json), the timing over
    time and distance (timing.nc, timing.csv), a figure (retime.png, retime.svg) and an HTML report (report.html). The
    exit code is 1 if a limit is not satisfied, the path does not fit its recording, the tuning or the search fails, or
    an end speed cannot be reached.
    """
    watch.say("reading")
    from qtraj.scenario.route import read_retiming  # imported here, so that --help does not wait for pydantic

    limits = limit_option.limits(limit)
    loaded = read_retiming(scenario, limits, track or {})
    options = {"start_speed": start_speed, "end_speed": end_speed, "knots": knots}
    options = {name: value for name, value in options.items() if value is not None}
    result = _retimed(loaded, limits, options, watch)
    watch.say("sampling")
    solved = [x for x in (result.timed, result.certificate, result.tuned, result.task.fitted) if x is not None]
    failed = not all(bool(x.successful) for x in solved)
    return Outcome(_content(loaded, result), _text(loaded, result), loaded, failed, _files(loaded, result))


class Result(NamedTuple):
    """The task, the tuning result or None, the retimed path, the certificate for all limits, and the speed profile."""

    task: "RouteTask"
    tuned: Any
    timed: "Retimed"
    certificate: "Certificate"
    profile: "SpeedProfile"


def _retimed(loaded: "ScenarioFile[Any]", limits: dict[str, Any], chosen: dict[str, Any], watch: Watch) -> Result:
    from qtraj.design.speed_profile import speed_profile
    from qtraj.design.timing.own_requirements import imposable
    from qtraj.design.timing.requirements import ACCELERATIONS
    from qtraj.design.timing.retime import retime
    from qtraj.design.whole_certificate import whole_certificate
    from qtraj.path.quantity import quantity
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
        given = {quantity(name).base or name for name in task.limits.on_timing().given()}
        if given and not set(ACCELERATIONS) & given:
            message(
                "note",
                "no limit bounds the acceleration along the path, so the speed may change as fast as the other limits "
                f"allow: consider a limit on {', '.join(ACCELERATIONS[:-1])} or {ACCELERATIONS[-1]}",
            )
        watch.say("retiming")
        path = task.path if tuned is None else tuned.path
        timed = retime(path, imposable(path, task.limits), **own | chosen)
        watch.say("checking the limits")
        return Result(task, tuned, timed, whole_certificate(timed, task.limits), speed_profile(timed))


def _content(loaded: "ScenarioFile[Any]", result: Result) -> dict[str, Any]:
    """Return the result as JSON types."""
    from qtraj.design.fitting.route_facts import facts_of
    from qtraj.foundation.plain import plain
    from qtraj.io.track.reading import recorded

    task, tuned, timed, certificate, profile = result
    return {
        "recording": recorded(task.recording),
        "shape": _shape(loaded),
        "fit": facts_of(task.fitted),
        "purpose": getattr(loaded.scenario, "purpose", {}),
        "tuned": None if tuned is None else plain(tuned.record()),
        "retimed": plain(timed.record()),
        "certificate": plain(certificate.record()),
        "profile": plain(profile.record()),
        "result": timed.result,
    }


def _shape(loaded: "ScenarioFile[Any]") -> dict[str, Any] | None:
    """Return what was read from a curve without times, and whether it is closed; None for other files."""
    if loaded.line is None:
        return None
    shape, facts, notes = loaded.line
    return {"closed": shape.closed, "length": float(shape.length), "facts": list(facts), "notes": list(notes)}


def _files(loaded: "ScenarioFile[Any]", result: Result) -> "dict[str, Writer]":
    """Return the writers of the files."""
    from qtraj.viz.command_files import retimed_files  # imported after the computation, because matplotlib is slow

    task, tuned, timed, certificate, profile = result
    about = loaded.provenance() | ({} if tuned is None else {"tuning_result": tuned.result})
    return retimed_files(timed, profile, task.limits, certificate, task.track, task.fitted, about)


def _text(loaded: "ScenarioFile[Any]", result: Result) -> list[layout.Part]:
    """Return the fit, the tuning, the limits and the result as text."""
    from qtraj.design.retimed_facts import retimed_fact_rows, retimed_limit_rows

    task, tuned, timed, certificate, profile = result
    limits = retimed_limit_rows(certificate, profile)
    closed = loaded.line is not None and loaded.line.shape.closed
    return [
        *layout.recording(task.recording),
        *layout.line(loaded.line),
        *layout.fit(task.fitted),
        *([] if tuned is None else [layout.heading("Tuning"), tuned.result]),
        layout.limits("Limits on the retimed path, and where they bound the speed", limits, "reached on"),
        *(f"{name}: {text}" for name, text in getattr(loaded.scenario, "purpose", {}).items()),
        layout.facts("Result", retimed_fact_rows(timed, profile, closed)),
        timed.result,
    ]
