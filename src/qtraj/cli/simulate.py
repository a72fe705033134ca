"""Implement `qtraj simulate`, which simulates a body that follows a program under feedback."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer
from rich.console import Console
from rich.text import Text

from qtraj.cli import layout, terminal
from qtraj.cli.terminal import FrameName, Outcome
from qtraj.foundation.naming import naming
from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.progress_bar import Watch, watching
from qtraj.scenario import KINDS

if TYPE_CHECKING:
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


def simulate(
    scenario: Path | None = terminal.scenario_argument("loop"),
    out: Path = terminal.out_option(),
    samples: int | None = typer.Option(
        None, min=2, max=100_000, metavar="N", help="Number of instants, including both ends; overrides the scenario."
    ),
    frame: FrameName | None = terminal.frame_option("the frame of the scenario, or upright"),
    open_loop: bool = typer.Option(
        False, "--open-loop", help="Also simulate the body without feedback, under the program's acceleration alone."
    ),
    as_json: bool = terminal.json_option(),
) -> None:
    """Simulate a body that follows an attitude program under a feedback law.

    The program is a slew, the frame of a path, or a saved program. Disturbance, sensor and actuator are optional. The
    error is compared with its closed form. The command writes the motion (solution.toml), its table (table.nc,
    table.csv) and a figure (simulation.png, simulation.svg). The exit code is 1 if the integration did not finish.
    """
    with terminal.guarded():
        outcome = run(scenario, out, samples, frame and frame.value, open_loop)
    terminal.finish(outcome, as_json)


def run(
    file: Path | None, out: Path, samples: int | None, frame: str | None = None, open_loop: bool = False
) -> Outcome:
    """Simulate a closed loop and, if `open_loop` is true, also the body without feedback; write the results.

    **Raises:** OSError or ValueError for bad input, before anything is written.
    """
    with watching() as watch:
        watch.say("reading")
        # Imported here, so that --help does not wait for pydantic, xarray and matplotlib.
        from qtraj.cli.output import check_folder, header, provenance, result_writers, tabular, write_all
        from qtraj.foundation.plain import plain
        from qtraj.foundation.record import to_dataset
        from qtraj.motion.simulation.actuator import Actuator
        from qtraj.scenario.reader import read_scenario
        from qtraj.viz.simulation_figure import simulation_figure

        check_folder(out)
        loaded = read_scenario(file, "loop")
        task, history, verdict = _simulated(loaded, samples, frame, watch, open_loop)
        table = history[np.searchsorted(history.times, task.times)]
        actuator = task.actuator or Actuator()
        limit = None if actuator.limit is None else np.asarray(actuator.limit).tolist()
        content = header("simulate", loaded) | {
            "program": {
                "description": loaded.scenario.program.describe(task.program),
                "duration": float(task.program.duration),
            },
            "law": {"kind": loaded.scenario.law.kind} | _gains(task),
            "start": {
                "quaternion": np.asarray(task.quaternion).tolist(),
                "rate": np.asarray(task.rate).tolist(),
                "sign": "far" if float(history.reference.quaternion[0] @ task.quaternion) < 0 else "near",
            },
            "duration": float(task.times[-1]),
            "command_limit": limit,
            "saturation": None if limit is None else actuator.saturation,
            "verdict": plain(verdict.record()),
            **_without_feedback(history),
            "finished": bool(history.solution.successful),
            "result": _result(history, verdict, loaded.scenario.error.sign),
            **tabular(table.record()),
            "files": [],
        }
        watch.say("writing")
        about = provenance(loaded) | {"law": content["law"]["kind"], "result": content["result"]}
        about["closed_form"] = "applies" if verdict.applies else f"does not apply: {verdict.reason}"
        about |= {} if limit is None else {"saturation": actuator.saturation}
        dataset = to_dataset(table.record(), about)
        if limit is not None:
            dataset["command"].attrs["limit"] = limit
        figure = simulation_figure(dataset, float(verdict.settled_angle), limit)
        writers = {"solution.toml": table.solution.save, **result_writers(dataset, figure, "simulation")}
        content["files"] = [str(file) for file in write_all(out, writers)]
    return Outcome(content, lambda console: _show(console, content, verdict), not content["finished"], loaded.warnings)


def _simulated(
    loaded: "ScenarioFile[Any]", samples: int | None, frame: str | None, watch: Watch, with_open_loop: bool = False
) -> tuple["LoopTask", "LoopHistory", "LoopVerdict"]:
    """Return the closed loop of a scenario, its motion, and its assessment; errors name the file of the scenario."""
    import qtraj.motion.simulation.simulate as simulation
    from qtraj.motion.simulation.loop_history import judging_times, loop_history, references_at
    from qtraj.motion.simulation.loop_verdict import SETTLED, judge_loop
    from qtraj.motion.simulation.open_loop import open_loop
    from qtraj.scenario.part import radians

    with naming(f"{loaded.file}: "):
        watch.say("preparing the program and the law")
        task: LoopTask = KINDS["loop"].build(loaded, samples, frame)
        watch.say("simulating")
        times = judging_times(task.times, task.jumps, task.renewals)
        references_at(task.program, times)  # raises before the simulation if an attitude is undefined
        loop = (task.program, task.law, task.quaternion, task.rate)
        around = (task.disturbance, task.sensor, task.actuator)
        tolerances: Any = {"rtol": task.rtol, "atol": task.atol}
        solution = simulation.simulate(*loop, times, *around, jumps=task.jumps, sign="as given", **tolerances)
        alone = None
        if with_open_loop:
            watch.say("simulating without feedback")
            start: Any = {"disturbance": task.disturbance, "jumps": task.jumps, "sign": "as given"}
            alone = open_loop(task.program, times, task.quaternion, task.rate, **start, **tolerances)
        history = loop_history(*loop, solution, alone)
    settled = loaded.scenario.simulation.settled
    angle = SETTLED if settled is None else radians(loaded.scenario.angles) * settled
    return task, history, judge_loop(history, task.law, *around, angle, **tolerances)


def _without_feedback(history: "LoopHistory") -> dict[str, Any]:
    """Return the final and the largest angle [rad] without feedback (None if not finite), or {} if not simulated."""
    if history.open_loop_angle is None:
        return {}
    angles = np.asarray(history.open_loop_angle)
    values = {"final_angle": angles[-1], "largest_angle": angles.max()}
    return {"open_loop": {name: float(x) if np.isfinite(x) else None for name, x in values.items()}}


def _gains(task: "LoopTask") -> dict[str, Any]:
    gains = {name: getattr(task.law, name, None) for name in ("k", "k1", "k2")}
    return {name: np.asarray(gain).tolist() for name, gain in gains.items() if gain is not None}


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


def _show(console: Console, content: dict[str, Any], verdict: "LoopVerdict") -> None:
    """Print scenario, results and files, with angles in degrees, for a terminal with 80 columns."""
    unit = "°/s" if verdict.commands == "rate" else "°/s²"
    layout.print_scenario(console, content["scenario"])
    layout.heading(console, "Closed loop")
    gains = ", ".join(f"{name} = {_gain(x)}" for name, x in content["law"].items() if name != "kind")
    loop = [
        ("program", f"{content['program']['description']}, {content['program']['duration']:.4f} s"),
        ("law", f"'{content['law']['kind']}', {gains}"),
        ("initial error", f"{layout.degrees(float(verdict.initial_angle))}°, {content['start']['sign']} sign of λ"),
        ("simulated", f"{content['duration']:.4f} s"),
    ]
    console.print(layout.facts_table(loop))
    if not verdict.stable:
        unstable = (
            f"The closed loop is unstable: with these gains the error grows as exp({float(verdict.growth):.4g} t)."
        )
        neutral = "The closed loop is not asymptotically stable: with these gains the error does not decay."
        console.print(Text(unstable if verdict.growth > 0 else neutral, style="bold red"))
    layout.heading(console, "Motion")
    console.print(layout.facts_table(_motion(content, content["verdict"], unit) + _alone(content)))
    if verdict.agrees is False:
        text = f"The deviation from the closed form exceeds {float(verdict.bound):.3g}, the largest value that the "
        advice = "tolerances explain. Use smaller simulation.rtol and simulation.atol."
        console.print(Text(text + advice, style="bold red"))
    _show_columns(console, content["columns"], verdict.applies, unit)
    layout.heading(console, "Result")
    console.print(Text(content["result"]))
    layout.print_files(console, content["files"])


def _motion(content: dict[str, Any], verdict: dict[str, Any], unit: str) -> list[tuple[str, str]]:
    settling, drift, least = verdict["settling_time"], verdict["norm_drift"], verdict["least_error"]
    when = "not settled" if settling is None else f"from {settling:.4f} s on"
    drifted = "" if drift is None else f", within {layout.number(drift, 3)} of its exact value"
    exactly = " in continuous time, from the closed form" if verdict["least_error_exact"] else ""
    error, lowest, highest = verdict["final_angle"], verdict["least_norm"], verdict["largest_norm"]
    return [
        ("final error", "-" if error is None else f"{layout.degrees(error)}°"),
        (f"within {layout.degrees(verdict['settled_angle'])}°", when),
        ("closed form", _closed(verdict)),
        ("largest command", _peak(verdict, unit, content["saturation"] == "axis")),
        ("limit of command", _limit(content["command_limit"], unit, content["saturation"])),
        ("|λ|", f"{layout.number(lowest)} to {layout.number(highest)}{drifted}"),
        ("smallest |μ|", "-" if least is None else f"{layout.number(least)}{exactly}"),
        ("evaluated at", f"{verdict['instants']} instants, more than in the table"),
    ]


def _alone(content: dict[str, Any]) -> list[tuple[str, str]]:
    if "open_loop" not in content:
        return []
    final = content["open_loop"]["final_angle"]
    return [("without feedback", "-" if final is None else f"{layout.degrees(final)}° from the program at the end")]


def _show_columns(console: Console, columns: dict[str, Any], applies: bool, unit: str) -> None:
    omitted = () if applies else ("closed_form_angle",)
    headers = {name: names for name, names in HEADERS.items() if name in columns and name not in omitted}
    values = {name: np.array(columns[name], dtype=float) for name in headers}
    for name in {"angle", "closed_form_angle", "open_loop_angle", "rate", "command"} & headers.keys():
        values[name] = np.degrees(values[name])
    values["command"] = np.linalg.norm(values["command"], axis=1)
    layout.heading(console, f"t [s], error angle [°], body rate ω [°/s], magnitude of the command [{unit}], |λ|")
    layout.print_instants(
        console, values, headers, significant=("angle", "closed_form_angle", "open_loop_angle", "command")
    )


def _closed(verdict: dict[str, Any]) -> str:
    if verdict["deviation"] is None:
        return verdict["closed_form"]
    relative = f"{layout.number(verdict['deviation'], 3)}, relative to the largest |μ|"
    return f"agrees within {relative}" if verdict["closed_form"] == "agrees" else f"differs from it by {relative}"


def _peak(verdict: dict[str, Any], unit: str, each_axis: bool) -> str:
    """Describe the largest magnitude of the command and, if `each_axis` is true, its largest components."""
    if verdict["peak_command"] is None:
        return "-"
    norm = f"{layout.degrees(verdict['peak_command'])} {unit} at {verdict['peak_time']:.6g} s"
    return f"{_degrees(verdict['peak_components'])} {unit} along x, y, z; magnitude {norm}" if each_axis else norm


def _limit(limit: float | list[float] | None, unit: str, saturation: str | None) -> str:
    if limit is None:
        return "none"
    if saturation == "norm":
        return f"{_degrees(limit)} {unit}, on the magnitude"
    return f"{_degrees(limit)} {unit} along {'x, y, z' if isinstance(limit, list) else 'each axis'}"


def _degrees(angles: float | list[float]) -> str:
    return ", ".join(map(layout.degrees, angles if isinstance(angles, list) else [angles]))


def _gain(value: Any) -> str:
    if isinstance(value, list):
        return "matrix" if isinstance(value[0], list) else "(" + ", ".join(f"{x:.4g}" for x in value) + ")"
    return f"{value:.6g}"
