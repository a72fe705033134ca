"""A law for position and attitude: paper C's law for the attitude, and linear feedback for the position.

The attitude error satisfies μ̈ + K1μ̇ + K2(μ − 1) = 0. The position error e = r − r⁰, inertial axes, satisfies ë + k1ė
+ k2e = 0 with the commanded acceleration a = r̈⁰ − k1ė − k2e. Both equations are exact and independent of the program
and of each other. The pose error, the dual quaternion M = Λ̄⁰∘Λ = μ + s ½ ρ∘μ with ρ = λ̄⁰∘e∘λ⁰, therefore has a closed
form.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float
from typing_extensions import TypeAliasType

from qtraj.algebra import dual_quaternion
from qtraj.algebra.dual_quaternion import DualQuat
from qtraj.foundation.document import storable
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Quat, Scalar, ScalarLike, Vec3
from qtraj.motion.attitude import AbstractProgram, Attitude
from qtraj.motion.control.laws import AbstractLaw, AccelerationLaw, Gain, RateLaw, apply, gain
from qtraj.path.hodograph import AbstractHodograph

Position = TypeAliasType("Position", Float[Array, "3 3"])
"""Rows: position, velocity and acceleration, inertial axes."""


@storable
class PoseProgram(eqx.Module):
    """The reference for position and attitude of a body: a path and an attitude program.

    **Raises:** ValueError for a path or a program of another type.
    """

    path: AbstractHodograph
    attitude: AbstractProgram

    def __repr__(self) -> str:
        return shown(self)

    def __init__(self, path: AbstractHodograph, attitude: AbstractProgram):
        if not isinstance(path, AbstractHodograph):
            raise ValueError(f"the path must be a position curve such as SpiralHelix or Curve, but {path!r} was given")
        if not isinstance(attitude, AbstractProgram):
            raise ValueError(f"the attitude must be a program such as FrameProgram(path), but {attitude!r} was given")
        self.path, self.attitude = path, attitude

    @property
    def duration(self) -> Scalar:
        """The duration of the path or of the attitude program, whichever is shorter [s]."""
        return jnp.minimum(self.path.duration, self.attitude.duration)

    def __call__(self, t: ScalarLike) -> tuple[Position, Attitude]:
        """Position, velocity and acceleration (3, 3) [m, m/s, m/s²], inertial axes, and the attitude at `t` [s]."""
        return self.path.derivatives(t, 2), self.attitude(t)

    def dual(self, t: ScalarLike) -> DualQuat:
        """The pose at `t` [s] as a dual quaternion Λ⁰ (8,)."""
        position, attitude = self(t)
        return dual_quaternion.from_pose(position[0], attitude.quaternion.astype(position.dtype))


@storable
class PoseLaw(eqx.Module):
    """A law for a pose: `attitude` commands the angular acceleration, and linear feedback the linear acceleration.

    `attitude`: a law that commands accelerations and has no discrete state. `k1` [1/s], `k2` [1/s²]: the gains of the
    position feedback, scalars, (3,) along inertial axes, or (3, 3).

    **Raises:** ValueError for another kind of law, and for gains that are not finite or of another shape.
    """

    attitude: AbstractLaw
    k1: Gain
    k2: Gain

    def __repr__(self) -> str:
        return shown(self, k1="1/s", k2="1/s²")

    def __init__(self, attitude: AbstractLaw, k1: ArrayInput, k2: ArrayInput):
        if not isinstance(attitude, AbstractLaw) or isinstance(attitude, RateLaw) or hasattr(attitude, "half_width"):
            raise ValueError(
                "the attitude law must command accelerations and have no discrete state, like "
                f"AccelerationLaw(2.0, 1.0), but {attitude!r} was given"
            )
        self.attitude, self.k1, self.k2 = attitude, gain(k1, "k1", 3), gain(k2, "k2", 3)

    def __call__(
        self, target: Position, reference: Attitude, position: Vec3, velocity: Vec3, quaternion: Quat, rate: Quat
    ) -> tuple[Quat, Vec3]:
        """The commands ε (4,) [rad/s²], body axes, with the virtual part first, and a (3,) [m/s²], inertial axes.

        `target` and `reference` are the program's position and attitude; the other arguments are the body's state.
        """
        feedback = apply(self.k1, velocity - target[1]) + apply(self.k2, position - target[0])
        return self.attitude(reference, quaternion, rate), target[2] - feedback


def pose_error(program: DualQuat, body: DualQuat) -> DualQuat:
    """M = Λ̄⁰∘Λ: real part μ, dual part ½ρ∘μ with the position error in the program's axes, ρ = λ̄⁰∘(r − r⁰)∘λ⁰."""
    return dual_quaternion.product(dual_quaternion.conjugate(program), body)


@eqx.filter_jit
def closed_pose(
    program: PoseProgram,
    law: PoseLaw,
    position: Vec3,
    velocity: Vec3,
    quaternion: Quat,
    rate: Quat,
    times: Float[Array, " n"],
) -> Float[Array, "n 8"]:
    """The undisturbed poses Λ (n, 8) at `times` [s] in closed form, from a state at the first of them.

    **Raises:** ValueError for an attitude law without a linear error equation.
    """
    from qtraj.motion.control.closed_form import closed_motion

    if not isinstance(law.attitude, AccelerationLaw):
        raise ValueError(f"only an AccelerationLaw has a closed form, but {law.attitude!r} was given")
    targets, references = jax.vmap(program)(times)
    quaternions = closed_motion(law.attitude, references, quaternion, rate, times).quaternion
    k1, k2 = (jnp.diag(jnp.broadcast_to(k, (3,))) if k.ndim < 2 else k for k in (law.k1, law.k2))
    zero, one = jnp.zeros((3, 3), position.dtype), jnp.eye(3, dtype=position.dtype)
    matrix = jnp.block([[zero, one], [-k2.astype(position.dtype), -k1.astype(position.dtype)]])
    start = jnp.concatenate([position - targets[0, 0], velocity - targets[0, 1]])
    errors = jax.vmap(lambda t: jnp.matmul(jax.scipy.linalg.expm(matrix * (t - times[0])), start)[:3])(times)
    return jax.vmap(dual_quaternion.from_pose)(targets[:, 0] + errors, quaternions)
