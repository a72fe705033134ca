"""Implement `qtraj tune`, which tunes boundary velocities so that a path satisfies its limits."""

from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import typer

from qtraj.cli import layout, terminal
from qtraj.cli.margins import margins, with_certificate
from qtraj.cli.terminal import FrameName, Outcome
from qtraj.design.tuning.choices import MOTIONS, OBJECTIVES, either
from qtraj.foundation.naming import naming
from qtraj.foundation.progress_bar import Watch
from qtraj.path.frame_axes import UPRIGHT
from qtraj.scenario import KINDS

if TYPE_CHECKING:  # type checkers cannot read names from a registry
    from qtraj.design.proof.certificate import Certificate
    from qtraj.design.robust.box_outcome import BoxTuned
    from qtraj.design.robust.outcome import RobustTuned
    from qtraj.design.tuning.outcome import Tuned
    from qtraj.foundation.folder import Writer
    from qtraj.path.change import PathChange
    from qtraj.scenario.path import PathTask
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


@terminal.command(
    "qtraj tune  (the built-in scenario)",
    "qtraj tune turn.toml --out results",
    "qtraj tune turn.toml --objective fastest --motion hermite",
)
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
        help="Number of starting points: the specified states and perturbed states. Overrides the scenario.",
    ),
    frame: FrameName | None = terminal.frame_option(),
    track: dict[str, Any] | None = None,
) -> Outcome:
    """Tune the boundary velocities of a path so that the path satisfies its limits.

    The command writes a labelled dataset of the original and the tuned path (paths.nc), the tuned path (path.toml), the
    complete result (tuning.toml) and a figure (tuning.png, tuning.svg). The exit code is 1 if a limit is not satisfied,
    the tuning does not converge, or the path does not fit its recording.

    With a table `spread` or `box` of deviations, the command tightens the limits, so that they are satisfied with a
    stated probability, or for all deviations. It then also writes the result of `qtraj.robust_tune` (robust.toml).
    """
    watch.say("reading")
    # Imported here, so that --help does not wait for pydantic and xarray.
    from qtraj.design.fitting.route_facts import facts_of
    from qtraj.design.tuning.box import bounds_text
    from qtraj.foundation.plain import plain
    from qtraj.io.track.reading import recorded
    from qtraj.scenario.reader import read_scenario

    loaded = read_scenario(scenario, "path", track or {})
    result = _tuned(loaded, (motion and motion.value, objective and objective.value, starts), watch)
    task, before, best, change, robust = result
    content = {
        "recording": recorded(task.recording),
        "fit": facts_of(task.fitted),
        "frame": str(frame or UPRIGHT),
        "purpose": loaded.scenario.purpose,
        "before": plain(before.record()),
        "tuned": plain(best.record()),
        "change": plain(change.record()),
        "tuning": _tuning(task, best),
        **({} if robust is None else {"robust": margins(robust)}),
        "warning": change.warning and f"{change.warning} {CAUSES}",
    }
    fitted = task.fitted is None or bool(task.fitted.successful)
    met = fitted and best.converged and best.certificate.met and (robust is None or bool(robust.successful))
    restrictions = {"fixed": ", ".join(task.part.fixed), "bounds": bounds_text(task.part.ranges)}
    writers = _files(loaded, content, restrictions, result)
    return Outcome(content, _text(content, restrictions, result), loaded, not met, writers)


class Result(NamedTuple):
    """The task of a scenario, the certificate of its path, the result of the tuning, and the change of the path.

    `robust`: the result of a tuning with margins; the certificate of `best` is that of the limits without margins.
    """

    task: "PathTask"
    before: "Certificate"
    best: "Tuned"
    change: "PathChange"
    robust: "RobustTuned | BoxTuned | None"


def _tuned(loaded: "ScenarioFile[Any]", overrides: tuple[str | None, str | None, int | None], watch: Watch) -> Result:
    """Check and tune the path of a scenario.

    `overrides`: motion, objective and number of starts; each value that is not None replaces the value of the scenario.

    **Raises:** ValueError, which names the file, for bad input.
    """
    from qtraj.design.proof.certify import certify
    from qtraj.path.change import compare_paths

    if not (loaded.scenario.limits.limits() or loaded.scenario.limits.keep_out):
        raise ValueError(f"{loaded.file}: the table [limits] is missing or empty, but tuning needs at least one limit")
    watch.say("fitting the recording" if loaded.scenario.track else "constructing the path")
    task: PathTask = KINDS["path"].build(loaded, *overrides)
    with naming(f"{loaded.file}: "):
        watch.say("checking the path")
        corridor = task.part.corridor
        reference = None if corridor is None else task.path
        check = partial(certify, limits=task.limits, corridor=corridor, reference=reference)
        before = check(task.path)
        watch.say("tuning")
        robust = task.robust_tuned(watch.tuning)
        best = task.tuned(watch.tuning) if robust is None else with_certificate(robust.tuned, check(robust.tuned.path))
        return Result(task, before, best, compare_paths(task.path, best.path, (task.start, task.end)), robust)


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
    loaded: "ScenarioFile[Any]", content: dict[str, Any], restrictions: dict[str, str], result: Result
) -> "dict[str, Writer]":
    """Return the writers of the files."""
    from qtraj.motion.programs.rotation_minimizing import frame_named
    from qtraj.viz.command_files import tuned_files  # imported after the computation, because matplotlib is slow
    from qtraj.viz.result_files import documents

    task, before, best, _, robust = result
    facts = {name: content["tuning"][name] for name in ("objective", "motion", "status", "result")}
    facts |= restrictions | {"warning": content["warning"]}
    about = loaded.provenance() | {f"tuning_{name}": text for name, text in facts.items() if text}
    frame = frame_named(content["frame"])
    if robust is not None:
        about["tuning_robust"] = robust.result
    files = tuned_files(task.path, before, best, task.limits, frame, task.track, task.fitted, about)
    return files | documents({"robust.toml": robust})


def _text(content: dict[str, Any], restrictions: dict[str, str], result: Result) -> list[layout.Part]:
    """Return the fit, the limits, the changes and the result as text."""
    from qtraj.design.proof.limit_rows import limit_change_rows

    task, before, best, change, robust = result
    limits = limit_change_rows(before, best.certificate)
    columns = ("value", "limit", "margin", "at [s]")
    velocities = "Boundary velocities before and after"
    return [
        *layout.recording(task.recording),
        *layout.fit(task.fitted),
        layout.grouped_table("Limits before and after", limits, "limit", "path", right=columns),
        *(f"{name}: {text}" for name, text in content["purpose"].items()),
        layout.grouped_table(velocities, change.rows(), "", right=("before", "after", "change"), last=("unit",)),
        *change.sentences(),
        layout.heading(f"Result: objective '{task.objective}', motion '{task.motion}'"),
        restrictions["fixed"] and f"Fixed: {restrictions['fixed']}.",
        restrictions["bounds"] and f"Bounded: {restrictions['bounds']}.",
        best.result if robust is None else robust.result,
        layout.styled(content["warning"], layout.NOTE),
    ]
