"""Define three established attitude feedback laws with nonlinear closed loops, as baselines for comparison.

Let μ be the body error (see `errors`), μ0 its scalar part, μ_v its vector part, and Φ the error angle. With each law,
the rate error Ω = ω_v − w satisfies Ω̇ = −K1Ω − K2e. ω_v is the rate of the body. w = μ⁻¹ω⁰μ is the rate of the program
in body axes, and ω⁰ the same rate in program axes. The laws differ in the attitude error e. For small Φ, e is
approximately Φ times the unit vector of the rotation axis. The acceleration of the program is fed forward, so the error
does not depend on the motion of the program. Each gain is a scalar, a diagonal (3,) or a matrix (3, 3). The virtual
part of the command is 0, and the norm of the body's quaternion has no effect.
"""

from typing import ClassVar

import jax.numpy as jnp

from qtraj.algebra.quaternion import conjugate, rotate, unit
from qtraj.algebra.rotation import to_rotation_vector
from qtraj.foundation.document import storable
from qtraj.foundation.float_arguments import float_arguments
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Quat, Vec3
from qtraj.motion.attitude import Attitude, require_body_axes
from qtraj.motion.control.errors import error_quaternion, pure
from qtraj.motion.control.laws import AbstractLaw, Gain, apply, gain


@storable
class QuaternionFeedback(AbstractLaw):
    """The law with e = 2 sgn(μ0) μ_v/|μ|, |e| = 2 sin(Φ/2) (Wie & Barba 1985; Yuan 1988, reference [4] of paper C).

    μ is the body error with the scalar part μ0 and the vector part μ_v, and Φ is the error angle. The factor sgn(μ0)
    selects the shorter rotation; it is +1 for μ0 = 0. The gains are `k1` [1/s] and `k2` [1/s²].
    """

    k1: Gain
    k2: Gain
    vectorized: ClassVar[bool] = True

    def __init__(self, k1: ArrayInput, k2: ArrayInput):
        self.k1, self.k2 = gain(k1, "k1", 3), gain(k2, "k2", 3)

    def __repr__(self) -> str:
        return shown(self, k1="1/s", k2="1/s²")

    @float_arguments
    def __call__(self, reference: Attitude, quaternion: Quat, rate: Quat) -> Quat:
        """Return the command (4,) [rad/s²] in body axes; its virtual part is 0."""
        mu = error_quaternion(reference, quaternion)
        return signed_quaternion_feedback(self, reference, jnp.where(mu[..., :1] < 0, -quaternion, quaternion), rate)

    def deviation(self, reference: Attitude, quaternion: Quat) -> Quat:
        """Return the error quaternion μ (4,)."""
        return error_quaternion(reference, quaternion)


@storable
class GeometricFeedback(AbstractLaw):
    """The law with e = ½(R_dᵀR − RᵀR_d)^∨, |e| = sin Φ; Φ is the error angle.

    R and R_d are the rotation matrices to inertial axes from body axes and from program axes. ^∨ denotes the vector of
    a skew-symmetric matrix. The gains are `k1` [1/s] and `k2` [1/s²]. e is half the sum of the cross products of
    corresponding axes of program and body. Lee proposed this feedback on SO(3); in robotics it is attributed to Luh and
    to Fu & Gonzalez (reference [3] of paper C). For Φ > π/2 the magnitude |e| decreases with Φ, and for Φ = π it is
    zero.
    """

    k1: Gain
    k2: Gain
    vectorized: ClassVar[bool] = True

    def __init__(self, k1: ArrayInput, k2: ArrayInput):
        self.k1, self.k2 = gain(k1, "k1", 3), gain(k2, "k2", 3)

    def __repr__(self) -> str:
        return shown(self, k1="1/s", k2="1/s²")

    @float_arguments
    def __call__(self, reference: Attitude, quaternion: Quat, rate: Quat) -> Quat:
        """Return the command (4,) [rad/s²] in body axes; its virtual part is 0."""
        mu = unit(error_quaternion(reference, quaternion))
        return _feedback(self, reference, mu, rate, 2 * mu[..., :1] * mu[..., 1:])

    def deviation(self, reference: Attitude, quaternion: Quat) -> Quat:
        """Return the error quaternion μ (4,)."""
        return error_quaternion(reference, quaternion)


@storable
class LogarithmicFeedback(AbstractLaw):
    """Feedback of the rotation vector e of the error quaternion μ, with |e| = Φ ≤ π; e is discontinuous at Φ = π.

    Φ is the error angle. The gains are `k1` [1/s] and `k2` [1/s²].
    """

    k1: Gain
    k2: Gain
    vectorized: ClassVar[bool] = True

    def __init__(self, k1: ArrayInput, k2: ArrayInput):
        self.k1, self.k2 = gain(k1, "k1", 3), gain(k2, "k2", 3)

    def __repr__(self) -> str:
        return shown(self, k1="1/s", k2="1/s²")

    @float_arguments
    def __call__(self, reference: Attitude, quaternion: Quat, rate: Quat) -> Quat:
        """Return the command (4,) [rad/s²] in body axes; its virtual part is 0."""
        mu = error_quaternion(reference, quaternion)
        return _feedback(self, reference, mu, rate, to_rotation_vector(mu))

    def deviation(self, reference: Attitude, quaternion: Quat) -> Quat:
        """Return the error quaternion μ (4,)."""
        return error_quaternion(reference, quaternion)


BASELINES = {"quaternion": QuaternionFeedback, "geometric": GeometricFeedback, "logarithmic": LogarithmicFeedback}
"""The laws of this module by name."""


def signed_quaternion_feedback(law: QuaternionFeedback, reference: Attitude, quaternion: Quat, rate: Quat) -> Quat:
    """Return the command of `law` with e = 2μ_v/|μ|, without changing the sign of λ."""
    mu = unit(error_quaternion(reference, quaternion))
    return _feedback(law, reference, mu, rate, 2 * mu[..., 1:])


def _feedback(
    law: QuaternionFeedback | GeometricFeedback | LogarithmicFeedback,
    reference: Attitude,
    mu: Quat,
    rate: Quat,
    attitude_error: Vec3,
) -> Quat:
    """Return the command (0, ẇ − K1Ω − K2e), where e is `attitude_error`.

    ẇ = μ⁻¹ε⁰μ + w×Ω is the time derivative of w, and ε⁰ the acceleration of the program in program axes.
    """
    require_body_axes(reference)
    back = conjugate(mu)
    w = rotate(back, reference.rate)
    rate_error = rate[..., 1:] - w
    forward = rotate(back, reference.acceleration) + jnp.cross(w, rate_error)
    return pure(forward - apply(law.k1, rate_error) - apply(law.k2, attitude_error))
