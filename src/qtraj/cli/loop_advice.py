"""Advise on a simulated loop that failed, or deviates from its closed form; each change is simulated first."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from qtraj.foundation.outcome import ResultCode

if TYPE_CHECKING:
    from qtraj.motion.simulation.loop_verdict import LoopVerdict
    from qtraj.scenario.loop import LoopScenario, LoopTask

FINER, COARSER = 1e-2, 1e4
"""Factors of the tolerances that are tried."""
SMALLEST, LARGEST = (1e-14, 1e-16), 1e-2
"""Limits on the tolerances rtol and atol in a scenario."""
SETTLED_BY = 0.5
"""Gains that are tried settle the loop within this fraction of the simulated time."""


def advice(scenario: LoopScenario, task: LoopTask, verdict: LoopVerdict) -> str:
    """Return a sentence on the first change with which the loop has no fault; empty if no change helps or is needed."""
    if verdict.code == ResultCode.successful:
        if verdict.agrees is not False:
            return ""
        changes = iter([_with_tolerances(task, FINER, "smaller")])
    else:
        changes = _changes(scenario, task)
    return next((text for text, changed in changes if _works(changed)), "")


def _works(task: LoopTask) -> bool:
    """Return whether a simulation finishes, and does not deviate from its closed form."""
    from qtraj.motion.simulation.assess_loop import assess_loop  # imported here, because it delays --help

    try:
        _, verdict = assess_loop(**task.arguments())
    except ValueError:
        return False
    return int(verdict.code) == ResultCode.successful and verdict.agrees is not False


def _changes(scenario: LoopScenario, task: LoopTask) -> Iterator[tuple[str, LoopTask]]:
    """Yield changes of the scenario as text and as a task, the most likely ones first."""
    from qtraj.motion.control.baselines import BASELINES, QuaternionFeedback

    if scenario.error.sign != "auto" and scenario.law.kind not in BASELINES:
        text = (
            "λ and −λ represent the same attitude. Set sign = 'auto' in [error] to start from the sign whose error "
            "quaternion stays farther from zero."
        )
        yield text, _with_error(scenario, task, sign="auto")
    if any(scenario.error.rate):
        yield "Use a smaller error.rate; without one, the loop finishes.", _with_error(scenario, task, rate=[0.0] * 3)
    if (gains := _gentle(scenario, task)) is not None:
        yield gains
    yield _with_tolerances(task, COARSER, "larger")
    own: Any = task.law
    if scenario.law.kind not in BASELINES and hasattr(own, "k2") and np.ndim(own.k1) == 0:
        law = QuaternionFeedback(own.k1, own.k2)
        yield "Use a law of kind 'quaternion', whose command is the same for λ and −λ.", task._replace(law=law)


def _with_error(scenario: LoopScenario, task: LoopTask, **changes: Any) -> LoopTask:
    part = scenario.error.model_copy(update=changes)
    quaternion, rate = part.state(scenario.angles, task.program(0.0), task.law)
    return task._replace(quaternion=quaternion, rate=rate)


def _with_tolerances(task: LoopTask, factor: float, kind: str) -> tuple[str, LoopTask]:
    rtol, atol = (float(np.clip(factor * x, y, LARGEST)) for x, y in zip((task.rtol, task.atol), SMALLEST, strict=True))
    text = f"Use {kind} tolerances, such as simulation.rtol = {rtol:.3g} and simulation.atol = {atol:.3g}."
    return text, task._replace(rtol=rtol, atol=atol)


def _gentle(scenario: LoopScenario, task: LoopTask) -> tuple[str, LoopTask] | None:
    """Return smaller gains, or None if the law has no settling time."""
    from qtraj.motion.control.feedback_law import feedback_law

    time = float(f"{SETTLED_BY * float(task.times[-1]):.3g}")
    try:
        law = feedback_law(scenario.law.kind, settling_time=time)
    except ValueError:
        return None
    text = f"Use smaller gains, such as those of settling_time = {time:g} in [law]."
    return text, task._replace(law=scenario.law.with_hysteresis(law))
