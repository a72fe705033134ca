"""Motions by name."""

from qtraj.design.tuning import choices
from qtraj.design.tuning.motions.motion import AbstractMotion

MOTIONS: dict[str, AbstractMotion] = choices.instances("motions", choices.MOTIONS)


def get_motion(motion: str | AbstractMotion) -> AbstractMotion:
    """Return the motion with this name, or the argument if it is a motion.

    **Raises:** ValueError for an unknown name.
    """
    if isinstance(motion, AbstractMotion):
        return motion
    if motion not in MOTIONS:
        raise ValueError(f"motion must be {choices.either(MOTIONS)}, but {motion!r} was given")
    return MOTIONS[motion]
