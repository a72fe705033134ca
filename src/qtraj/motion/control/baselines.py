"""Three established attitude feedbacks with nonlinear closed loops, as baselines for comparison.

All impose Ω̇ = −K1Ω − K2 e on the rate error Ω = ω_v − w, w = μ⁻¹ω⁰μ. They differ in the attitude error e, which for
small angles Φ is Φ times the axis. The program is fed forward, so the error does not depend on the motion of the
program. Gains are a scalar, (3,) for a diagonal, or (3, 3). The virtual part of the command is 0, and |λ| has no
effect.
"""

import jax.numpy as jnp

from qtraj.algebra.quaternion import conjugate, rotate, unit
from qtraj.algebra.rotation import to_rotation_vector
from qtraj.foundation.document import storable
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Quat, Vec3
from qtraj.motion.attitude import Attitude, require_body_axes
from qtraj.motion.control.errors import error_quaternion, pure
from qtraj.motion.control.laws import AbstractLaw, Gain, apply, gain


@storable
class QuaternionFeedback(AbstractLaw):
    """e = 2 sgn(μ0) μ_v/|μ|, of magnitude 2 sin Φ/2 (Wie & Barba 1985; Yuan 1988, reference [4] of paper C).

    `k1` [1/s], `k2` [1/s²]. The sign selects the shorter rotation; at μ0 = 0 it is +.
    """

    k1: Gain
    k2: Gain

    def __init__(self, k1: ArrayInput, k2: ArrayInput):
        self.k1, self.k2 = gain(k1, "k1", 3), gain(k2, "k2", 3)

    def __repr__(self) -> str:
        return shown(self, k1="1/s", k2="1/s²")

    def __call__(self, reference: Attitude, quaternion: Quat, rate: Quat) -> Quat:
        """The command (4,) [rad/s²] in body axes; its virtual part is 0."""
        mu = error_quaternion(reference, quaternion)
        return signed_quaternion_feedback(self, reference, jnp.where(mu[0] < 0, -quaternion, quaternion), rate)

    def deviation(self, reference: Attitude, quaternion: Quat) -> Quat:
        """The error quaternion μ (4,)."""
        return error_quaternion(reference, quaternion)


@storable
class GeometricFeedback(AbstractLaw):
    """e = ½(R_dᵀR − RᵀR_d)^∨, of magnitude sin Φ: half the sum of the cross products of the axes.

    `k1` [1/s], `k2` [1/s²]. Lee's feedback on SO(3); in robotics it is due to Luh and to Fu & Gonzalez (reference [3]
    of paper C). Beyond Φ = π/2 the error decreases, and it vanishes at Φ = π.
    """

    k1: Gain
    k2: Gain

    def __init__(self, k1: ArrayInput, k2: ArrayInput):
        self.k1, self.k2 = gain(k1, "k1", 3), gain(k2, "k2", 3)

    def __repr__(self) -> str:
        return shown(self, k1="1/s", k2="1/s²")

    def __call__(self, reference: Attitude, quaternion: Quat, rate: Quat) -> Quat:
        """The command (4,) [rad/s²] in body axes; its virtual part is 0."""
        mu = unit(error_quaternion(reference, quaternion))
        return _feedback(self, reference, mu, rate, 2 * mu[0] * mu[1:])

    def deviation(self, reference: Attitude, quaternion: Quat) -> Quat:
        """The error quaternion μ (4,)."""
        return error_quaternion(reference, quaternion)


@storable
class LogarithmicFeedback(AbstractLaw):
    """e = the rotation vector of the error, of magnitude Φ ≤ π. `k1` [1/s], `k2` [1/s²]. The error jumps at Φ = π."""

    k1: Gain
    k2: Gain

    def __init__(self, k1: ArrayInput, k2: ArrayInput):
        self.k1, self.k2 = gain(k1, "k1", 3), gain(k2, "k2", 3)

    def __repr__(self) -> str:
        return shown(self, k1="1/s", k2="1/s²")

    def __call__(self, reference: Attitude, quaternion: Quat, rate: Quat) -> Quat:
        """The command (4,) [rad/s²] in body axes; its virtual part is 0."""
        mu = error_quaternion(reference, quaternion)
        return _feedback(self, reference, mu, rate, to_rotation_vector(mu))

    def deviation(self, reference: Attitude, quaternion: Quat) -> Quat:
        """The error quaternion μ (4,)."""
        return error_quaternion(reference, quaternion)


def signed_quaternion_feedback(law: QuaternionFeedback, reference: Attitude, quaternion: Quat, rate: Quat) -> Quat:
    """The command of `law` with e = 2μ_v/|μ|, without changing the sign of λ."""
    mu = unit(error_quaternion(reference, quaternion))
    return _feedback(law, reference, mu, rate, 2 * mu[1:])


def _feedback(
    law: QuaternionFeedback | GeometricFeedback | LogarithmicFeedback,
    reference: Attitude,
    mu: Quat,
    rate: Quat,
    attitude_error: Vec3,
) -> Quat:
    """(0, μ⁻¹ε⁰μ + w×Ω − K1Ω − K2e): the program's acceleration in body axes plus the feedback."""
    require_body_axes(reference)
    back = conjugate(mu)
    w = rotate(back, reference.rate)
    rate_error = rate[1:] - w
    forward = rotate(back, reference.acceleration) + jnp.cross(w, rate_error)
    return pure(forward - apply(law.k1, rate_error) - apply(law.k2, attitude_error))
