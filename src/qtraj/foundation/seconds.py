"""Convert times of any kind to numbers in seconds: durations of NumPy, pandas and Python, and absolute times.

A duration is a `timedelta64` of any resolution, a pandas Timedelta, or a `datetime.timedelta`. An absolute time is a
`datetime64`, a pandas Timestamp, or a `datetime.datetime`; with a time zone, it is converted to UTC. Its seconds count
from an origin, and without an origin it has no place on a path, whose time starts at 0.
"""

import datetime
from typing import Any

import numpy as np

from qtraj.foundation.namespace import is_host

CALENDAR = ("Y", "M", "generic")
"""Units of NumPy without a fixed number of seconds."""

DURATIONS, ABSOLUTE = (datetime.timedelta, np.timedelta64), (datetime.date, np.datetime64)
"""Types of durations and of absolute times; those of pandas are among them."""

_SECOND = np.timedelta64(1, "s")


def seconds(times: Any, origin: np.datetime64 | None = None) -> Any:
    """Return durations, and absolute times from `origin`, in seconds, in float64; other input is returned unchanged.

    **Raises:** ValueError for absolute times without an origin, for values that are missing (NaT), and for durations in
    months, in years, or without a unit.
    """
    values = _of_time(times)
    if values is None:
        return times
    if np.datetime_data(values.dtype)[0] in CALENDAR and values.dtype.kind == "m":
        raise ValueError(
            f"times must have a fixed unit, such as timedelta64[ms], but dtype {values.dtype} was given, whose unit "
            "has no fixed number of seconds"
        )
    if np.isnat(values).any():
        raise ValueError("times must not be missing, but some of them are NaT (not a time)")
    if values.dtype.kind == "M":
        if origin is None and not values.size:
            return np.zeros(values.shape)
        if origin is None:
            raise ValueError(
                f"a time must count from the start of the path or the motion, but the absolute time {values.flat[0]} "
                "was given: subtract the time of the start first, or pass track.elapsed for the times of a recording"
            )
        return _from_origin(values, origin)
    return values / _SECOND


def first_time(times: Any) -> np.datetime64 | None:
    """Return the first of absolute times; None for other input."""
    values = _of_time(times)
    return None if values is None or values.dtype.kind != "M" or not values.size else values.reshape(-1)[0]


def since_first(times: Any) -> Any:
    """Return times in seconds; absolute times count from the first of them."""
    return seconds(times, first_time(times))


def absolute(time: Any) -> np.datetime64:
    """Return one absolute time, also as ISO 8601, as a `datetime64`.

    **Raises:** ValueError if `time` is not one absolute time.
    """
    try:
        value = np.asarray(np.datetime64(time)) if isinstance(time, str) else _of_time(time)
    except ValueError:
        value = None
    if value is None or value.dtype.kind != "M" or value.ndim or np.isnat(value):
        raise ValueError(f"one absolute time was expected, such as '2026-05-06T09:00:00', but {time!r} was given")
    return value.reshape(-1)[0]


def _of_time(times: Any) -> np.ndarray | None:
    """Return durations and absolute times as an array of NumPy's types; None for anything else."""
    dtype = getattr(times, "dtype", None)
    if dtype is not None:
        if getattr(dtype, "kind", "") in "fiubc" or not is_host(times):
            return None
    elif not isinstance(_first(times), DURATIONS + ABSOLUTE):
        return None
    else:
        _require_one_kind(times)
    values = np.asarray(times)
    if values.dtype.kind == "O" and values.size:
        values = _from_objects(values)
    return values if values.dtype.kind in "mM" else None


def _require_one_kind(times: Any) -> None:
    """Raise a ValueError if nested lists contain durations, absolute times and other elements together."""
    elements, kinds = [times], set()
    while elements:
        x = elements.pop()
        if isinstance(x, list | tuple):
            elements.extend(x)
        else:
            kinds.add(next((k for k, types in enumerate((DURATIONS, ABSOLUTE)) if isinstance(x, types)), None))
    if len(kinds) > 1:
        raise ValueError("times must be all durations, all absolute times, or all numbers in seconds")


def _first(times: Any) -> Any:
    """Return the first element of nested lists; an array in a list, and an empty list, are returned as they are."""
    while isinstance(times, list | tuple) and times:
        times = times[0]
    return times


def _from_objects(values: np.ndarray) -> np.ndarray:
    """Convert an array of objects of Python or pandas, or return it unchanged if it contains others."""
    if not all(isinstance(x, datetime.date | datetime.timedelta) for x in values.flat):
        return values
    _require_one_kind(values.ravel().tolist())
    converted = [_from_object(x) for x in values.flat]
    return np.array(converted).reshape(values.shape)


def _from_object(x: Any) -> Any:
    if isinstance(x, datetime.timedelta):
        return x.to_timedelta64() if hasattr(x, "to_timedelta64") else np.timedelta64(x)  # type: ignore[attr-defined]
    if isinstance(x, datetime.datetime) and x.tzinfo is not None:
        x = x.astimezone(datetime.UTC).replace(tzinfo=None)
    return x.to_datetime64() if hasattr(x, "to_datetime64") else np.datetime64(x)  # type: ignore[attr-defined]


def _from_origin(values: np.ndarray, origin: np.datetime64) -> np.ndarray:
    """Return the seconds from `origin`; whole seconds apart, because a finer unit may overflow."""
    whole, start = values.astype("M8[s]"), origin.astype("M8[s]")
    return (whole - start) / _SECOND + ((values - whole) - (origin - start)) / _SECOND
