"""A slew over time: the angle with two derivatives, the attitude, and the torque on the body."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation.arrays import as_float
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, extent, times_text
from qtraj.foundation.types import ArrayInput
from qtraj.motion.attitude import AbstractProgram, Attitude
from qtraj.motion.dynamics import inertia_matrix, torque
from qtraj.motion.profiles.profile import Profile
from qtraj.motion.programs.euler_turn import EulerTurn, SlewSequence

MIN_DISTANCE = 1e-9
"""Switches closer than this fraction of the duration count as one."""
INTERVALS = 512
"""Number of equal intervals of `fine_times`."""
BEFORE_SWITCH = 1e-9
"""Time between a switch and the instant before it in `fine_times`, as a fraction of the duration."""


class SlewHistory(AbstractResult):
    """A slew at the instants `times` (n,) [s].

    `angle` (n,) [rad], `angle_rate` and `angle_acceleration`; for a sequence, the angle is the sum over its slews.
    `quaternion` (n, 4), `rate` (n, 3) and `acceleration` (n, 3) of the program, body axes. `torque` (n, 3) [N m], body
    axes; None without an inertia. At a jump, the value after the jump is used.
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
        """Every field over `time`."""
        body = ("time", "body")
        columns = {
            "angle": Quantity(self.angle, "rad", "angle of the slew", ("time",)),
            "angle_rate": Quantity(self.angle_rate, "rad s-1", "rate of the angle", ("time",)),
            "angle_acceleration": Quantity(
                self.angle_acceleration, "rad s-2", "acceleration of the angle; at a jump the value after it", ("time",)
            ),
            "quaternion": Quantity(self.quaternion, "1", "attitude of the program", ("time", "component")),
            "rate": Quantity(self.rate, "rad s-1", "angular rate, body axes", body),
            "acceleration": Quantity(self.acceleration, "rad s-2", "angular acceleration, body axes", body),
            "torque": Quantity(self.torque, "N m", "torque on the body, body axes; at a jump the value after it", body),
        }
        variables = {name: quantity for name, quantity in columns.items() if quantity.values is not None}
        summary = (
            f"{times_text(self.times)}: angle {extent(self.angle, 'rad')}, rate {extent(self.angle_rate, 'rad s-1')}"
        )
        time = Quantity(self.times, "s", "time from the start of the program", ("time",))
        return Record(summary, variables, {"time": time}, {"frame": "body"})

    def __getitem__(self, instants: slice) -> SlewHistory:
        """The history at a slice of the instants."""
        return jax.tree.map(lambda values: values[instants], self)


class Leg(NamedTuple):
    """One slew of a program about one axis; it begins at `start` [s]."""

    start: float
    turn: EulerTurn
    profile: Profile

    @property
    def end(self) -> float:
        """The instant at which it ends [s]."""
        return self.start + float(self.profile.duration)

    @property
    def moves(self) -> bool:
        """Whether the attitude changes. With nonzero end rates, a slew by a zero angle moves away and back."""
        return float(self.profile.total) != 0 or not self.profile.proportional

    @property
    def switches(self) -> list[float]:
        """The distinct instants inside the slew at which a piece of the profile ends [s]."""
        duration = float(self.profile.duration)
        switches: list[float] = []
        for t in np.asarray(self.turn.switches).tolist():
            if MIN_DISTANCE * duration < t < (1 - MIN_DISTANCE) * duration and (
                not switches or t - switches[-1] > MIN_DISTANCE * duration
            ):
                switches.append(t)
        return [self.start + t for t in switches]


def slew_legs(program: EulerTurn | SlewSequence) -> list[Leg]:
    """The slews of a program, in order.

    **Raises:** ValueError for a program of another kind.
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
    """A slew, or a sequence of slews, at the instants `times` (n,) [s].

    `inertia` [kg m²] of the body, for the torque: a scalar, principal moments (3,), or a tensor (3, 3), body axes.

    **Raises:** ValueError for a program of another kind, or an invalid inertia.
    """
    instants = np.asarray(times, float)
    angle = np.zeros((len(instants), 3))
    total = 0.0
    for k, leg in enumerate(slew_legs(program)):
        later = (instants >= leg.start) if k else np.ones(len(instants), bool)
        values = np.asarray(_derivatives(leg.profile, jnp.asarray(instants - leg.start)))
        angle[later] = (values + np.array([total, 0.0, 0.0]))[later]
        total += float(leg.profile.total)
    attitudes = attitudes_at(program, jnp.asarray(instants))
    torques = None if inertia is None else _torques(attitudes, inertia_matrix(inertia))
    phi, rate, acceleration = (as_float(column) for column in angle.T)
    program_values = (attitudes.quaternion, attitudes.rate, attitudes.acceleration)
    return SlewHistory(as_float(instants), phi, rate, acceleration, *program_values, torques)


def fine_times(program: EulerTurn | SlewSequence) -> np.ndarray:
    """Instants (n,) [s] for figures: the ends of 512 equal intervals, and both sides of each switch to show jumps."""
    legs = slew_legs(program)
    duration = legs[-1].end
    switches = np.array([t for leg in legs for t in (*leg.switches, leg.end)])
    both = np.concatenate([switches, switches - BEFORE_SWITCH * duration])
    return np.unique(np.concatenate([np.linspace(0, duration, INTERVALS + 1), both.clip(0, duration)]))


@eqx.filter_jit
def attitudes_at(program: AbstractProgram, times: Float[Array, " n"]) -> Attitude:
    """The attitudes of a program at `times` [s]."""
    return jax.vmap(program)(times)


@eqx.filter_jit
def _torques(attitudes: Attitude, inertia: Array) -> Float[Array, "n 3"]:
    return jax.vmap(lambda attitude: torque(attitude, inertia))(attitudes)


@eqx.filter_jit
def _derivatives(profile: Profile, times: Float[Array, " n"]) -> Float[Array, "n 3"]:
    return jax.vmap(lambda t: profile.derivatives(t, 2))(times)
