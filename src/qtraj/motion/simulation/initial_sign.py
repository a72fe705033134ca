"""Choose the initial sign of λ; λ and −λ represent the same attitude, but result in different closed-loop motions."""

from qtraj.foundation.namespace import in_numpy, stop_gradient, xp
from qtraj.foundation.types import Quat
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
    return _nearer(reference.quaternion, quaternion)


@in_numpy
def _nearer(reference: Quat, quaternion: Quat) -> Quat:
    far = stop_gradient(xp.sum(reference.astype(quaternion.dtype) * quaternion)) < 0
    return xp.where(far, -quaternion, quaternion)
