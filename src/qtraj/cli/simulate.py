"""Implement `qtraj simulate`, which simulates a body that follows a program under feedback."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer
from rich.console import Console
from rich.text import Text

from qtraj.cli import layout, terminal
from qtraj.cli.terminal import FrameName, Outcome
from qtraj.foundation.naming import naming
from qtraj.foundation.number_text import degrees
from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.progress_bar import Watch
from qtraj.scenario import KINDS

if TYPE_CHECKING:
    from qtraj.foundation.folder import Writer
    from qtraj.motion.simulation.actuator import Actuator
    from qtraj.motion.simulation.loop_history import LoopHistory
    from qtraj.motion.simulation.loop_verdict import LoopVerdict
    from qtraj.scenario.loop import LoopTask
    from qtraj.scenario.reader import ScenarioFile

HEADERS = {
    "time": ["t"],
    "angle": ["error"],
    "closed_form_angle": ["closed form"],
    "open_loop_angle": ["open loop"],
    "rate": ["ω1", "ω2", "ω3"],
    "command": ["command"],
    "norm": ["|λ|"],
}
SIZES = ("angle", "closed_form_angle", "open_loop_angle", "command")
"""Columns of angles and their derivatives that span many orders of magnitude."""
RESULTS = {
    ResultCode.successful: "finished: every instant was reached.",
    ResultCode.max_steps_reached: (
        "stopped: too many steps were needed between two instants. Use smaller gains, larger simulation.rtol and "
        "simulation.atol, or a shorter simulation.duration."
    ),
    ResultCode.step_too_small: (
        "stopped: the step size became too small for floating point, because the command grows without bound or the "
        "tolerances are too small. Use another initial [error], smaller gains, or larger simulation.rtol and "
        "simulation.atol."
    ),
    ResultCode.near_zero_error: "finished, but the error quaternion was near zero, where the command is large.",
    ResultCode.wrong_sign: (
        "stopped: the error quaternion started with a negative scalar part (μ0 < 0) and reached zero, where the law "
        "is undefined."
    ),
}
"""Text of each result, with advice that refers to keys of the scenario."""

OTHER_SIGN = (
    "λ and −λ represent the same attitude. Set sign = 'auto' in [error] to start from the sign whose error quaternion "
    "stays farther from zero."
)
NO_SIGN = (
    "The other sign of λ does not avoid this: use a smaller error.rate, other gains, or a law of kind 'quaternion', "
    "whose command is the same for λ and −λ."
)


@terminal.command()
def simulate(
    watch: Watch,
    scenario: Path | None = terminal.scenario_argument("loop"),
    samples: int | None = typer.Option(
        None, min=2, max=100_000, metavar="N", help="Number of instants, including both ends; overrides the scenario."
    ),
    frame: FrameName | None = terminal.frame_option("the frame of the scenario, or upright"),
    open_loop: bool = typer.Option(
        False, "--open-loop", help="Also simulate the body without feedback, under the program's acceleration alone."
    ),
) -> Outcome:
    """Simulate a body that follows an attitude program under a feedback law.

    The program is a slew, the frame of a path, or a saved program. Disturbance, sensor and actuator are optional. The
    error is compared with its closed form. The command writes the motion (solution.toml), its table (table.nc,
    table.csv) and a figure (simulation.png, simulation.svg). The exit code is 1 if the integration did not finish.
    """
    watch.say("reading")
    # Imported here, so that --help does not wait for pydantic and xarray.
    from qtraj.foundation.plain import plain, tabular
    from qtraj.motion.simulation.assess_loop import assess_loop
    from qtraj.motion.simulation.loop_facts import gains_of
    from qtraj.scenario.reader import read_scenario

    loaded = read_scenario(scenario, "loop")
    with naming(f"{loaded.file}: "):
        watch.say("preparing the program and the law")
        task: LoopTask = KINDS["loop"].build(loaded, samples, frame and frame.value)
        watch.say("simulating with and without feedback" if open_loop else "simulating")
        history, verdict = assess_loop(**task.arguments(), without_feedback=open_loop)
    table, angles = history.at(task.times), history.open_loop_angle
    ends = {} if angles is None else {"final_angle": float(angles[-1]), "largest_angle": float(np.max(angles))}
    content = {
        "program": {
            "description": loaded.scenario.program.describe(task.program),
            "duration": float(task.program.duration),
        },
        "law": {"kind": loaded.scenario.law.kind} | gains_of(task.law),
        "start": _start(task, history),
        "duration": float(task.times[-1]),
        **_actuator_limit(task.actuator),
        "verdict": plain(verdict.record()),
        **({"open_loop": ends} if ends else {}),
        "finished": bool(history.solution.successful),
        "result": _result(history, verdict, loaded.scenario.error.sign),
        **tabular(table.record()),
    }
    show = partial(_show, verdict=verdict, actuator=task.actuator)
    return Outcome(content, show, loaded, not content["finished"], _files(loaded, content, table, verdict))


def _start(task: "LoopTask", history: "LoopHistory") -> dict[str, Any]:
    """Return the initial attitude and rate, and whether the sign of the quaternion is the nearer one."""
    return {
        "quaternion": np.asarray(task.quaternion).tolist(),
        "rate": np.asarray(task.rate).tolist(),
        "sign": "far" if float(history.reference.quaternion[0] @ task.quaternion) < 0 else "near",
    }


def _actuator_limit(actuator: "Actuator | None") -> dict[str, Any]:
    """Return the limit of the command and how it is applied; the values are None without a limit."""
    if actuator is None or actuator.limit is None:
        return {"command_limit": None, "saturation": None}
    return {"command_limit": np.asarray(actuator.limit).tolist(), "saturation": actuator.saturation}


def _files(
    loaded: "ScenarioFile[Any]", content: dict[str, Any], table: "LoopHistory", verdict: "LoopVerdict"
) -> "dict[str, Writer]":
    """Return the writers of the files."""
    from qtraj.foundation.record import to_dataset
    from qtraj.viz import result_files
    from qtraj.viz.figures import simulation_figure  # imported here, because matplotlib is slow to import

    about = loaded.provenance() | {"law": content["law"]["kind"], "result": content["result"]}
    about["closed_form"] = "applies" if verdict.applies else f"does not apply: {verdict.reason}"
    limit = content["command_limit"]
    about |= {} if limit is None else {"saturation": content["saturation"]}
    dataset = to_dataset(table.record(), about)
    if limit is not None:
        dataset["command"].attrs["limit"] = limit
    return {
        **result_files.documents({"solution.toml": table.solution}),
        **result_files.table(dataset),
        **result_files.figure("simulation", simulation_figure(dataset, float(verdict.settled_angle), limit)),
    }


def _result(history: "LoopHistory", verdict: "LoopVerdict", sign: str) -> str:
    """Return the text of the result, with advice."""
    code = ResultCode(int(verdict.code))
    text = RESULTS.get(code, code.text)
    if code in (ResultCode.near_zero_error, ResultCode.wrong_sign):
        text = f"{text} {NO_SIGN if sign == 'auto' else OTHER_SIGN}"
    reached = history.times[np.isfinite(np.asarray(history.solution.quaternion)).all(axis=1)]
    if len(reached) == len(history.times):
        return text
    last = f"Last instant reached: t = {reached[-1]:.9g} s." if len(reached) else "No instant was reached."
    return f"{text} {last}"


def _show(console: Console, content: dict[str, Any], verdict: "LoopVerdict", actuator: "Actuator | None") -> None:
    """Print the loop and its motion, with angles in degrees."""
    from qtraj.motion.simulation.loop_facts import command_unit, gains_text, loop_fact_rows, stability_text

    gains = gains_text({name: gain for name, gain in content["law"].items() if name != "kind"})
    loop = [
        ("program", f"{content['program']['description']}, {content['program']['duration']:.4f} s"),
        ("law", f"'{content['law']['kind']}', {gains}"),
        ("initial error", f"{degrees(float(verdict.initial_angle))}°, {content['start']['sign']} sign of λ"),
        ("simulated", f"{content['duration']:.4f} s"),
    ]
    layout.print_facts(console, "Closed loop", loop)
    if text := stability_text(verdict):
        console.print(Text(text, style="bold red"))
    alone = []
    if "open_loop" in content:
        final = content["open_loop"]["final_angle"]
        alone = [("without feedback", f"{degrees(final)}° from the program at the end" if np.isfinite(final) else "-")]
    layout.print_facts(console, "Motion", loop_fact_rows(verdict, actuator) + alone)
    if verdict.agrees is False:
        text = f"The deviation from the closed form exceeds {float(verdict.bound):.3g}, the largest value that the "
        advice = "tolerances explain. Use smaller simulation.rtol and simulation.atol."
        console.print(Text(text + advice, style="bold red"))
    columns = content["columns"] | {"command": np.linalg.norm(np.array(content["columns"]["command"], float), axis=1)}
    omitted = () if verdict.applies else ("closed_form_angle",)
    headers = {name: names for name, names in HEADERS.items() if name in columns and name not in omitted}
    unit = command_unit(verdict)
    title = f"t [s], error angle [°], body rate ω [°/s], magnitude of the command [{unit}], |λ|"
    layout.print_instants(console, title, columns, headers, {*SIZES, "rate"}, significant=SIZES)
    layout.heading(console, "Result")
    console.print(Text(content["result"]))
