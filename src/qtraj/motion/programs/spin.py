"""Define spins: rotations at a constant rate."""

import numpy as np

from qtraj.algebra import quaternion, rotation
from qtraj.foundation.arrays import concrete, one_instant, real_scalar, real_vector, require_positive
from qtraj.foundation.devices import on_one_device
from qtraj.foundation.document import storable
from qtraj.foundation.namespace import in_numpy, of_arrays
from qtraj.foundation.seconds import seconds
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Quat, Scalar, ScalarLike, Vec3
from qtraj.motion.attitude import AbstractProgram, Attitude
from qtraj.motion.checks import require_axes, require_precise_angle, shared_dtype


@storable
class Spin(AbstractProgram):
    """A rotation at a constant rate, λ⁰(t) = λ_0∘(cos(ωt/2) + e sin(ωt/2)) with the axis e and the rate ω.

    The rate is then constant in body axes and in inertial axes, and the acceleration is zero. The quaternion is
    continuous, so it changes its sign after a whole turn. Outside [0, duration] the spin continues.

    Args:
        rate: The angular rate (3,) [rad/s]; it may be zero. The field `rate` is in body axes.
        duration: The duration [s].
        start_q: The attitude λ_0 (4,) at the start, of any norm except zero.
        axes: The axes of the argument `rate`, "body" or "inertial".

    Raises:
        ValueError: For values that are not finite or of another shape, a zero quaternion, a duration that is not
            positive, an angle so large that its rounding error exceeds 0.01 rad, or unknown `axes`.

    Example:
        >>> spin = Spin([0.0, 0.0, 0.1], 60.0)
        >>> [round(float(x), 4) for x in spin(10.0).quaternion]
        [0.8776, 0.0, 0.0, 0.4794]
    """

    rate: Vec3
    duration: Scalar
    start_q: Quat

    @on_one_device
    def __init__(
        self,
        rate: ArrayInput,
        duration: ArrayInput,
        start_q: ArrayInput = (1.0, 0.0, 0.0, 0.0),
        axes: str = "body",
    ):
        require_axes(axes)
        omega, start = real_vector(rate, "the rate of a spin", 3), real_vector(start_q, "start_q", 4)
        span = real_scalar(seconds(duration), "the duration of a spin")
        require_positive(span, "the duration of a spin", "s")
        values = concrete(start)
        if values is not None and not values.any():
            raise ValueError("start_q must not be zero, because zero does not represent an attitude")
        dtype = shared_dtype(omega, span, start)
        require_precise_angle(span.astype(dtype) * abs(omega.astype(dtype)).max(), "the angle of a spin")
        self.start_q, self.duration = start.astype(dtype), span.astype(dtype)
        body = omega if axes == "body" else quaternion.rotate(quaternion.conjugate(start), omega)
        self.rate = body.astype(dtype)

    def __repr__(self) -> str:
        return shown(self, rate="rad/s", duration="s")

    def __call__(self, t: ScalarLike) -> Attitude:
        """Return the attitude at the time `t` [s]."""
        return _attitude(self, one_instant(t))

    @property
    def end(self) -> Quat:
        """The unit quaternion at the end of the spin."""
        return _turned(self.start_q, self.rate, self.duration)


@in_numpy
def _attitude(spin: Spin, t: Scalar) -> Attitude:
    """Return the attitude at one time [s]."""
    return Attitude(_turned(spin.start_q, spin.rate, t), spin.rate, np.zeros(3) * spin.rate)


@of_arrays
def _turned(start: Quat, rate: Vec3, t: Scalar) -> Quat:
    return quaternion.product(quaternion.unit(start), rotation.from_rotation_vector(t.astype(rate.dtype) * rate))
