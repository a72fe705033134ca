"""What an integration or a simulation gives back: the motion, and in words how it ended and what to do."""

import os
import re

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from qtraj.foundation import document
from qtraj.foundation.arrays import as_float, concrete
from qtraj.foundation.document import storable
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, extent, in_lanes, over
from qtraj.foundation.types import ArrayInput
from qtraj.motion.checks import require_axes
from qtraj.motion.simulation import ode

NEAR_ZERO, FAR_SHEET = 3, 4
"""Outcomes of a closed loop, after those of `ode`: the error quaternion came near zero; it ran into zero."""

_ENDINGS = {
    ode.FINISHED: "finished: every instant was reached.",
    ode.OUT_OF_STEPS: (
        "stopped: max_steps were not enough. Try a larger max_steps, a larger rtol and atol, or a shorter span of "
        "times; at instants where the acceleration jumps, pass them as jumps."
    ),
    ode.STALLED: (
        "stopped: the step fell to round-off. The acceleration has a pole there or is not finite: look at its values "
        "near the last instant reached, and for a tolerance below round-off raise rtol."
    ),
    NEAR_ZERO: (
        "finished, but the error quaternion came near zero, where the command grows as 1/|μ|²: look at peak_command. "
        "The other sign of λ may pass more smoothly: start from choose_sign(law, program(t0), quaternion, rate)."
    ),
    FAR_SHEET: (
        "stopped: the error quaternion started on the far sheet (μ0 < 0) and ran into zero, where the law has no "
        "command. λ and −λ are one attitude: start from −λ, or from choose_sign(law, program(t0), quaternion, rate)."
    ),
}


