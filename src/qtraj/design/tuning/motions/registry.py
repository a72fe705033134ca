"""The motions by their names."""

from qtraj.design.tuning.motions.hermite import Hermite
from qtraj.design.tuning.motions.motion import AbstractMotion
from qtraj.design.tuning.motions.uniform import Uniform

MOTIONS: dict[str, AbstractMotion] = {motion.name: motion for motion in (Uniform(), Hermite())}


def motion_of(given: str | AbstractMotion) -> AbstractMotion:
    """The motion of this name, or the motion itself.

    **Raises:** ValueError for an unknown name.
    """
    if isinstance(given, AbstractMotion):
        return given
    if given not in MOTIONS:
        raise ValueError(f"motion must be {' or '.join(map(repr, MOTIONS))}, but {given!r} was given")
    return MOTIONS[given]
