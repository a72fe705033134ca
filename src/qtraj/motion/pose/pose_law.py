"""A law for position and attitude: the second paper's on the attitude, and its linear counterpart on the position.

The attitude obeys μ̈ + K1μ̇ + K2(μ − 1) = 0 as without a position. The position error e = r − r⁰, inertial axes, obeys
ë + k1ė + k2e = 0 under a = r̈⁰ − k1ė − k2e. Both are exact and independent of the program and of each other, so the
error of the pose, as a dual quaternion M = Λ̄⁰∘Λ = μ + s ½ ρ∘μ with ρ = λ̄⁰∘e∘λ⁰, is known in closed form.
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

Place = TypeAliasType("Place", Float[Array, "3 3"])
"""Position, velocity and acceleration, a row each."""


@storable
class PoseProgram(eqx.Module):
    """The wanted position and attitude of a body: a path and an attitude program.

    **Raises:** ValueError for a path or a program of another type.
    """

    path: AbstractHodograph
    attitude: AbstractProgram

    def __repr__(self) -> str:
        return shown(self)

    def __init__(self, path: AbstractHodograph, attitude: AbstractProgram):
        if not isinstance(path, AbstractHodograph):
            raise ValueError(f"the path must be a hodograph such as SpiralHelix or Curve, but {path!r} was given")
        if not isinstance(attitude, AbstractProgram):
            raise ValueError(f"the attitude must be a program such as FrameProgram(path), but {attitude!r} was given")
        self.path, self.attitude = path, attitude

    @property
    def duration(self) -> Scalar:
        """The shorter of both durations [s]."""
        return jnp.minimum(self.path.duration, self.attitude.duration)

    def __call__(self, t: ScalarLike) -> tuple[Place, Attitude]:
        """Position [m], velocity and acceleration (3, 3), inertial axes, and the attitude, at one instant [s]."""
        return self.path.derivatives(t, 2), self.attitude(t)

    def dual(self, t: ScalarLike) -> DualQuat:
        """The pose as a dual quaternion Λ⁰ (8,)."""
        place, attitude = self(t)
        return dual_quaternion.from_pose(place[0], attitude.quaternion.astype(place.dtype))


@storable
class PoseLaw(eqx.Module):
    """Angular acceleration by `attitude`, an acceleration law, and linear acceleration by two gains.

    `k1` [1/s] and `k2` [1/s²] of the position: a scalar, (3,) along inertial axes, or (3, 3).

    **Raises:** ValueError for a law that commands rates or is of another type, and for gains of another shape or not
    finite.
    """

    attitude: AbstractLaw
    k1: Gain
    k2: Gain

    def __repr__(self) -> str:
        return shown(self, k1="1/s", k2="1/s²")

    def __init__(self, attitude: AbstractLaw, k1: ArrayInput, k2: ArrayInput):
        if not isinstance(attitude, AbstractLaw) or isinstance(attitude, RateLaw) or hasattr(attitude, "half_width"):
            raise ValueError(
                f"the law of the attitude must give accelerations from the state alone, as AccelerationLaw does, but "
                f"{attitude!r} was given"
            )
        self.attitude, self.k1, self.k2 = attitude, gain(k1, "k1", 3), gain(k2, "k2", 3)

    def __call__(
        self, place: Place, reference: Attitude, position: Vec3, velocity: Vec3, quaternion: Quat, rate: Quat
    ) -> tuple[Quat, Vec3]:
        """ε (4,) [rad/s²], body axes, virtual part first, and the acceleration a (3,) [m/s²], inertial axes."""
        feedback = apply(self.k1, velocity - place[1]) + apply(self.k2, position - place[0])
        return self.attitude(reference, quaternion, rate), place[2] - feedback


def pose_error(program: DualQuat, body: DualQuat) -> DualQuat:
    """M = Λ̄⁰∘Λ: the real part is μ, the dual part ½ρ∘μ with ρ = λ̄⁰∘(r − r⁰)∘λ⁰, the offset in the program's axes."""
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
    """The poses Λ (n, 8) in closed form, without disturbances, from a state at the first of `times` [s].

    **Raises:** ValueError for an attitude law whose error is not linear.
    """
    from qtraj.motion.control.closed_form import closed_motion

    if not isinstance(law.attitude, AccelerationLaw):
        raise ValueError(f"only an AccelerationLaw has a closed form, but {law.attitude!r} was given")
    places, references = jax.vmap(program)(times)
    turned = closed_motion(law.attitude, references, quaternion, rate, times).quaternion
    k1, k2 = (jnp.diag(jnp.broadcast_to(k, (3,))) if k.ndim < 2 else k for k in (law.k1, law.k2))
    zero, one = jnp.zeros((3, 3), position.dtype), jnp.eye(3, dtype=position.dtype)
    block = jnp.block([[zero, one], [-k2.astype(position.dtype), -k1.astype(position.dtype)]])
    start = jnp.concatenate([position - places[0, 0], velocity - places[0, 1]])
    errors = jax.vmap(lambda t: jnp.matmul(jax.scipy.linalg.expm(block * (t - times[0])), start)[:3])(times)
    return jax.vmap(dual_quaternion.from_pose)(places[:, 0] + errors, turned)
