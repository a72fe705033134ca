"""Implement `qtraj tune`, which tunes boundary velocities so that a path satisfies its limits."""

from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console
from rich.text import Text

from qtraj.cli import layout, terminal
from qtraj.cli.terminal import FrameName, Outcome
from qtraj.design.tuning.choices import MOTIONS, OBJECTIVES, either
from qtraj.foundation.naming import naming
from qtraj.foundation.number_text import number
from qtraj.foundation.progress_bar import Watch
from qtraj.scenario import KINDS

if TYPE_CHECKING:  # type checkers cannot read names from a registry
    from qtraj.design.proof.certificate import Certificate
    from qtraj.design.tuning.outcome import Tuned
    from qtraj.foundation.folder import Writer
    from qtraj.path.change import PathChange
    from qtraj.scenario.path import PathTask
    from qtraj.scenario.path_parts import TunePart
    from qtraj.scenario.reader import ScenarioFile

    Motion = StrEnum
    Objective = StrEnum
else:  # enumerations, for shell completion
    Motion = StrEnum("Motion", {name: name for name in MOTIONS})
    Objective = StrEnum("Objective", {name: name for name in OBJECTIVES})

CAUSES = (
    "A limit may be too small or in the wrong unit. To keep the path near the original path, use tune.corridor or "
    "[tune.bounds]."
)


@terminal.command()
def tune(
    watch: Watch,
    scenario: Path | None = terminal.scenario_argument("path"),
    motion: Motion | None = typer.Option(
        None, metavar="MOTION", help=f"Overrides the scenario: {either(MOTIONS, '')}."
    ),
    objective: Objective | None = typer.Option(
        None, metavar="OBJECTIVE", help=f"Overrides the scenario: {either(OBJECTIVES, '')}."
    ),
    starts: int | None = typer.Option(
        None,
        min=1,
        metavar="N",
        help="Number of starting points: the specified states, and perturbations of them. Overrides the scenario.",
    ),
    frame: FrameName | None = terminal.frame_option(),
) -> Outcome:
    """Tune the boundary velocities of a path so that the path satisfies its limits.

    The command writes a labelled dataset of the original and the tuned path (paths.nc), the tuned path (path.toml), the
    complete result (tuning.toml) and a figure (tuning.png, tuning.svg). The exit code is 1 if a limit is not satisfied,
    or if a path does not fit its recording.
    """
    watch.say("reading")
    # Imported here, so that --help does not wait for pydantic and xarray.
    from qtraj.design.fitting.route_facts import facts_of
    from qtraj.foundation.plain import plain
    from qtraj.path.change import compare_paths
    from qtraj.scenario.reader import read_scenario

    loaded = read_scenario(scenario, "path")
    task, before, best = _tuned(loaded, (motion and motion.value, objective and objective.value, starts), watch)
    change = compare_paths(task.path, best.path, (task.start, task.end))
    content = {
        "fit": facts_of(task.fitted),
        "frame": (frame or FrameName.upright).value,
        "purpose": loaded.scenario.purpose,
        "before": plain(before.record()),
        "tuned": plain(best.record()),
        "change": plain(change.record()),
        "tuning": _tuning(task, best),
        "warning": change.warning and f"{change.warning} {CAUSES}",
    }
    fitted = task.fitted is None or bool(task.fitted.successful)
    met = fitted and best.converged and best.certificate.met
    show = partial(_show, task=task, before=before, best=best, change=change)
    return Outcome(content, show, loaded, not met, _files(loaded, content, task, before, best))


def _tuned(
    loaded: "ScenarioFile[Any]", overrides: tuple[str | None, str | None, int | None], watch: Watch
) -> tuple["PathTask", "Certificate", "Tuned"]:
    """Return the task of a scenario, the certificate of its path, and the result of the tuning.

    `overrides`: motion, objective and number of starts, which replace those of the scenario unless they are None.

    **Raises:** ValueError, which names the file, for bad input.
    """
    from qtraj.design.proof.certify import certify

    if not loaded.scenario.limits.limits():
        raise ValueError(f"{loaded.file}: the table [limits] is missing or empty, but tuning needs at least one limit")
    watch.say("fitting the recording" if loaded.scenario.track else "constructing the path")
    task: PathTask = KINDS["path"].build(loaded, *overrides)
    with naming(f"{loaded.file}: "):
        watch.say("checking the path")
        corridor = task.part.corridor
        before = certify(task.path, task.limits, corridor=corridor, reference=None if corridor is None else task.path)
        watch.say("tuning")
        return task, before, task.tuned(watch.tuning)


