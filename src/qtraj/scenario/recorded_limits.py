"""Limits of a scenario in comparison with its recording: those in its columns, and those that are odd for it."""

from collections.abc import Mapping
from typing import Any

from qtraj.design.along import Along
from qtraj.design.odd_limits import odd_limits, odd_speeds
from qtraj.io.track.limit_columns import LimitColumn
from qtraj.io.track.reading import Recording
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.quantity import quantity


def along_path(name: str, bound: Any, recording: Recording | None, path: AbstractHodograph | None) -> Any:
    """Return a limit; one in a column as steps along the path, or None without a recording."""
    if not isinstance(bound, LimitColumn):
        return bound
    if recording is None or path is None:
        return None
    samples = recording.limits[name]
    return Along.from_samples(path, samples.times - float(recording.track.start_time), samples.values)


def with_odd_limits(recording: Recording, limits: Mapping[str, Any]) -> Recording:
    """Return the recording with notes about limits that are odd for it."""
    notes = odd_limits(limits, recording.track)
    if (speed := recording.limits.get("speed")) is not None and speed.unit == quantity("speed").label:
        notes += odd_speeds(speed.column, speed.values, recording.track)
    return recording._replace(notes=(*recording.notes, *notes))
