"""Choose the initial sign of λ; λ and −λ represent the same attitude, but result in different closed-loop motions."""

from qtraj.foundation.namespace import in_numpy, stop_gradient, xp
from qtraj.foundation.types import Flag, Quat
from qtraj.motion.attitude import Attitude

NEARER, AS_GIVEN = "nearer", "as given"
SIGNS = (NEARER, AS_GIVEN)


def require_sign(sign: str) -> None:
    """Raise a ValueError for a sign that is not one of `SIGNS`."""
    if sign not in SIGNS:
        raise ValueError(
            f"sign must be 'nearer' (λ or −λ, whichever is nearer to the program) or 'as given', but {sign!r} was given"
        )


def start_quaternion(sign: str, reference: Attitude, quaternion: Quat) -> Quat:
    """Return λ = `quaternion`, or −λ if `sign` is "nearer" and the error quaternion has a negative scalar part."""
    if sign == AS_GIVEN:
        return quaternion
    return _with_sign_of(is_far(reference, quaternion), quaternion)


def is_far(reference: Attitude, quaternion: Quat) -> Flag:
    """Return whether the error quaternion of λ = `quaternion` has a negative scalar part."""
    return _is_far(reference.quaternion, quaternion)


@in_numpy
def _is_far(reference: Quat, quaternion: Quat) -> Flag:
    return stop_gradient(xp.sum(reference.astype(quaternion.dtype) * quaternion)) < 0


@in_numpy
def _with_sign_of(far: Flag, quaternion: Quat) -> Quat:
    return xp.where(far, -quaternion, quaternion)