def _tuning(task: "PathTask", best: "Tuned") -> dict[str, Any]:
    """Return the settings and the result of the tuning as JSON types."""
    return {
        "objective": task.objective,
        "motion": task.motion,
        "method": task.part.method,
        "options": task.part.options,
        "fixed": list(task.part.fixed),
        "bounds": {name: list(bounds) for name, bounds in task.part.ranges.items()},
        "status": best.status,
        "result": best.result,
    }


def _files(
    loaded: "ScenarioFile[Any]", content: dict[str, Any], task: "PathTask", before: "Certificate", best: "Tuned"
) -> "dict[str, Writer]":
    """Return the writers of the files."""
    from qtraj.io.dataset import path_dataset
    from qtraj.viz import result_files
    from qtraj.viz.figures import tuning_figure  # imported after the computation, because matplotlib is slow to import

    about = {name: content["tuning"][name] for name in ("objective", "motion", "status", "result")}
    about |= {"fixed": ", ".join(task.part.fixed), "bounds": _ranges(task.part), "warning": content["warning"]}
    dataset = path_dataset(
        {"before": task.path, "after": best.path},
        task.limits,
        task.track,
        attributes=loaded.provenance() | {f"tuning_{name}": text for name, text in about.items() if text},
        fitted=task.fitted,
        frame=FrameName(content["frame"]).frame(),
        findings={"before": before, "after": best.certificate},
    )
    return {
        **result_files.netcdf("paths.nc", dataset),
        **result_files.documents({"path.toml": best.path, "tuning.toml": best}),
        **result_files.figure("tuning", tuning_figure(dataset)),
    }


def _ranges(part: "TunePart") -> str:
    """Describe the bounds of the variables; return an empty string if there are none."""
    texts = []
    for name, (low, high) in part.ranges.items():
        unit = "s" if name == "duration" else "m/s"
        if low is not None and high is not None:
            texts.append(f"{name} from {low:.6g} to {high:.6g} {unit}")
        else:
            texts.append(f"{name} {'at most' if low is None else 'at least'} {high if low is None else low:.6g} {unit}")
    return ", ".join(texts)


def _show(
    console: Console,
    content: dict[str, Any],
    task: "PathTask",
    before: "Certificate",
    best: "Tuned",
    change: "PathChange",
) -> None:
    """Print the fit, the limits, the changes and the result."""
    layout.print_fit(console, task.fitted)
    _show_limits(console, before, best.certificate)
    layout.print_purposes(console, content["purpose"])
    layout.heading(console, "Boundary velocities before and after")
    table = layout.plain_table("", right=("before", "after", "change"), last=("unit",))
    for group in change.rows():
        table.add_section()
        for name, *cells in group:
            table.add_row(Text(name), *map(Text, cells))
    console.print(table)
    console.print(Text("A: start, B: end. V_ρ, V_φ and V_h: away from, about and along the axis."))
    if change.given_text:
        console.print(Text(change.given_text))
    console.print(Text(f"The tuned path deviates from the original path by at most {float(change.deviation):.3g} m."))
    console.print(Text(change.text))
    layout.heading(console, f"Result: objective '{task.objective}', motion '{task.motion}'")
    for what, text in (("Fixed", ", ".join(task.part.fixed)), ("Bounded", _ranges(task.part))):
        if text:
            console.print(Text(f"{what}: {text}."))
    console.print(Text(best.result))
    if content["warning"]:
        console.print(Text(content["warning"], style="yellow"))


def _show_limits(console: Console, before: "Certificate", after: "Certificate") -> None:
    layout.heading(console, "Limits before and after")
    table = layout.plain_table("limit", "path", right=("value", "limit", "margin", "at [s]"), last=("",))
    for was, now in zip(before.findings(), after.findings(), strict=True):
        name, unit = now.label.split()
        for label, path, finding in ((name, "before", was), (unit, "after", now)):
            margin = "active" if finding.active else number(finding.limit - finding.value, 3, sign="+")
            numbers = number(finding.value), number(finding.limit), margin, number(finding.time, 4)
            table.add_row(Text(label), path, *numbers, layout.verdict(finding.status))
        table.add_section()
    console.print(table)