@storable
class Solution(AbstractResult):
    """Attitude and rate at the instants `times` (n,) [s].

    `quaternion` (n, 4): λ, of any length; `rate` (n, 4) [rad/s], ω0 = d/dt ln|λ|² first. Of a closed loop also
    `command` (n, 4), in body axes, as the actuator gave it: [rad/s²], of a rate law [rad/s]; `error` (n, 4), the law's
    error quaternion; `angle` (n,) [rad], between body and program, 0 … π. Instants that were not reached are NaN.
    `code` is the outcome as a number and `result` in words. Under `vmap` everything has the lanes in front. `axes`,
    "body" or "inertial", are those of the rate; `commands` is "acceleration" or, of a rate law, "rate".

    **Raises:** ValueError for other `axes` or `commands`.
    """

    times: Float[Array, "*lanes n"]
    quaternion: Float[Array, "*lanes n 4"]
    rate: Float[Array, "*lanes n 4"]
    code: Int[Array, "*lanes"]
    command: Float[Array, "*lanes n 4"] | None
    error: Float[Array, "*lanes n 4"] | None
    angle: Float[Array, "*lanes n"] | None
    axes: str = eqx.field(static=True)
    commands: str = eqx.field(static=True)

    def __init__(
        self,
        times: ArrayInput,
        quaternion: ArrayInput,
        rate: ArrayInput,
        code: ArrayInput,
        command: ArrayInput | None = None,
        error: ArrayInput | None = None,
        angle: ArrayInput | None = None,
        axes: str = "body",
        commands: str = "acceleration",
    ):
        self.times, self.quaternion, self.rate = as_float(times), as_float(quaternion), as_float(rate)
        self.code = jnp.asarray(code)
        self.command = None if command is None else as_float(command)
        self.error = None if error is None else as_float(error)
        self.angle = None if angle is None else as_float(angle)
        require_axes(axes)
        if commands not in ("acceleration", "rate"):
            raise ValueError(f"commands must be 'acceleration' or 'rate', but {commands!r} was given")
        self.axes, self.commands = axes, commands

    @property
    def successful(self) -> Bool[Array, "*lanes"]:
        """Whether every instant was reached."""
        return (self.code == ode.FINISHED) | (self.code == NEAR_ZERO)

    @property
    def result(self) -> str | list[str]:
        """How it ended, and what to do: a text, or one per lane.

        **Raises:** ValueError inside a trace, where only `successful` and `code` are known.
        """
        code = concrete(self.code)
        if code is None:
            raise ValueError("the text of a result is known outside jit, vmap and grad only: use successful or code")
        reached = np.asarray(np.isfinite(np.asarray(self.quaternion)).all(axis=-1))
        times = np.broadcast_to(np.asarray(self.times), reached.shape)
        texts = [_text(int(c), t, r) for c, t, r in zip(code.ravel(), _rows(times), _rows(reached), strict=True)]
        return texts if code.ndim else texts[0]

    def record(self) -> Record:
        """The motion over `time`, or over `sample` where each lane has times of its own, and how it ended."""
        along = "time" if self.times.ndim == 1 else "sample"
        per = "rad s-1" if self.commands == "rate" else "rad s-2"
        axes, commanded = (along, "component"), f"{self.commands} commanded, body axes; first the virtual one"
        turning = f"angular rate, {self.axes} axes; first the virtual rate d/dt ln|λ|² [s-1]"
        columns = {
            "quaternion": Quantity(self.quaternion, "1", "attitude, body to inertial, of any length", axes),
            "rate": Quantity(self.rate, "rad s-1", turning, axes),
            "command": Quantity(self.command, per, commanded, axes),
            "error": Quantity(self.error, "1", "error quaternion of the law", axes),
            "angle": Quantity(self.angle, "rad", "angle between body and program", (along,)),
            "result": Quantity(np.asarray(self.result).reshape(self.code.shape), "", "how it ended"),
            "code": Quantity(self.code, "1", "how it ended, as a number"),
        }
        variables = {name: q for name, q in columns.items() if q.values is not None}
        reached = f"{np.sum(self.successful)} of {self.code.size} reached every instant"
        ended = reached if self.code.ndim else _brief(str(self.result))
        error = "" if self.angle is None else f", angle to the program {extent(self.angle, 'rad')}"
        summary = f"{in_lanes(self.code.shape)}{over(self.times)}: {ended}{error}"
        return Record(summary, variables, {"time": Quantity(self.times, "s", "time", (along,))}, {"frame": self.axes})

    def check(self) -> None:
        """Raise a RuntimeError with the result's text where an instant was not reached."""
        successful = concrete(self.successful)
        if successful is None:
            raise ValueError("throw=True works outside jit, vmap and grad only: use the solution's successful there")
        if not successful.all():
            texts = self.result
            first = texts if isinstance(texts, str) else texts[int(np.argmin(successful.ravel()))]
            raise RuntimeError(first)

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the solution to a TOML file, exactly (JSON where every instant was reached); `qtraj.load` reads it.

        **Raises:** ValueError for another suffix.
        """
        document.save(self, file)

    @property
    def norm(self) -> Float[Array, "*lanes n"]:
        """|λ| at the instants: with ω0 = 0 its drift gauges the accuracy."""
        return _lengths(self.quaternion)

    @property
    def virtual_command(self) -> Float[Array, "*lanes n"]:
        """The scalar part of the command, which steers |λ| in the on-board computer."""
        return _required(self.command)[..., 0]

    @property
    def physical_command(self) -> Float[Array, "*lanes n 3"]:
        """The vector part of the command, which acts on the body."""
        return _required(self.command)[..., 1:]

    def settling_time(self, within: ArrayInput) -> Float[Array, "*lanes"]:
        """From when on the angle stays within `within` [rad] to the last instant [s], linear between two instants.

        NaN where at the last instant, or where an instant was not reached, it does not.
        """
        find = jnp.vectorize(_settled, signature="(n),(n),()->()")
        return find(self.times, _required(self.angle), as_float(within).astype(self.times.dtype))

    @property
    def peak_command(self) -> Float[Array, "*lanes"]:
        """The largest length of the physical command at the instants; NaN where one was not reached."""
        return jnp.max(_lengths(self.physical_command), axis=-1)


def _text(code: int, times: np.ndarray, reached: np.ndarray) -> str:
    text = _ENDINGS[code]
    if reached.all():
        return text
    if not reached.any():
        return f"{text} No instant was reached."
    return f"{text} Last instant reached: t = {times[reached][-1]:.9g} s."


def _brief(text: str) -> str:
    """What stands before the first colon, comma or full stop of a result."""
    return re.split("[:,.]", text, maxsplit=1)[0]


def _rows(x: np.ndarray) -> np.ndarray:
    return x.reshape(-1, x.shape[-1])


def _lengths(x: Array) -> Array:
    square = jnp.sum(x * x, axis=-1)
    positive = square > 0
    safe = jnp.sqrt(jnp.where(positive, square, 1.0))
    return jnp.where(positive | jnp.isnan(square), safe + 0 * square, 0.0)


def _settled(times: Array, angle: Array, within: Array) -> Array:
    outside = ~(angle <= within)
    last = jnp.max(jnp.where(outside, jnp.arange(times.size), -1))
    here, after = jnp.maximum(last, 0), jnp.minimum(last + 1, times.size - 1)
    kept = (last < times.size - 1) & jnp.isfinite(angle[here])
    fall = jnp.where((last >= 0) & kept, angle[here] - angle[after], 1.0)
    inner = times[here] + (angle[here] - within) / fall * (times[after] - times[here])
    return jnp.where(last < 0, times[0], jnp.where(kept, inner, jnp.nan))


def _required(column: Array | None) -> Array:
    if column is None:
        raise ValueError("an open-loop integration has no command and no error: simulate gives them")
    return column
