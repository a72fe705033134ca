"""Simulate a closed loop at instants that are dense enough to assess it."""

from __future__ import annotations  # so that `help` shows short names

from typing import Any

import numpy as np

from qtraj.foundation.devices import of_one_device
from qtraj.foundation.types import ArrayInput
from qtraj.motion.attitude import AbstractProgram
from qtraj.motion.checks import initial_quaternion, output_times
from qtraj.motion.control.laws import AbstractLaw
from qtraj.motion.simulation.actuator import Actuator
from qtraj.motion.simulation.body import RigidBody
from qtraj.motion.simulation.disturbance import AbstractDisturbance
from qtraj.motion.simulation.initial_sign import NEARER, require_sign, start_quaternion
from qtraj.motion.simulation.loop import Loop, renewal_instants
from qtraj.motion.simulation.loop_history import LoopHistory, judging_times, loop_history, references_at
from qtraj.motion.simulation.loop_verdict import SETTLED, LoopVerdict, judge_loop
from qtraj.motion.simulation.open_loop import open_loop
from qtraj.motion.simulation.sensor import AbstractSensor
from qtraj.motion.simulation.simulate import simulate
from qtraj.motion.simulation.task import switches_of


@of_one_device
def assess_loop(
    program: AbstractProgram,
    law: AbstractLaw,
    quaternion: ArrayInput,
    rate: ArrayInput,
    times: ArrayInput,
    disturbance: AbstractDisturbance | None = None,
    sensor: AbstractSensor | None = None,
    actuator: Actuator | None = None,
    rtol: float = 1e-10,
    atol: float = 1e-12,
    *,
    sign: str = NEARER,
    body: RigidBody | None = None,
    settled: float = SETTLED,
    without_feedback: bool = False,
) -> tuple[LoopHistory, LoopVerdict]:
    """Simulate a closed loop and assess it: settling, peak command, and agreement with the closed form.

    The arguments up to `body` are as in `simulate`. `times` (n,) [s] start at 0. `settled` [rad]: the attitude error
    below which the loop counts as settled. If `without_feedback` is true, the motion under the acceleration of the
    program alone is also simulated; it does not depend on `body`.

    The result is the motion at `times` and at many more instants, and its assessment by `judge_loop`. To select the
    motion at `times`, use `history.at(times)`.

    **Raises:** ValueError in the same cases as `simulate`, and if the program is not defined at one of the instants.
    """
    require_sign(sign)
    times, actuator = output_times(times), Actuator() if actuator is None else actuator
    start = start_quaternion(sign, program(times[0]), initial_quaternion(quaternion))
    jumps = switches_of(program)
    renewals = renewal_instants(Loop(program, law, disturbance, sensor, actuator, body), times)
    dense = judging_times(np.asarray(times), *(None if x is None else np.asarray(x) for x in (jumps, renewals)))
    references_at(program, dense)  # raises before the simulation if an attitude is undefined
    options: Any = {"jumps": jumps, "rtol": rtol, "atol": atol, "sign": "as given"}
    solution = simulate(program, law, start, rate, dense, disturbance, sensor, actuator, body=body, **options)
    alone = None
    if without_feedback:
        alone = open_loop(program, dense, start, rate, disturbance=disturbance, **options)
    history = loop_history(program, law, start, rate, solution, alone)
    return history, judge_loop(history, law, disturbance, sensor, actuator, settled, rtol, atol, body=body)
