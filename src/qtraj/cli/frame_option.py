"""The option `--frame` of the commands: which frame stands on the path, and what the frames are."""

from enum import StrEnum
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from qtraj.motion.programs.rotation_minimizing import Frame


class FrameName(StrEnum):
    """The frames along a path."""

    upright = "upright"
    natural = "natural"
    minimizing = "rotation-minimizing"
    thrust_aligned = "thrust-aligned"


ABOUT = (
    "upright (x forward, y left, z up: what a vehicle on wheels has), natural (tangent, principal normal, binormal: it "
    "flips over where the bend changes sides), rotation-minimizing (it never rolls), or thrust-aligned (z along the "
    "thrust, acceleration less gravity: what a multirotor has)."
)


def frame_option(otherwise: str = "") -> Any:
    """The option; `otherwise` says what holds without it, where that is not the upright frame."""
    return typer.Option(
        None, "--frame", metavar="FRAME", help=f"Frame of the attitudes: {ABOUT} [default: {otherwise or 'upright'}]"
    )


def frame_of(name: FrameName | None) -> "Frame":
    """The frame of this name; without a name the upright one."""
    from qtraj.motion.programs.rotation_minimizing import RotationMinimizing  # here, so that --help need not wait
    from qtraj.path.thrust_aligned import ThrustAligned
    from qtraj.path.trihedral import Natural, Upright

    frames = {
        FrameName.natural: Natural,
        FrameName.minimizing: RotationMinimizing,
        FrameName.thrust_aligned: ThrustAligned,
    }
    return frames.get(name or FrameName.upright, Upright)()
