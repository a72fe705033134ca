"""Programs and laws shared by the tests of motion."""

import jax
import jax.numpy as jnp
import numpy as np

import qtraj as qt
from qtraj.foundation.types import Scalar
from qtraj.motion.attitude import AbstractProgram, Attitude
from qtraj.motion.control.laws import AbstractLaw


def rotation(axis, angle):
    """The quaternion of a rotation about a coordinate axis."""
    parts = [jnp.cos(angle / 2)] + 3 * [jnp.zeros_like(angle)]
    parts[1 + axis] = jnp.sin(angle / 2)
    return jnp.stack(parts)


class ThreeAxis(AbstractProgram):
    """A program with varying yaw, pitch and roll: rates by Euler kinematics, accelerations by differentiation."""

    duration: Scalar

    def __init__(self, duration=6.0):
        self.duration = jnp.asarray(duration)

    def angles(self, t):
        return 0.8 * jnp.sin(0.9 * t), 0.6 * jnp.sin(0.7 * t + 0.2), 0.7 * t

    def attitude(self, t):
        yaw, pitch, roll = self.angles(t)
        return qt.quaternion.product(qt.quaternion.product(rotation(2, yaw), rotation(1, pitch)), rotation(0, roll))

    def rate(self, t):
        _, pitch, roll = self.angles(t)
        yawing, pitching, rolling = 0.72 * jnp.cos(0.9 * t), 0.42 * jnp.cos(0.7 * t + 0.2), 0.7
        return jnp.stack(
            [
                rolling - yawing * jnp.sin(pitch),
                pitching * jnp.cos(roll) + yawing * jnp.cos(pitch) * jnp.sin(roll),
                -pitching * jnp.sin(roll) + yawing * jnp.cos(pitch) * jnp.cos(roll),
            ]
        )

    def __call__(self, t):
        t = jnp.asarray(t, self.duration.dtype)
        rate, acceleration = jax.jvp(self.rate, (t,), (jnp.ones_like(t),))
        return Attitude(self.attitude(t), rate, acceleration)


class Rest(AbstractProgram):
    """A program that stays at the identity."""

    duration: Scalar

    def __init__(self, dtype=None):
        self.duration = jnp.ones((), dtype)

    def __call__(self, t):
        zero = jnp.zeros((3,), self.duration.dtype)
        return Attitude(jnp.zeros((4,), zero.dtype).at[0].set(1.0), zero, zero)


class Choice(AbstractLaw):
    """One of several laws, selected by index, so that all share one compilation."""

    laws: tuple[AbstractLaw, ...]
    index: jax.Array

    def __call__(self, reference, quaternion, rate):
        return jnp.stack([law(reference, quaternion, rate) for law in self.laws])[self.index]

    def deviation(self, reference, quaternion):
        return jnp.stack([law.deviation(reference, quaternion) for law in self.laws])[self.index]


def random_gains(rng):
    """Stable gains (K1, K2) near critical damping: scalar, diagonal and full."""
    k = 1.3
    diagonal = np.array([1.0, 1.4, 0.9, 1.2])
    full1 = 2 * k * np.eye(4) + 0.2 * rng.normal(size=(4, 4))
    full2 = k * k * np.eye(4) + 0.2 * rng.normal(size=(4, 4))
    return [(2 * k, k * k), (2 * diagonal, diagonal**2), (full1, full2)]
