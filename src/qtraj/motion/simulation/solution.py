"""Store the solution of an integration or a simulation: the motion, and a description of the result."""

from __future__ import annotations

import os
import re
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.foundation import document
from qtraj.foundation.arrays import as_float
from qtraj.foundation.document import reads_older, storable
from qtraj.foundation.namespace import in_numpy, xp
from qtraj.foundation.outcome import AbstractOutcome, ResultCode, renumbered
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import batch_prefix, extent, times_text
from qtraj.foundation.types import ArrayInput
from qtraj.motion.checks import require_axes
from qtraj.motion.simulation.body_motion import BodyMotion

FINISHED = "finished: every instant was reached."

_OLDER_CODES = {
    1: ResultCode.max_steps_reached,
    2: ResultCode.step_too_small,
    3: ResultCode.near_zero_error,
    4: ResultCode.wrong_sign,
}
"""Codes of older documents and the corresponding `ResultCode`."""


def _from_older(fields: dict[str, Any]) -> dict[str, Any]:
    return fields | {"code": renumbered(fields["code"], _OLDER_CODES)} if "code" in fields else fields


@reads_older(_from_older)
@storable
class Solution(AbstractOutcome):
    """The attitude and rate of a body at the instants `times` (n,) [s].

    `quaternion` (n, 4): λ, not normalised. `rate` (n, 4) [rad/s]: the virtual rate ω0 = d/dt ln|λ|² first, then the
    physical rate. Solutions of `simulate` and `open_loop` also contain `command` (n, 4), the limited command in body
    axes, in rad/s² or in rad/s for a rate law; `error` (n, 4), the error quaternion of the law; and `angle` (n,) [rad],
    the attitude error angle, from 0 to π. Values at instants that were not reached are NaN. `code`: a `ResultCode`.
    `result`: a description of the result. Under `vmap` all fields have leading batch axes. `axes`: "body" or
    "inertial", the axes of the rate. `commands`: "acceleration", or "rate" for a rate law. `body`: a `BodyMotion` with
    torques, wheel momenta and the deviation from the exact error equation, only for a simulated `RigidBody`.
    `law_state` (n, k): the state of a law with a state of its own, as one vector.

    **Raises:** ValueError for unknown `axes` or `commands`.
    """

    times: Float[Array, "*batch n"]
    quaternion: Float[Array, "*batch n 4"]
    rate: Float[Array, "*batch n 4"]
    code: Int[Array, "*batch"]
    command: Float[Array, "*batch n 4"] | None
    error: Float[Array, "*batch n 4"] | None
    angle: Float[Array, "*batch n"] | None
    axes: str = eqx.field(static=True)
    commands: str = eqx.field(static=True)
    body: BodyMotion | None
    law_state: Float[Array, "*batch n k"] | None

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
        body: BodyMotion | None = None,
        law_state: ArrayInput | None = None,
    ):
        self.times, self.quaternion, self.rate = as_float(times), as_float(quaternion), as_float(rate)
        self.code = jnp.asarray(code, jnp.int32)
        self.command = None if command is None else as_float(command)
        self.error = None if error is None else as_float(error)
        self.angle = None if angle is None else as_float(angle)
        require_axes(axes)
        if commands not in ("acceleration", "rate"):
            raise ValueError(f"commands must be 'acceleration' or 'rate', but {commands!r} was given")
        self.axes, self.commands, self.body = axes, commands, body
        self.law_state = None if law_state is None else as_float(law_state)

    def explain(self, at: tuple[int, ...]) -> str:
        """Describe the result of one motion, with advice and the last instant that was reached."""
        code = ResultCode(int(np.asarray(self.code)[at]))
        text = FINISHED if code == ResultCode.successful else code.text
        if self.body is not None:
            body_motion: BodyMotion = jax.tree.map(lambda x: np.asarray(x)[at], self.body)
            text = f"{text} {body_motion.exactness().capitalize()}."
        return f"{text} {self.reached_text(at)}".rstrip()

    def reached_text(self, at: tuple[int, ...] = ()) -> str:
        """Return a sentence with the last instant that one motion reached; empty if it reached every instant."""
        reached = np.isfinite(np.asarray(self.quaternion)[at]).all(axis=-1)
        if reached.all():
            return ""
        if not reached.any():
            return "No instant was reached."
        times = np.asarray(self.times)
        times = times if times.ndim == 1 else times[at]
        return f"Last instant reached: t = {times[reached][-1]:.9g} s."

    def record(self) -> Record:
        """Return the fields with units, along `time`, or along `sample` if each batch element has its own times."""
        along = "time" if self.times.ndim == 1 else "sample"
        per = "rad s-1" if self.commands == "rate" else "rad s-2"
        axes, commanded = (along, "component"), f"commanded {self.commands}, body axes, virtual part first"
        rate = f"angular rate, {self.axes} axes; virtual rate d/dt ln|λ|² [s-1] first"
        columns = {
            "quaternion": Quantity(self.quaternion, "1", "attitude, body to inertial, not normalised", axes),
            "rate": Quantity(self.rate, "rad s-1", rate, axes),
            "command": Quantity(self.command, per, commanded, axes),
            "error": Quantity(self.error, "1", "error quaternion of the law", axes),
            "angle": Quantity(self.angle, "rad", "attitude error angle", (along,)),
            "law_state": Quantity(self.law_state, "", "state of the law", (along, "state")),
            "result": Quantity(np.asarray(self.result), "", "description of the result"),
            "code": Quantity(self.code, "1", "result code"),
        }
        variables = {name: q for name, q in columns.items() if q.values is not None}
        variables |= {} if self.body is None else self.body.variables()
        reached = f"{np.sum(self.successful)} of {self.code.size} reached every instant"
        result = reached if self.code.ndim else _brief(str(self.result))
        error = "" if self.angle is None else f", attitude error {extent(self.angle, 'rad')}"
        summary = f"{batch_prefix(self.code.shape)}{times_text(self.times)}: {result}{error}"
        return Record(summary, variables, {"time": Quantity(self.times, "s", "time", (along,))}, {"frame": self.axes})

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the solution without loss of precision to a TOML or JSON file, which `qtraj.load` reads.

        **Raises:** ValueError for a suffix other than .toml or .json.
        """
        document.save(self, file)

    @property
    def norm(self) -> Float[Array, "*batch n"]:
        """The norm |λ| at the instants; for ω0 = 0, the drift of |λ| is a measure of the accuracy."""
        return _lengths(self.quaternion)

    @property
    def virtual_command(self) -> Float[Array, "*batch n"]:
        """The scalar part of the command, which controls |λ| in the on-board computer."""
        return _required(self.command)[..., 0]

    @property
    def physical_command(self) -> Float[Array, "*batch n 3"]:
        """The vector part of the command, which acts on the body."""
        return _required(self.command)[..., 1:]

    def settling_time(self, within: ArrayInput) -> Float[Array, "*batch"]:
        """Return the instant [s] after which the error angle is at most `within` [rad], by linear interpolation.

        The result is NaN if the angle exceeds `within` at the last instant, or if an instant was not reached.
        """
        return _settled(self.times, _required(self.angle), as_float(within).astype(self.times.dtype))

    @property
    def peak_command(self) -> Float[Array, "*batch"]:
        """The largest magnitude of the physical command at the instants [rad/s²; rad/s for a rate law].

        The value is NaN if an instant was not reached.
        """
        return _largest(self.physical_command)


def _brief(text: str) -> str:
    """Return the text of a result up to its first colon, comma or full stop."""
    return re.split("[:,.]", text, maxsplit=1)[0]


@in_numpy
def _lengths(x: Array) -> Array:
    square = xp.sum(x * x, axis=-1)
    positive = square > 0
    safe = xp.sqrt(xp.where(positive, square, 1.0))
    return xp.where(positive | xp.isnan(square), safe + 0 * square, 0.0)


@in_numpy
def _largest(x: Array) -> Array:
    return xp.max(_lengths(x), axis=-1)


@in_numpy
def _settled(times: Array, angle: Array, within: Array) -> Array:
    outside = ~(angle <= within[..., None])
    end = outside.shape[-1] - 1
    last = xp.max(xp.where(outside, np.arange(end + 1), -1), axis=-1)
    here, after = xp.maximum(last, 0), xp.minimum(last + 1, end)
    (t, t_after), (x, x_after) = ([_at(values, outside.shape, k) for k in (here, after)] for values in (times, angle))
    settled = (last < end) & xp.isfinite(x)
    fall = xp.where((last >= 0) & settled, x - x_after, 1.0)
    inner = t + (x - within) / fall * (t_after - t)
    return xp.where(last < 0, xp.broadcast_to(times, outside.shape)[..., 0], xp.where(settled, inner, np.nan))


def _at(values: Array, shape: tuple[int, ...], k: Array) -> Array:
    """Return the values (*batch, n) at the places `k` (*batch,)."""
    return xp.take_along_axis(xp.broadcast_to(values, shape), k[..., None], axis=-1)[..., 0]


def _required(column: Array | None) -> Array:
    if column is None:
        raise ValueError("a solution of integrate has neither a command nor an error: use simulate for a closed loop")
    return column
