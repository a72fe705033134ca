"""Convert recorded roll, pitch and heading to quaternions by an explicit convention."""

from dataclasses import dataclass

import numpy as np

from qtraj.algebra import hamilton

HEADINGS = ("north-clockwise", "x-anticlockwise")
UNITS = {"deg": np.pi / 180, "rad": 1.0}
BODIES = ("forward-right-down", "forward-left-up")

OPTIONS = (
    "sequence: three letters, x for roll, y for pitch and z for heading; upper case for rotations about the moving "
    "axes ('ZYX': heading, then pitch, then roll), lower case for rotations about the fixed axes; heading: "
    "'north-clockwise' or 'x-anticlockwise'; unit: 'deg' or 'rad'; body: 'forward-right-down' or 'forward-left-up'"
)
"""The fields of a convention and their allowed values, for error messages."""

Quaternions = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]

_ONE, _ROLLED_OVER, _NORTH = (1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))


@dataclass(frozen=True, kw_only=True)
class AttitudeAngles:
    """The convention of recorded roll, pitch and heading.

    No field has a default value, because recordings use different conventions. `sequence` consists of three letters for
    the order of the rotations: x for roll, y for pitch, z for heading. Upper case means rotations about the moving body
    axes, lower case about the fixed axes; "ZYX" (heading, pitch, roll) is the usual order for aircraft and equals
    "xyz". `heading` is "north-clockwise" (from world y, north, towards world x, east) or "x-anticlockwise" (from world
    x towards world y). `unit` is "deg" or "rad". `body` names the directions of the body axes x, y, z,
    "forward-right-down" or "forward-left-up". Roll and pitch are right-handed about x and y, so a positive pitch raises
    the nose with "forward-right-down" and lowers the nose with "forward-left-up". Recorded rates are in the same body
    axes, and are converted to forward, left, up, too.

    **Raises:** ValueError for any other value; the message contains the allowed values.
    """

    sequence: str
    heading: str
    unit: str
    body: str

    def __post_init__(self) -> None:
        ordered = self.sequence in (self.sequence.upper(), self.sequence.lower())
        if sorted(self.sequence.lower()) != ["x", "y", "z"] or not ordered:
            raise ValueError(
                "the sequence of attitude angles must be x, y and z in any order, all upper or all lower case, such as "
                f"'ZYX', but {self.sequence!r} was given"
            )
        for name, choices in (("heading", HEADINGS), ("unit", tuple(UNITS)), ("body", BODIES)):
            if getattr(self, name) not in choices:
                options = " or ".join(map(repr, choices))
                raise ValueError(
                    f"the {name} of attitude angles must be {options}, but {getattr(self, name)!r} was given"
                )

    @property
    def axes(self) -> str:
        """The name of the body axes in `recorded_axes`, "ned" for forward, right, down."""
        return "ned" if self.body == BODIES[0] else "enu"

    def quaternions(self, angles: np.ndarray) -> np.ndarray:
        """Convert `angles` (n, 3) to unit quaternions (n, 4); the columns are roll, pitch and heading in `unit`.

        The quaternions are scalar first, body to world. Their body axes are forward, left, up for either value of
        `body`. World z is up; if the heading is measured from north, x is east and y is north.
        """
        roll, pitch, heading = (UNITS[self.unit] * np.asarray(angles, float)).T
        down, clockwise = self.body == BODIES[0], self.heading == HEADINGS[0]
        turns = {"x": roll, "y": pitch, "z": heading if down == clockwise else -heading}
        order = self.sequence.lower() if self.sequence.isupper() else self.sequence[::-1]
        q = _constant(_NORTH if clockwise else _ONE, roll)
        q = hamilton.product(q, _constant(_ROLLED_OVER if down else _ONE, roll))
        for axis in order:
            q = hamilton.product(q, _about("xyz".index(axis), turns[axis]))
        return np.stack(hamilton.product(q, _constant(_ROLLED_OVER if down else _ONE, roll)), axis=1)


def _about(axis: int, angle: np.ndarray) -> Quaternions:
    vector = [np.zeros_like(angle) for _ in range(3)]
    vector[axis] = np.sin(angle / 2)
    return np.cos(angle / 2), vector[0], vector[1], vector[2]


def _constant(q: tuple[float, ...], like: np.ndarray) -> Quaternions:
    w, x, y, z = (np.full_like(like, component) for component in q)
    return w, x, y, z
