"""Advise on a slew that violates its limits: changes that are computed and compared with the limits, then named."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

from qtraj.foundation.types import ArrayInput
from qtraj.motion.profiles.profile import END_STATES, has_end_states
from qtraj.motion.profiles.s_curve import SCurve
from qtraj.motion.profiles.time_optimal import TimeOptimal
from qtraj.motion.programs.euler_turn import EulerTurn, SlewSequence
from qtraj.motion.programs.slew_torque import within_torque

Slews = EulerTurn | SlewSequence

MARGIN = 1e-8
"""Relative margin of a recommended duration, because its text is rounded."""

DIGITS = 6
"""Number of digits of a recommended acceleration."""


def advice(
    program: Slews,
    limits: Mapping[str, float],
    inertia: ArrayInput | None,
    max_torque: ArrayInput | None,
    factor: float,
    is_met: Callable[[Slews], bool],
) -> str:
    """Return sentences on changes with which a slew satisfies its limits; empty if none of them does.

    `limits` are those of rate, acceleration and jerk. A slew that takes `factor` times as long, with the same shape,
    satisfies the limits. `is_met` returns whether a program satisfies all limits.
    """
    texts = []
    for change, text in _changes(program, limits, Torque(inertia, max_torque), factor):
        try:
            changed = change()
        except ValueError:  # the change is not possible
            continue
        if is_met(changed):
            texts.append(text(changed))
    return " ".join(texts)


class Torque(NamedTuple):
    """The inertia of a body and a limit on the torque, or None."""

    inertia: ArrayInput | None
    limit: ArrayInput | None

    def within(self, program: Slews) -> Slews:
        """Return the program, changed if it violates the torque limit."""
        if self.inertia is None or self.limit is None:
            return program
        return within_torque(program, self.inertia, self.limit)


def _changes(
    program: Slews, limits: Mapping[str, float], torque: Torque, factor: float
) -> Iterator[tuple[Callable[[], Slews], Callable[[Slews], str]]]:
    """Yield functions that return a changed program, each with a function that describes it."""
    law: Any = program.law
    own = {name: value for name, value in limits.items() if hasattr(law, name)}
    rests = {name: None for name in END_STATES if hasattr(law, name)}

    def changed(**fields: Any) -> Slews:
        return torque.within(dataclasses.replace(program, law=dataclasses.replace(law, **fields)))

    if has_end_states(law):
        yield lambda: changed(**own, **rests, duration=None), _without_end_rates
    elif law.duration is None:
        yield lambda: changed(**own), _with_limits
    elif isinstance(law, TimeOptimal | SCurve):
        acceleration = limits.get("max_acceleration", law.max_acceleration)
        yield lambda: _rounded(changed(max_acceleration=acceleration)), _gentler
        yield lambda: _longer(program, changed(**own, duration=None), torque), _increase
    else:
        yield lambda: changed(duration=float(law.duration) * factor * (1 + MARGIN)), _increase


def _rounded(program: Slews) -> Slews:
    """Return the program with its acceleration rounded down to the digits of the text."""
    law: Any = program.law
    value = float(law.max_acceleration)
    step = 10.0 ** (math.floor(math.log10(value)) - DIGITS + 1)
    return dataclasses.replace(program, law=dataclasses.replace(law, max_acceleration=math.floor(value / step) * step))


def _longer(program: Slews, fastest: Slews, torque: Torque) -> Slews:
    """Return the program with the duration in which its longest slew, in `fastest`, satisfies the limits.

    **Raises:** ValueError if the program lasts longer already.
    """
    law: Any = program.law
    slews = [fastest]
    if isinstance(fastest, SlewSequence):
        pairs = zip(fastest.attitudes[:-1], fastest.attitudes[1:], strict=True)
        slews = [EulerTurn(a, b, fastest.law) for a, b in pairs]
    duration = max(float(slew.duration) for slew in slews) * (1 + MARGIN)
    if duration <= float(law.duration):
        raise ValueError("the slew lasts longer already")
    return torque.within(dataclasses.replace(program, law=dataclasses.replace(law, duration=duration)))


def _without_end_rates(program: Slews) -> str:
    names = "start_rate and end_rate"
    if hasattr(program.law, "end_acceleration"):
        names = "rates and accelerations at its ends"
    return f"Without {names}, the slew takes {float(program.duration):.9g} s within the limits."


def _with_limits(program: Slews) -> str:
    return f"With these limits in its profile, the slew takes {float(program.duration):.9g} s."


def _gentler(program: Slews) -> str:
    acceleration = float(program.law.max_acceleration)  # pyright: ignore[reportAttributeAccessIssue]
    return f"With max_acceleration = {acceleration:.{DIGITS}g}, the slew satisfies the limits in the same time."


def _increase(program: Slews) -> str:
    return f"Increase the duration to {float(program.law.duration):.9g} s."  # pyright: ignore[reportArgumentType]
