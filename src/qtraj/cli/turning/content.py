"""What `qtraj turn` has to say, as plain data: the JSON output, and what the tables on the terminal are made from."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from qtraj._version import __version__
from qtraj.cli.content import finite, scenario_content
from qtraj.cli.turning.job import Leg, least_duration, turn_limits
from qtraj.cli.turning.peaks import judged, judged_torque
from qtraj.io.attitude_part import radians
from qtraj.io.instants import Column
from qtraj.io.scenario import ScenarioFile
from qtraj.io.turn_model import JERKY, TurnScenario
from qtraj.motion.programs.euler_turn import EulerTurn, SlewSequence
from qtraj.motion.programs.slew_torque import peak_torque

STILL = "there is nothing to turn: all attitudes are the same."


def turn_content(
    given: ScenarioFile[TurnScenario],
    program: EulerTurn | SlewSequence,
    turns: Sequence[Leg],
    times: np.ndarray,
    columns: Mapping[str, Column],
) -> dict[str, Any]:
    """The whole outcome, of JSON's types only; angles in radians."""
    scenario = given.scenario
    names = ["max_rate", "max_acceleration", *(["max_jerk"] if scenario.law.kind not in JERKY else [])]
    limits = judged(turns, turn_limits(scenario.law, scenario.angles), names)
    if scenario.body is not None:
        limits |= judged_torque(peak_torque(program, scenario.body.inertia), scenario.body.max_torque)
    least = None if scenario.law.duration is None else least_duration(scenario, scenario.angles, program)
    content = {
        "qtraj": __version__,
        "command": "turn",
        "scenario": scenario_content(given),
        "law": scenario.law.kind,
        "turns": [_turn(leg) for leg in turns],
        "angle": sum(float(leg.profile.total) for leg in turns),
        "duration": turns[-1].end,
        "least_duration": least,
        "end": _end(scenario, turns[-1]),
        "notes": _notes(scenario, turns),
        "limits": limits,
        "met": all(entry["status"] != "broken" for entry in limits.values()),
        "result": _result(limits, least) if any(map(_moves, turns)) else STILL,
        "units": {"time": "s"} | {name: column.unit for name, column in columns.items()},
        "columns": {"time": times.tolist()} | {name: column.values.tolist() for name, column in columns.items()},
        "files": [],
    }
    return finite(content)


def _turn(leg: Leg) -> dict[str, Any]:
    return {
        "angle": float(leg.profile.total),
        "axis_body": np.asarray(leg.turn.axis("body")).tolist() if _moves(leg) else None,
        "axis_inertial": np.asarray(leg.turn.axis("inertial")).tolist() if _moves(leg) else None,
        "start": leg.start,
        "duration": float(leg.profile.duration),
        "switches": leg.switches,
    }


def _moves(leg: Leg) -> bool:
    """Whether there is anything to turn, and so an axis: with end rates a turn by no angle goes out and back."""
    return float(leg.profile.total) != 0 or not leg.profile.proportional


def _end(scenario: TurnScenario, last: Leg) -> dict[str, Any]:
    """The quaternion at which the program ends, and its sign against the given one."""
    reached = np.asarray(last.turn.end)
    wanted = scenario.end.unit_quaternion(scenario.angles)
    sign = 1 if wanted is None or float(reached @ np.asarray(wanted)) >= 0 else -1
    return {"quaternion": reached.tolist(), "sign": sign}


def _notes(scenario: TurnScenario, turns: Sequence[Leg]) -> list[str]:
    """What a reader of the scenario might not expect."""
    notes = []
    for k, (name, attitude) in enumerate(scenario.attitudes().items()):
        if (given := attitude.excess_turn(scenario.angles)) is not None:
            turned = "." if k == 0 else f": the turn to it is by {math.degrees(turns[k - 1].profile.total):.6g}°."
            notes.append(
                f"The rotation vector of [{name}] is {math.degrees(given):.6g}° long, more than a half turn. It is "
                f"the attitude that counts, reached by the shorter way{turned}"
            )
    ends = {"starts": scenario.law.start_rate, "ends": scenario.law.end_rate}
    moving = [f"{verb} at {_per_second(rate, scenario.angles)}" for verb, rate in ends.items() if rate]
    if moving:
        notes.append(f"The program {' and '.join(moving)}, but is at rest before and after: its rate jumps there.")
    return notes


def _per_second(rate: float, angles: str) -> str:
    return f"{math.degrees(radians(angles) * rate):.6g}°/s"


def _result(limits: dict[str, dict[str, Any]], least: float | None) -> str:
    broken = [name for name, entry in limits.items() if entry["status"] == "broken"]
    if broken:
        worst = ", ".join(
            f"{name} by {100 * (limits[name]['value'] / limits[name]['limit'] - 1):.3g} %" for name in broken
        )
        within = "" if least is None else f" Within the limits it takes {least:.9g} s or more."
        return f"limits are broken: {worst}.{within} Allow more time, or raise the limits."
    binding = [name for name, entry in limits.items() if entry["binding"]]
    if binding:
        return f"all limits are met; {_listed(binding)} {'binds' if len(binding) == 1 else 'bind'}."
    given = [name for name, entry in limits.items() if entry["limit"] is not None]
    spare = "" if least is None or math.isclose(least, 0.0) else f" The turn could be over in {least:.9g} s."
    return f"all limits are met, with room to spare.{spare}" if given else "there are no limits to meet."


def _listed(names: Sequence[str]) -> str:
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))
