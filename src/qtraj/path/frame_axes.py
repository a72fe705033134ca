"""Names of the axes of frames along a path, for labelled data, tables, figures and reports.

The natural trihedral consists of tangent, principal normal and binormal (τ, n, b). The axes of the upright frame point
forward, left and up. The axes of the thrust-aligned frame point forward, left and along the thrust
(docs/conventions.md). All displayed labels of frame axes are defined in this module.
"""

from typing import NamedTuple

from qtraj.foundation import record

Three = tuple[str, str, str]


class FrameAxes(NamedTuple):
    """The body axes x, y and z of a frame: names, symbols and a description."""

    names: Three
    symbols: Three
    convention: str

    def titles(self) -> Three:
        """Return the symbol and name of each axis, such as "τ (tangent)", or only the name if both are equal."""
        x, y, z = (
            name if symbol == name else f"{symbol} ({name})"
            for symbol, name in zip(self.symbols, self.names, strict=True)
        )
        return x, y, z


_UPRIGHT: Three = ("forward", "left", "up")
_TRIHEDRAL: Three = ("tangent", "normal", "binormal")
_LETTERS: Three = ("x", "y", "z")

NATURAL, UPRIGHT, MINIMIZING = "natural", "upright", "rotation-minimizing"
THRUST_ALIGNED = "thrust-aligned"
FRAMES = (UPRIGHT, NATURAL, MINIMIZING, THRUST_ALIGNED)
"""The names of the frames along a path."""

AXES = {
    NATURAL: FrameAxes(_TRIHEDRAL, ("τ", "n", "b"), "x = tangent (forward), y = principal normal, z = binormal"),
    UPRIGHT: FrameAxes(_UPRIGHT, _UPRIGHT, "x = forward (along the path), y = left (level), z = up"),
    MINIMIZING: FrameAxes(
        ("tangent", "first", "second"),
        ("τ", "u", "v"),
        "x = tangent (forward), y and z perpendicular to the path; no rotation about x",
    ),
    THRUST_ALIGNED: FrameAxes(
        ("forward", "left", "thrust"),
        ("forward", "left", "thrust"),
        "x = forward (perpendicular to the thrust), y = left, z = thrust (acceleration minus gravity)",
    ),
    "trihedral": FrameAxes(_TRIHEDRAL, ("τ", "n", "b"), "x = tangent (forward), y = normal, z = binormal"),
}
"""Axes by the name of the frame; "trihedral" is for a trihedral of an unknown frame."""

OTHER = FrameAxes(_LETTERS, _LETTERS, "x, y, z are the axes of the frame")
"""Axes of a user-defined frame."""


def axes_of(frame: str) -> FrameAxes:
    """Return the axes of the frame with this name."""
    return AXES.get(frame, OTHER)


def labels_of(frame: str) -> dict[str, list[str]]:
    """Return the labels of the component axes, for the frame with this name."""
    return {
        "world": record.LABELS["world"],
        "body": list(axes_of(frame).names),
        "quaternion_component": record.LABELS["component"],
    }


def framed(frame: str) -> dict[str, str]:
    """Return the attributes of a dataset that contains attitudes and rates of this `frame`."""
    return {
        "frame": frame,
        "frame_convention": f"right-handed; body axes {axes_of(frame).convention}",
        "quaternion_convention": f"{record.CONVENTIONS['quaternion_convention']}, unit norm",
    }
