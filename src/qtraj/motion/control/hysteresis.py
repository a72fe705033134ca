"""Define a law that stores the sign of its error quaternion and changes this sign with hysteresis.

λ and −λ represent the same attitude. A law that uses the nearer of λ and −λ at every instant is discontinuous at half
turns, where noise can cause chattering. A law that never changes the sign rotates the body by more than a half turn
(unwinding) if the error exceeds a half turn. Mayhew, Sanfelice and Teel (IEEE Trans. Automatic Control 56, 2011,
2555–2566) store a sign h = ±1 and change it only if hμ0 < −δ|μ|. Here μ is the error quaternion, μ0 its scalar part,
and δ the half-width of the hysteresis. Then noise that changes μ0/|μ| by less than 2δ cannot cause repeated switching,
and the angle of the correction is at most 2 arccos(−δ).
"""

from __future__ import annotations

from typing import Any, ClassVar

import jax.numpy as jnp

from qtraj.foundation.arrays import concrete, real_scalar
from qtraj.foundation.devices import on_one_device
from qtraj.foundation.document import storable
from qtraj.foundation.float_arguments import float_arguments
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Flag, Quat, Scalar
from qtraj.motion.attitude import Attitude
from qtraj.motion.control.baselines import QuaternionFeedback, signed_quaternion_feedback
from qtraj.motion.control.errors import error_quaternion
from qtraj.motion.control.laws import AbstractLaw, AccelerationLaw, has_state
from qtraj.motion.simulation.actuator import Sampling, sampling_instants

HALF_WIDTH = 0.25
"""The default half-width δ, with which the sign changes at an error of 2 arccos(−0.25) = 209°.

Noise that changes μ0/|μ| by less than 0.5 then causes no chattering.
"""


@storable
class HystereticLaw(AbstractLaw):
    """A law with a stored sign h of λ: `law` is applied to hλ, and h changes sign if hμ0 < −`half_width`·|μ|.

    μ is the error quaternion, and μ0 its scalar part. `law`: an `AccelerationLaw`, with an error equation that is
    linear between changes of the sign, or a `QuaternionFeedback`, which results in the law of Mayhew, Sanfelice and
    Teel. `half_width` δ, 0 ≤ δ < 1: with 0, each update selects the nearer of λ and −λ, and noise can cause chattering.
    `sampling` [s]: the period, or the instants, of the updates of the sign; the command is continuous between updates.
    Omit `sampling` if the sensor or the actuator is sampled. The sign is then updated with each new command.

    In `qtraj.simulate`, h starts at 1 for the initial λ, and the `quaternion` of the solution is hλ. If you call the
    law directly, it uses λ without changing the sign.

    **Raises:** ValueError for a `law` that is neither an `AccelerationLaw` nor a `QuaternionFeedback`, a half-width
    outside [0, 1), or an invalid `sampling`.
    """

    law: AccelerationLaw | QuaternionFeedback
    half_width: Scalar
    sampling: Sampling | None
    vectorized: ClassVar[bool] = True

    def __repr__(self) -> str:
        return shown(self, sampling="s")

    def __init__(
        self,
        law: AccelerationLaw | QuaternionFeedback,
        half_width: ArrayInput = HALF_WIDTH,
        sampling: ArrayInput | None = None,
    ):
        if not isinstance(law, AccelerationLaw | QuaternionFeedback):
            raise ValueError(
                f"a HystereticLaw needs an AccelerationLaw or a QuaternionFeedback, but {law!r} was given. Other laws "
                "must choose the sign of λ themselves, for example by the scalar part of the error quaternion."
            )
        self.law = law
        self.half_width = real_scalar(half_width, "the half-width")
        value = concrete(self.half_width)
        if value is not None and not 0 <= value < 1:
            raise ValueError(
                "the half-width of the hysteresis is compared with μ0/|μ| and must be in [0, 1), but "
                f"{float(value)} was given. The default 0.25 tolerates most sensor noise."
            )
        self.sampling = sampling_instants(sampling)

    @float_arguments
    def __call__(self, reference: Attitude, quaternion: Quat, rate: Quat) -> Quat:
        """Return the command (4,) [rad/s²] in body axes; the sign of `quaternion` is not changed."""
        if isinstance(self.law, QuaternionFeedback):
            return signed_quaternion_feedback(self.law, reference, quaternion, rate)
        return self.law(reference, quaternion, rate)

    def deviation(self, reference: Attitude, quaternion: Quat) -> Quat:
        """Return the error quaternion of `law` (4,)."""
        return self.law.deviation(reference, quaternion)

    @on_one_device
    def updated_sign(self, sign: Scalar, reference: Attitude, quaternion: Quat) -> Scalar:
        """Return the updated sign h at this attitude: −`sign` if sign·μ0 < −δ|μ|, and `sign` otherwise."""
        return jnp.where(self.switches(sign, reference, quaternion), -sign, sign)

    @on_one_device
    def switches(self, sign: Scalar, reference: Attitude, quaternion: Quat) -> Flag:
        """Return whether the sign changes at this attitude."""
        mu = error_quaternion(reference, quaternion)
        size = jnp.sqrt(jnp.sum(mu * mu))
        return sign * mu[0] < -self.half_width.astype(mu.dtype) * size


def without_hysteresis(law: AbstractLaw) -> AbstractLaw:
    """Return the law without its hysteresis."""
    return law.law if isinstance(law, HystereticLaw) else law


def initial_sign(law: AbstractLaw, quaternion: Quat) -> Scalar | None:
    """Return the initial sign h = 1, or None for laws without hysteresis."""
    return jnp.ones_like(quaternion, shape=()) if isinstance(law, HystereticLaw) else None


def updated_sign(law: AbstractLaw, sign: Scalar | None, reference: Attitude, quaternion: Quat) -> Scalar | None:
    """Return the updated sign at this attitude, or None for laws without hysteresis."""
    if sign is None or not isinstance(law, HystereticLaw):
        return sign
    return law.updated_sign(sign, reference, quaternion)


def with_sign(sign: Scalar | None, quaternion: Quat) -> Quat:
    """Return hλ for h = `sign` and λ = `quaternion`; return λ if `sign` is None."""
    return quaternion if sign is None else sign * quaternion


def require_continuous_law(law: Any, name: str) -> None:
    """Raise a ValueError unless `law` commands accelerations and has no state; `name` is for the message."""
    valid = isinstance(law, AbstractLaw) and law.commands == "acceleration" and not has_state(law)
    if not valid or isinstance(law, HystereticLaw):
        raise ValueError(
            f"{name} must be a law that commands accelerations and has no discrete state, and none of its own, such as "
            f"AccelerationLaw(2.0, 1.0), but "
            f"{law!r} was given"
        )
