"""Evaluate a slew over time: the angle and its first two derivatives, the attitude, and the torque on the body."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation.arrays import as_float, require_concrete
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, extent, times_text
from qtraj.foundation.types import ArrayInput
from qtraj.motion.attitude import AbstractProgram, Attitude
from qtraj.motion.dynamics import inertia_matrix, torque
from qtraj.motion.profiles.profile import Profile
from qtraj.motion.programs.euler_turn import EulerTurn, SlewSequence

MIN_DISTANCE = 1e-9
"""Switches that are closer in time than this fraction of the duration count as one switch."""
AFTER_JUMP = "at a jump the value after the jump"
INTERVALS = 512
"""Number of equal time intervals in `fine_times`."""
BEFORE_SWITCH = 1e-9
"""Time between a switch and the preceding instant in `fine_times`, as a fraction of the duration."""


class SlewHistory(AbstractResult):
    """The history of a slew at the instants `times` (n,) [s].

    `angle` (n,) [rad] is the angle of the slew; in a sequence, it includes the angles of the previous slews.
    `angle_rate` (n,) [rad/s] and `angle_acceleration` (n,) [rad/s²] are its time derivatives. `quaternion` (n, 4),
    `rate` (n, 3) [rad/s] and `acceleration` (n, 3) [rad/s²] are values of the program, body axes. `torque` (n, 3)
    [N m], body axes, is None without an inertia. At a jump, all fields have the value after the jump.
    """

    times: Float[Array, " n"]
    angle: Float[Array, " n"]
    angle_rate: Float[Array, " n"]
    angle_acceleration: Float[Array, " n"]
    quaternion: Float[Array, "n 4"]
    rate: Float[Array, "n 3"]
    acceleration: Float[Array, "n 3"]
    torque: Float[Array, "n 3"] | None = None

    def record(self) -> Record:
        """Return the fields with units, except those that are None."""
        body = ("time", "body")
        columns = {
            "angle": Quantity(self.angle, "rad", "angle of the slew", ("time",)),
            "angle_rate": Quantity(self.angle_rate, "rad s-1", "first time derivative of the angle", ("time",)),
            "angle_acceleration": Quantity(
                self.angle_acceleration, "rad s-2", f"second time derivative of the angle; {AFTER_JUMP}", ("time",)
            ),
            "quaternion": Quantity(self.quaternion, "1", "attitude of the program", ("time", "component")),
            "rate": Quantity(self.rate, "rad s-1", "angular rate, body axes", body),
            "acceleration": Quantity(self.acceleration, "rad s-2", "angular acceleration, body axes", body),
            "torque": Quantity(self.torque, "N m", f"torque on the body, body axes; {AFTER_JUMP}", body),
        }
        variables = {name: quantity for name, quantity in columns.items() if quantity.values is not None}
        summary = (
            f"{times_text(self.times)}: angle {extent(self.angle, 'rad')}, rate {extent(self.angle_rate, 'rad s-1')}"
        )
        time = Quantity(self.times, "s", "time from the start of the program", ("time",))
        return Record(summary, variables, {"time": time}, {"frame": "body"})

    def __getitem__(self, instants: slice) -> SlewHistory:
        """Return the history at a slice of the instants."""
        return jax.tree.map(lambda values: values[instants], self)


class Leg(NamedTuple):
    """One slew of a program, about a fixed axis; `start` [s] is the instant at which the slew begins."""

    start: float
    turn: EulerTurn
    profile: Profile

    @property
    def end(self) -> float:
        """The instant [s] at which the slew ends."""
        return self.start + float(self.profile.duration)

    @property
    def moves(self) -> bool:
        """Whether the attitude changes; with nonzero end rates, it changes even if the angle of the slew is zero."""
        return float(self.profile.total) != 0 or not self.profile.proportional

    @property
    def switches(self) -> list[float]:
        """The distinct instants [s] within the slew at which a segment of the profile ends."""
        duration = float(self.profile.duration)
        switches: list[float] = []
        for t in np.asarray(self.turn.switches).tolist():
            if MIN_DISTANCE * duration < t < (1 - MIN_DISTANCE) * duration and (
                not switches or t - switches[-1] > MIN_DISTANCE * duration
            ):
                switches.append(t)
        return [self.start + t for t in switches]


def slew_legs(program: EulerTurn | SlewSequence) -> list[Leg]:
    """Return the slews of a program in order of time.

    **Raises:** ValueError for a program that is neither an `EulerTurn` nor a `SlewSequence`.
    """
    if isinstance(program, EulerTurn):
        return [Leg(0.0, program, program.profile)]
    if not isinstance(program, SlewSequence):
        raise ValueError(f"an EulerTurn or a SlewSequence was expected, but a {type(program).__name__} was given")
    turns = [EulerTurn(a, b, program.law) for a, b in itertools.pairwise(np.asarray(program.attitudes))]
    starts = np.asarray(program.times)[:-1].tolist()
    return [Leg(start, turn, turn.profile) for start, turn in zip(starts, turns, strict=True)]


def slew_history(
    program: EulerTurn | SlewSequence, times: ArrayInput, inertia: ArrayInput | None = None
) -> SlewHistory:
    """Evaluate a slew, or a sequence of slews, at the instants `times` (n,) [s].

    `inertia` [kg m²], body axes: a scalar, principal moments (3,), or a tensor (3, 3). With None, no torque is
    computed.

    **Raises:** ValueError for a program that is neither an `EulerTurn` nor a `SlewSequence`, an invalid inertia, or
    inside a trace.
    """
    require_concrete("slew_history", program, times)
    instants = np.asarray(times, float)
    angle = np.zeros((len(instants), 3))
    total = 0.0
    for k, leg in enumerate(slew_legs(program)):
        later = (instants >= leg.start) if k else np.ones(len(instants), bool)
        values = _derivatives(leg.profile, jnp.asarray(instants - leg.start))
        require_concrete("slew_history", values)  # traced inside jit, although the arguments are constants
        values = np.asarray(values)
        angle[later] = (values + np.array([total, 0.0, 0.0]))[later]
        total += float(leg.profile.total)
    attitudes = attitudes_at(program, jnp.asarray(instants))
    torques = None if inertia is None else _torques(attitudes, inertia_matrix(inertia))
    phi, rate, acceleration = (as_float(column) for column in angle.T)
    program_values = (attitudes.quaternion, attitudes.rate, attitudes.acceleration)
    return SlewHistory(as_float(instants), phi, rate, acceleration, *program_values, torques)


def fine_times(program: EulerTurn | SlewSequence) -> np.ndarray:
    """Return instants (n,) [s] for figures: the ends of 512 equal intervals, and both sides of each switch."""
    legs = slew_legs(program)
    duration = legs[-1].end
    switches = np.array([t for leg in legs for t in (*leg.switches, leg.end)])
    both = np.concatenate([switches, switches - BEFORE_SWITCH * duration])
    return np.unique(np.concatenate([np.linspace(0, duration, INTERVALS + 1), both.clip(0, duration)]))


@eqx.filter_jit
def attitudes_at(program: AbstractProgram, times: Float[Array, " n"]) -> Attitude:
    """Return the attitudes of a program at `times` [s]."""
    return jax.vmap(program)(times)


@eqx.filter_jit
def _torques(attitudes: Attitude, inertia: Array) -> Float[Array, "n 3"]:
    return jax.vmap(lambda attitude: torque(attitude, inertia))(attitudes)


@eqx.filter_jit
def _derivatives(profile: Profile, times: Float[Array, " n"]) -> Float[Array, "n 3"]:
    return jax.vmap(lambda t: profile.derivatives(t, 2))(times)
