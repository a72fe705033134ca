"""A program of turns at many instants."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.cli.turning.job import Leg
from qtraj.io.instants import Column
from qtraj.motion.attitude import AbstractProgram, Attitude
from qtraj.motion.dynamics import torque
from qtraj.motion.profiles.profile import Profile

FINE = 512
"""Equal intervals of a figure; besides, both sides of every switch."""
SIDE = 1e-9
"""Of the duration: how far before a switch its earlier side is shown."""


def turn_columns(
    program: AbstractProgram, turns: Sequence[Leg], times: np.ndarray, inertia: Any = None
) -> dict[str, Column]:
    """Angle (of a chain the sum so far), its derivatives, and the attitude with its derivatives, at `times` [s].

    With the `inertia` of the body, the torque as well.
    """
    angle = np.zeros((len(times), 3))
    passed = 0.0
    for k, leg in enumerate(turns):
        later = (times >= leg.start) if k else np.ones(len(times), bool)
        values = np.asarray(_profile(leg.profile, jnp.asarray(times - leg.start)))
        angle[later] = (values + np.array([passed, 0.0, 0.0]))[later]
        passed += float(leg.profile.total)
    attitudes = program_attitudes(program, jnp.asarray(times))
    columns = {
        "angle": Column(angle[:, 0], "rad", "angle turned"),
        "angle_rate": Column(angle[:, 1], "rad s-1", "rate of the angle"),
        "angle_acceleration": Column(angle[:, 2], "rad s-2", "acceleration of the angle; at a jump that after it"),
        "quaternion": Column(np.asarray(attitudes.quaternion), "1", "attitude of the program", "component"),
        "rate": Column(np.asarray(attitudes.rate), "rad s-1", "angular rate, body axes", "body"),
        "acceleration": Column(
            np.asarray(attitudes.acceleration), "rad s-2", "angular acceleration, body axes", "body"
        ),
    }
    if inertia is not None:
        torques = np.asarray(_torques(attitudes, jnp.asarray(inertia, float)))
        columns["torque"] = Column(torques, "N m", "torque on the body, body axes; at a jump that after it", "body")
    return columns


def fine_times(turns: Sequence[Leg]) -> np.ndarray:
    """Instants for a figure, which shows jumps as such."""
    duration = turns[-1].end
    switches = np.array([t for leg in turns for t in (*leg.switches, leg.end)])
    both = np.concatenate([switches, switches - SIDE * duration])
    return np.unique(np.concatenate([np.linspace(0, duration, FINE + 1), both.clip(0, duration)]))


def even_times(turns: Sequence[Leg], samples: int) -> np.ndarray:
    """Equally spaced instants of a table, both ends included; one where nothing takes any time."""
    return np.linspace(0.0, turns[-1].end, samples if turns[-1].end > 0 else 1)


@eqx.filter_jit
def program_attitudes(program: AbstractProgram, times: Float[Array, " n"]) -> Attitude:
    """The program at many instants."""
    return jax.vmap(program)(times)


@eqx.filter_jit
def _torques(attitudes: Attitude, inertia: Array) -> Float[Array, "n 3"]:
    return jax.vmap(lambda attitude: torque(attitude, inertia))(attitudes)


@eqx.filter_jit
def _profile(profile: Profile, times: Float[Array, " n"]) -> Float[Array, "n 3"]:
    return jax.vmap(lambda t: profile.derivatives(t, 2))(times)
