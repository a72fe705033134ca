"""The motions by their names."""

from qtraj.design.tuning import choices
from qtraj.design.tuning.motions.motion import AbstractMotion

MOTIONS: dict[str, AbstractMotion] = choices.instances("motions", choices.MOTIONS)


def motion_of(given: str | AbstractMotion) -> AbstractMotion:
    """The motion of this name, or the motion itself.

    **Raises:** ValueError for an unknown name.
    """
    if isinstance(given, AbstractMotion):
        return given
    if given not in MOTIONS:
        raise ValueError(f"motion must be {choices.either(MOTIONS)}, but {given!r} was given")
    return MOTIONS[given]
