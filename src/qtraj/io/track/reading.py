"""The options of `read_track`, checked, and what it returns."""

import os
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from qtraj.io.track.attitude_angles import AttitudeAngles
from qtraj.io.track.column_scales import Units, require_units
from qtraj.io.track.given_times import require_rate
from qtraj.io.track.limit_columns import LimitColumn, LimitSamples
from qtraj.io.track.recorded_line import LineResidual, RecordedLine, line_residual
from qtraj.io.track.repeated_times import CHOICES
from qtraj.io.track.tangent_plane import TangentPlane
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.track import Track

ORDERS = ("wxyz", "xyzw")
"""Orders of the components of a quaternion."""


class Recording(NamedTuple):
    """A track, four lines of text that state what was read and as what, and texts about what is odd in it.

    `line`: heading and curvature of a race line, or None. `limits`: limits that the recording contains, by name.
    """

    track: Track
    facts: tuple[str, str, str, str]
    notes: tuple[str, ...] = ()
    line: RecordedLine | None = None
    limits: Mapping[str, LimitSamples] = MappingProxyType({})


def recorded(recording: Recording | None) -> dict[str, Any] | None:
    """Return what was read, and what is odd in it, as JSON types; None for None."""
    return None if recording is None else {"facts": list(recording.facts), "notes": list(recording.notes)}


def recording_residual(recording: Recording | None, path: AbstractHodograph) -> LineResidual | None:
    """Return the differences of heading and curvature of a race line from the path fitted to it; otherwise None."""
    if recording is None or recording.line is None:
        return None
    return line_residual(path, recording.line, float(np.asarray(recording.track.times)[0]))


class Reading(NamedTuple):
    """The options of `read_track`, and the columns of the limits that are also read."""

    columns: Mapping[str, str | Sequence[str] | None]
    angles: AttitudeAngles | None
    plane: TangentPlane | None
    units: Units
    axes: str | None = None
    rate: float | None = None
    times: str | os.PathLike[str] | None = None
    duplicates: str | None = None
    quaternion: str | None = None
    segment: int | None = None
    limits: Mapping[str, LimitColumn] = MappingProxyType({})

    @property
    def timed(self) -> bool:
        """Whether the user gives the times."""
        return self.rate is not None or self.times is not None

    @property
    def named(self) -> list[str]:
        """The column names that the user gives."""
        entries = [[names] if isinstance(names, str) else names for names in self.columns.values() if names]
        return [name for names in entries for name in names]


def checked(
    columns: Any = None, angles: Any = None, projection: Any = None, units: Any = None, **options: Any
) -> Reading:
    """Return the options of `read_track`; `options` are those from `axes` on, as for `Reading`.

    **Raises:** ValueError for an option with another value than expected.
    """
    if angles is not None and not isinstance(angles, AttitudeAngles):
        raise ValueError(f"angles= must be a qtraj.AttitudeAngles, but {angles!r} was given")
    require_units(units or {})
    reading = Reading(columns or {}, angles, _plane(projection), units or {}, **options)
    require_rate(reading.rate, reading.times)
    _require_choice("duplicates", reading.duplicates, CHOICES)
    _require_choice("quaternion", reading.quaternion, ORDERS)
    segment = reading.segment
    if segment is not None and (not isinstance(segment, int) or segment < 1):
        raise ValueError(f"segment= must be the number of a segment, 1 or more, but {segment!r} was given")
    return reading


def _require_choice(name: str, given: Any, choices: Sequence[str]) -> None:
    if given not in (None, *choices):
        raise ValueError(
            f"{name}= must be {', '.join(map(repr, choices[:-1]))} or {choices[-1]!r}, but {given!r} was given"
        )


def _plane(projection: TangentPlane | str | None) -> TangentPlane | None:
    if projection is None or isinstance(projection, TangentPlane):
        return projection
    if projection != "tangent-plane":
        raise ValueError(f"projection= must be 'tangent-plane' or a qtraj.TangentPlane, but {projection!r} was given")
    return TangentPlane()
