"""What the axes of a frame along a path are called, in labelled data, tables, figures and reports.

The natural trihedral has a tangent, a principal normal and a binormal (τ, n, b); the upright frame points forward, left
and up, the thrust-aligned one forward, left and along the thrust (docs/conventions.md). Every label that a user reads
is taken from here.
"""

from typing import NamedTuple

from qtraj.foundation import record

Three = tuple[str, str, str]


class FrameAxes(NamedTuple):
    """The body axes x, y and z of a frame: their names, the letters that stand for them, and what they are."""

    names: Three
    symbols: Three
    convention: str

    def titles(self) -> Three:
        """Letter and name of each axis, such as "τ (tangent)"; the name alone where there is no letter."""
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

AXES = {
    NATURAL: FrameAxes(_TRIHEDRAL, ("τ", "n", "b"), "x = tangent (forward), y = principal normal, z = binormal"),
    UPRIGHT: FrameAxes(_UPRIGHT, _UPRIGHT, "x = forward (along the path), y = left (level), z = up"),
    MINIMIZING: FrameAxes(
        ("tangent", "first", "second"),
        ("τ", "u", "v"),
        "x = tangent (forward), y and z across the path; the frame never turns about x",
    ),
    THRUST_ALIGNED: FrameAxes(
        ("forward", "left", "thrust"),
        ("forward", "left", "thrust"),
        "x = forward (the heading, across the thrust), y = left, z = thrust (acceleration less gravity)",
    ),
    "trihedral": FrameAxes(_TRIHEDRAL, ("τ", "n", "b"), "x = tangent (forward), y = normal, z = binormal"),
}
"""By the name of a frame. "trihedral" is one whose frame is not known any more."""

OTHER = FrameAxes(_LETTERS, _LETTERS, "x, y, z are the axes of the frame")
"""Those of a user's own frame."""


def axes_of(frame: str) -> FrameAxes:
    """The axes of the frame of this name."""
    return AXES.get(frame, OTHER)


def labels_of(frame: str) -> dict[str, list[str]]:
    """The coordinates along the axes of components, where the body is a frame of this name."""
    return {
        "world": record.LABELS["world"],
        "body": list(axes_of(frame).names),
        "quaternion_component": record.LABELS["component"],
    }


def framed(frame: str) -> dict[str, str]:
    """The attributes of a dataset whose rates and attitudes are those of a `frame` along a path."""
    return {
        "frame": frame,
        "frame_convention": f"right-handed; body axes {axes_of(frame).convention}",
        "quaternion_convention": f"{record.CONVENTIONS['quaternion_convention']}, unit norm",
    }
