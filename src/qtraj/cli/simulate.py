"""Implement `qtraj simulate`, which simulates a body that follows a program under feedback."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer

from qtraj.cli import layout, terminal
from qtraj.cli.loop_advice import advice
from qtraj.cli.terminal import FrameName, Outcome
from qtraj.foundation.naming import naming
from qtraj.foundation.number_text import degrees
from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.progress_bar import Watch
from qtraj.scenario import KINDS

if TYPE_CHECKING:
    from qtraj.motion.simulation.actuator import Actuator
    from qtraj.motion.simulation.loop_history import LoopHistory
    from qtraj.motion.simulation.loop_verdict import LoopVerdict
    from qtraj.scenario.loop import LoopTask
    from qtraj.scenario.reader import ScenarioFile

SIZES = ("angle", "closed_form_angle", "open_loop_angle", "command")
"""Columns that span many orders of magnitude."""

RESULTS = {
    ResultCode.max_steps_reached: ("stopped: too many steps were needed between two instants."),
    ResultCode.step_too_small: (
        "stopped: the step size became too small for floating point, because the command grows without bound or the "
        "tolerances are too small."
    ),
    ResultCode.near_zero_error: "finished, but the error quaternion was near zero, where the command is large.",
    ResultCode.wrong_sign: (
        "stopped: the integration failed, and the error quaternion started with a negative scalar part (μ0 < 0). It "
        "probably came close to zero, where the law is undefined."
    ),
}
"""Texts of results, without advice."""


@terminal.command(
    "qtraj simulate  (the built-in scenario)",
    "qtraj simulate loop.toml --out results --json",
)
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

    The program is a slew, a spin, the frame of a path, a saved program, or a sequence of these. Inertia and wheels,
    disturbance, sensor and actuator are optional. The error is compared with its closed form. The command writes the
    motion (solution.toml), its table (table.nc, table.csv) and a figure (simulation.png, simulation.svg). The exit code
    is 1 if the integration did not finish.
    """
    watch.say("reading")
    # Imported here, so that --help does not wait for pydantic and xarray.
    from qtraj.motion.simulation.assess_loop import assess_loop
    from qtraj.scenario.reader import read_scenario

    loaded = read_scenario(scenario, "loop")
    with naming(f"{loaded.file}: "):
        watch.say("preparing the program and the law")
        task: LoopTask = KINDS["loop"].build(loaded, samples, frame and frame.value)
        watch.say("simulating with and without feedback" if open_loop else "simulating")
        history, verdict = assess_loop(**task.arguments(), without_feedback=open_loop)
    content = _content(loaded, task, history, verdict)
    from qtraj.viz.command_files import loop_files  # imported after the computation, because matplotlib is slow

    about = loaded.provenance() | {"law": content["law"]["kind"], "result": content["result"]}
    writers = loop_files(history.at(task.times), verdict, task.actuator, about, task.body)
    return Outcome(content, _text(content, verdict, task.actuator), loaded, not content["finished"], writers)


def _content(
    loaded: "ScenarioFile[Any]", task: "LoopTask", history: "LoopHistory", verdict: "LoopVerdict"
) -> dict[str, Any]:
    """Return the result as JSON types."""
    from qtraj.foundation.plain import plain, tabular
    from qtraj.motion.simulation.body_facts import body_facts
    from qtraj.motion.simulation.loop_facts import gains_of, limit_of

    angles, remedy = history.open_loop_angle, advice(loaded.scenario, task, verdict)
    motion = history.solution.body
    ends = {} if angles is None else {"final_angle": float(angles[-1]), "largest_angle": float(np.max(angles))}
    return {
        "program": {
            "description": loaded.scenario.program.describe(task.program),
            "duration": float(task.program.duration),
        },
        "law": {"kind": loaded.scenario.law.kind} | gains_of(task.law),
        "start": {
            "quaternion": np.asarray(task.quaternion).tolist(),
            "rate": np.asarray(task.rate).tolist(),
            "sign": "far" if float(history.reference.quaternion[0] @ task.quaternion) < 0 else "near",
        },
        "duration": float(task.times[-1]),
        **limit_of(task.actuator),
        "verdict": plain(verdict.record()),
        **({"open_loop": ends} if ends else {}),
        **({} if task.body is None or motion is None else {"body": body_facts(task.body, motion)}),
        "finished": bool(history.solution.successful),
        "result": _result(history, verdict, remedy),
        "advice": remedy,
        **tabular(history.at(task.times).record()),
    }


def _result(history: "LoopHistory", verdict: "LoopVerdict", remedy: str) -> str:
    """Return the text of the result, with advice if the simulation failed."""
    code = ResultCode(int(verdict.code))
    texts = RESULTS.get(code, verdict.result), history.solution.reached_text()
    return " ".join(filter(None, (texts[0], remedy if code in RESULTS else "", texts[1])))


def _text(content: dict[str, Any], verdict: "LoopVerdict", actuator: "Actuator | None") -> list[layout.Part]:
    """Return the loop and its motion as text, with angles in degrees."""
    from qtraj.motion.simulation import loop_facts
    from qtraj.motion.simulation.body_facts import body_fact_rows

    gains = loop_facts.gains_text({name: gain for name, gain in content["law"].items() if name != "kind"})
    loop = [
        ("program", f"{content['program']['description']}, {content['program']['duration']:.4f} s"),
        ("law", f"'{content['law']['kind']}', {gains}"),
        ("initial error", f"{degrees(float(verdict.initial_angle))}°, {content['start']['sign']} sign of λ"),
        ("simulated", f"{content['duration']:.4f} s"),
    ]
    without_feedback = content.get("open_loop", {}).get("final_angle")
    deviation = loop_facts.deviation_text(verdict)
    title, headers = loop_facts.motion_headers(verdict, "open_loop" in content)
    commands = np.linalg.norm(np.array(content["columns"]["command"], float), axis=1)
    return [
        layout.facts("Closed loop", loop),
        layout.styled(loop_facts.stability_text(verdict), layout.ALERT),
        layout.facts("Motion", loop_facts.loop_fact_rows(verdict, actuator, without_feedback)),
        *([layout.facts("Body", body_fact_rows(content["body"]))] if "body" in content else []),
        layout.styled(deviation and f"{deviation} {content['advice']}".rstrip(), layout.ALERT),
        *layout.instants(title, content["columns"] | {"command": commands}, content["units"], headers, SIZES),
        layout.heading("Result"),
        content["result"],
    ]
