"""Define sequences of programs, such as a slew that ends at the rate of the spin that follows."""

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra import rotation
from qtraj.foundation.argument import described
from qtraj.foundation.arrays import as_float, concrete, one_instant
from qtraj.foundation.devices import on_one_device
from qtraj.foundation.document import storable
from qtraj.foundation.namespace import in_numpy, xp
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Scalar, ScalarLike
from qtraj.motion.attitude import AbstractProgram, Attitude, require_program

SAME_ATTITUDE = 1e-4
"""Largest difference [rad] between the end of a program and the start of the next; float32 and files round."""

SAME_RATE = 1e-4
"""Largest difference between the rates there, as a fraction of the larger rate."""

STILL = 1e-9
"""Rates below this value [rad/s] count as zero."""


@storable
class ProgramSequence(AbstractProgram):
    """Attitude programs one after the other, each of which starts with the attitude and the rate of the end before it.

    For example, a slew with `end_rate` leads to a `Spin`, and a slew with `start_rate` stops it; a `TableProgram` with
    `rates` joins spins about different axes. The acceleration may jump from one program to the next. At the instant
    between two programs, the second one determines the values. Before the start and after the end, the first and the
    last program determine them.

    Each program is as if it began with the first; its quaternion is multiplied by its number in `signs` (n,), 1 or −1,
    so that the quaternion of the sequence is continuous.

    Args:
        programs: The programs (n), n ≥ 1.
        signs: The signs (n,); by default, they are computed.

    Raises:
        ValueError: For anything that is not a sequence of programs, and if the attitude of a program differs from the
            attitude before by more than 1e-4 rad, or the rate by more than 1e-4 of its magnitude.

    Example:
        >>> import qtraj as qt
        >>> law = qt.TimeOptimal(max_acceleration=0.01, end_rate=0.1)
        >>> start = qt.EulerTurn.about([0, 0, 1], 0.5, [1, 0, 0, 0], law)  # 0.1²/(2·0.01) rad from rest
        >>> both = ProgramSequence([start, qt.Spin([0, 0, 0.1], 50.0, start.end)])
        >>> print(f"{float(both.duration):.1f} s")
        60.0 s
    """

    programs: tuple[AbstractProgram, ...]
    signs: Float[Array, " n"]

    def __init__(self, programs: "Sequence[AbstractProgram]", signs: ArrayInput | None = None):
        if not isinstance(programs, Sequence) or not programs:
            raise ValueError(f"programs must be a non-empty sequence of programs, but {described(programs)} was given")
        for program in programs:
            require_program(program)
        self.programs = tuple(programs)
        joints = [(a(a.duration), b(0.0)) for a, b in zip(self.programs[:-1], self.programs[1:], strict=True)]
        for k, (end, start) in enumerate(joints):
            _require_joined(k, end, start)
        self.signs = _signs(joints) if signs is None else as_float(signs)
        if self.signs.shape != (len(self.programs),):
            raise ValueError(f"signs must have shape ({len(self.programs)},), but shape {self.signs.shape} was given")

    def __repr__(self) -> str:
        return shown(self)

    @on_one_device
    def __call__(self, t: ScalarLike) -> Attitude:
        """Return the attitude at the time `t` [s]."""
        t, times = one_instant(t), self.times
        now, known = concrete(t), concrete(times)
        if now is not None and known is not None:
            k = int(np.searchsorted(known[1:-1], now, side="right"))
            return self._within(k, t - times[k])
        last = len(self.programs) - 1
        local = [t.astype(times.dtype) - times[k] for k in range(last + 1)]
        # Programs that are not in use are evaluated at one of their ends, where values and derivatives are finite.
        local = [x if k == 0 else xp.maximum(x, xp.zeros_like(x)) for k, x in enumerate(local)]
        local = [x if k == last else xp.minimum(x, times[k + 1] - times[k]) for k, x in enumerate(local)]
        found = self._within(0, local[0])
        for k in range(1, last + 1):
            later = t >= times[k]
            found = jax.tree.map(lambda a, b: xp.where(later, b, a), found, self._within(k, local[k]))  # noqa: B023
        return found

    def _within(self, k: int, t: Any) -> Attitude:
        at = self.programs[k](t)
        return Attitude(at.quaternion * self.signs[k].astype(at.quaternion.dtype), at.rate, at.acceleration)

    def prepared(self) -> "ProgramSequence":
        """Return the sequence of the prepared programs."""
        return ProgramSequence([program.prepared() for program in self.programs], self.signs)

    @property
    def times(self) -> Float[Array, " n+1"]:
        """The instants [s] between the programs, from 0 to the duration."""
        return _times([program.duration for program in self.programs])

    @property
    def duration(self) -> Scalar:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The sum [s] of the durations of all programs."""
        return self.times[-1]

    @property
    def switches(self) -> Float[Array, " _"]:
        """The instants [s] at which the acceleration may jump, ascending, to be passed as `jumps` to an integration."""
        own = [getattr(program, "switches", None) for program in self.programs]
        return _switches(self.times, own)


@in_numpy
def _times(durations: list[Scalar]) -> Float[Array, " n+1"]:
    spans = xp.stack([xp.asarray(x) for x in durations])
    return xp.concatenate([xp.zeros_like(spans[:1]), xp.cumsum(spans)])


@in_numpy
def _switches(times: Float[Array, " n+1"], own: list[Any]) -> Float[Array, " _"]:
    within = [times[k] + x for k, x in enumerate(own) if x is not None]
    return xp.sort(xp.concatenate([times[1:], *within]))


@in_numpy
def _signs(joints: list[tuple[Attitude, Attitude]]) -> Float[Array, " n"]:
    signs = [np.ones(())]
    for end, start in joints:
        same = xp.sum(end.quaternion * start.quaternion) >= 0
        signs.append(signs[-1] * xp.where(same, 1.0, -1.0))
    return xp.stack(signs)


def _require_joined(k: int, end: Attitude, start: Attitude) -> None:
    """Raise a ValueError if a program `start`s with another attitude or rate than the concrete `end` of program k."""
    angle = concrete(rotation.angle_between(end.quaternion, start.quaternion))
    before, after = concrete(end.rate), concrete(start.rate)
    if angle is None or before is None or after is None:
        return
    where = f"program {k + 1} of a sequence must start with the"
    if not float(angle) <= SAME_ATTITUDE:
        raise ValueError(
            f"{where} attitude at the end of program {k}, but the angle between them is {float(angle):.6g} rad: pass "
            "that attitude as its start"
        )
    jump, size = (float(np.linalg.norm(x)) for x in (after - before, np.maximum(abs(before), abs(after))))
    if not jump <= SAME_RATE * size + STILL:
        given, expected = (np.array2string(np.asarray(x), precision=6, separator=", ") for x in (after, before))
        raise ValueError(
            f"{where} rate at the end of program {k}, {expected} rad/s in body axes, but starts with {given} rad/s: "
            "add a slew between them, whose law has start_rate or end_rate, or a TableProgram with rates"
        )
