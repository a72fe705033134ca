"""Control position and attitude: the law of paper C for the attitude, and linear feedback for the position.

The attitude error satisfies μ̈ + K1μ̇ + K2(μ − 1) = 0. With the positions r of the body and r⁰ of the program, inertial
axes, the position error is e = r − r⁰. It satisfies ë + k1ė + k2e = 0, because the commanded acceleration is a = r̈⁰ −
k1ė − k2e. Both equations are exact and independent of the program and of each other. The pose error M therefore has a
closed form. With the poses Λ of the body and Λ⁰ of the program, M is the dual quaternion Λ̄⁰∘Λ = μ + s ½ ρ∘μ, where s is
the dual unit and ρ = λ̄⁰∘e∘λ⁰.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float
from typing_extensions import TypeAliasType

from qtraj.algebra import dual_quaternion
from qtraj.foundation.arrays import concrete, real_vector
from qtraj.foundation.devices import on_one_device
from qtraj.foundation.document import storable
from qtraj.foundation.shown import shown, shown_html
from qtraj.foundation.types import ArrayInput, DualQuat, Quat, Scalar, ScalarLike, Vec3
from qtraj.motion.attitude import AbstractProgram, Attitude
from qtraj.motion.checks import common_dtype, initial_quaternion, initial_rate, output_times
from qtraj.motion.control.hysteresis import require_continuous_law
from qtraj.motion.control.laws import AbstractLaw, AccelerationLaw, Gain, apply, commanded, gain
from qtraj.motion.simulation.initial_sign import NEARER, require_sign, start_quaternion
from qtraj.path.hodograph import AbstractHodograph, require_path

Position = TypeAliasType("Position", Float[Array, "3 3"])
"""An array with the rows position [m], velocity [m/s] and acceleration [m/s²], in inertial axes."""


@storable
class PoseProgram(eqx.Module):
    """A program for the position and the attitude of a body, consisting of a path and an attitude program.

    **Raises:** ValueError for a path or a program of another type.
    """

    path: AbstractHodograph
    attitude: AbstractProgram

    def __repr__(self) -> str:
        return shown(self)

    _repr_html_ = shown_html

    def __init__(self, path: AbstractHodograph, attitude: AbstractProgram):
        require_path(path)
        if not isinstance(attitude, AbstractProgram):
            raise ValueError(
                f"the attitude must be an attitude program such as FrameProgram(path), but {attitude!r} was given"
            )
        self.path, self.attitude = path, attitude

    @property
    def duration(self) -> Scalar:
        """The duration [s] of the path or of the attitude program, whichever is shorter."""
        return jnp.minimum(self.path.duration, self.attitude.duration)

    def __call__(self, t: ScalarLike) -> tuple[Position, Attitude]:
        """Return position, velocity and acceleration (3, 3) in inertial axes, and the attitude, at `t` [s]."""
        return self.path.derivatives(t, 2), self.attitude(t)

    def dual(self, t: ScalarLike) -> DualQuat:
        """Return the pose at `t` [s] as a dual quaternion Λ⁰ (8,)."""
        position, attitude = self(t)
        return dual_quaternion.from_pose(position[0], attitude.quaternion.astype(position.dtype))


@storable
class PoseLaw(eqx.Module):
    """A law for position and attitude, which commands the angular and the linear acceleration of a body.

    `attitude`: the law for the attitude, which must command accelerations and have no discrete state. `k1` [1/s], `k2`
    [1/s²]: the gains of the position feedback, each a scalar, (3,) for the three inertial axes, or a matrix (3, 3).

    **Raises:** ValueError for a law that commands rates or has a discrete state, for gains that are not finite or of
    another shape, and for scalar or diagonal gains that are not positive.
    """

    attitude: AbstractLaw
    k1: Gain
    k2: Gain

    def __repr__(self) -> str:
        return shown(self, k1="1/s", k2="1/s²")

    _repr_html_ = shown_html

    def __init__(self, attitude: AbstractLaw, k1: ArrayInput, k2: ArrayInput):
        require_continuous_law(attitude, "the attitude law")
        self.attitude, self.k1, self.k2 = attitude, gain(k1, "k1", 3), gain(k2, "k2", 3)
        for name, k in (("k1", self.k1), ("k2", self.k2)):
            value = concrete(k)
            if value is not None and value.ndim < 2 and not (value > 0).all():
                raise ValueError(f"the position gain {name} must be positive, but {value.tolist()} was given")

    @on_one_device
    def __call__(
        self, target: Position, reference: Attitude, position: Vec3, velocity: Vec3, quaternion: Quat, rate: Quat
    ) -> tuple[Quat, Vec3]:
        """Return the commands ε (4,) [rad/s²], body axes, virtual part first, and a (3,) [m/s²], inertial axes.

        `target` (3, 3), whose rows are position, velocity and acceleration, and `reference` are the values of the
        program, as returned by `PoseProgram`. The other arguments are the state of the body, with `rate` (4,) in body
        axes.
        """
        feedback = apply(self.k1, velocity - target[1]) + apply(self.k2, position - target[0])
        return commanded(self.attitude, None, reference, quaternion, rate), target[2] - feedback


def pose_error(program: DualQuat, body: DualQuat) -> DualQuat:
    """Return the pose error M = Λ̄⁰∘Λ (8,) with the real part μ and the dual part ½ρ∘μ; Λ⁰ = `program`, Λ = `body`.

    ρ = λ̄⁰∘(r − r⁰)∘λ⁰ is the position error in the axes of the program.
    """
    return dual_quaternion.product(dual_quaternion.conjugate(program), body)


def initial_state(
    program: PoseProgram, law: PoseLaw, state: tuple[ArrayInput, ...], times: ArrayInput, sign: str
) -> tuple[Float[Array, " n"], Float[Array, 14]]:
    """Return the instants, and the initial state λ, ω, r and v (14,), checked and in one dtype.

    The order of the argument `state` is different: r, v, λ and ω.

    **Raises:** ValueError for arguments of another type or shape, a `sign` that is not one of `SIGNS`, or times
    that do not increase.
    """
    require_sign(sign)
    if not isinstance(program, PoseProgram):
        raise ValueError(f"the program must be a PoseProgram(path, attitude), but {program!r} was given")
    if not isinstance(law, PoseLaw):
        raise ValueError(f"the law must be a PoseLaw(attitude, k1, k2), but {law!r} was given")
    position, velocity, quaternion, rate = state
    times, q = output_times(times), initial_quaternion(quaternion)
    rate = initial_rate(rate)
    r, v = real_vector(position, "the position", 3), real_vector(velocity, "the velocity", 3)
    dtype = common_dtype(times, q, rate, r, v)
    q = start_quaternion(sign, program(times[0])[1], q)
    return times.astype(dtype), jnp.concatenate([x.astype(dtype) for x in (q, rate, r, v)])


def closed_pose(
    program: PoseProgram,
    law: PoseLaw,
    position: ArrayInput,
    velocity: ArrayInput,
    quaternion: ArrayInput,
    rate: ArrayInput,
    times: ArrayInput,
    *,
    sign: str = NEARER,
) -> Float[Array, "n 8"]:
    """Compute the poses Λ (n, 8) at `times` [s] in closed form, without disturbances, from the state at times[0].

    The state and `sign` are as in `simulate_pose`, which computes the same motion by integration.

    **Raises:** ValueError for arguments of another type or shape, a `sign` other than "nearer" or "as given", times
    that do not increase, or an attitude law that is not an `AccelerationLaw`.
    """
    times, state = initial_state(program, law, (position, velocity, quaternion, rate), times, sign)
    attitude = law.attitude
    if not isinstance(attitude, AccelerationLaw):
        raise ValueError(
            f"the pose has a closed form only if the attitude law is an AccelerationLaw, but {attitude!r} was given"
        )
    return _closed_pose(program, attitude, (law.k1, law.k2), state, times)


@eqx.filter_jit
def _closed_pose(
    program: PoseProgram,
    law: AccelerationLaw,
    gains: tuple[Gain, Gain],
    state: Float[Array, " 14"],
    times: Float[Array, " n"],
) -> Float[Array, "n 8"]:
    """Return the poses; `law` controls the attitude, and `gains` are k1 and k2 of the position feedback."""
    from qtraj.motion.control.closed_form import closed_motion

    quaternion, rate, position, velocity = state[:4], state[4:8], state[8:11], state[11:]
    targets, references = jax.vmap(program)(times)
    quaternions = closed_motion(law, references, quaternion, rate, times).quaternion
    k1, k2 = (jnp.diag(jnp.broadcast_to(k, (3,))) if k.ndim < 2 else k for k in gains)
    zero, one = jnp.zeros((3, 3), position.dtype), jnp.eye(3, dtype=position.dtype)
    matrix = jnp.block([[zero, one], [-k2.astype(position.dtype), -k1.astype(position.dtype)]])
    start = jnp.concatenate([position - targets[0, 0], velocity - targets[0, 1]])
    errors = jax.vmap(lambda t: jnp.matmul(jax.scipy.linalg.expm(matrix * (t - times[0])), start)[:3])(times)
    return jax.vmap(dual_quaternion.from_pose)(targets[:, 0] + errors, quaternions)
