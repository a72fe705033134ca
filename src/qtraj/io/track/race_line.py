"""Race lines: positions with distances and speeds instead of times."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from qtraj.io.track.column_names import find
from qtraj.io.track.column_scales import Units, scales
from qtraj.io.track.known_names import COMMON, FLAT, MORE
from qtraj.io.track.recorded_line import RecordedLine, recorded_line
from qtraj.io.track.recorded_times import Times
from qtraj.io.track.time_column import Table

DISTANCES = ("s", "arc_length", "distance", "station", "chainage")
SPEEDS = ("vx", "v", "speed", "velocity")


class RaceLine(NamedTuple):
    """The times of a race line with their description, its columns, and its heading and curvature."""

    times: tuple[str, Times]
    columns: dict[str, tuple[str, ...] | None]
    line: RecordedLine | None


def race_line(path: Path | str, table: Table, units: Units) -> RaceLine | None:
    """Return the times from distances and speeds, if a table has both and no times; otherwise None.

    Between two rows the acceleration is constant, so the time is 2Δs/(v₀ + v₁).

    **Raises:** ValueError for distances that do not increase and for negative speeds.
    """
    header = table.header
    if find((*COMMON["time"], *MORE["time"]), header) is not None or find(FLAT, header) is None:
        return None
    distance, speed = find(DISTANCES, header), find(SPEEDS, header)
    position = find((*COMMON["position"], *MORE["position"]), header) or find(FLAT, header)
    if distance is None or speed is None or position is None or find(("vx,vy",), header) is not None:
        return None
    names = (*distance, *speed)
    rows = dict(zip(header, table.units or [], strict=False))
    found = [
        *scales("position", distance, units, rows, False, None),
        *scales("velocity", speed, units, rows, False, None),
    ]
    s, v = (table.numbers(path, names) * [1.0 if unit is None else float(unit.factor) for unit in found]).T
    both = v[1:] + v[:-1]
    if (bad := np.flatnonzero((np.diff(s) <= 0) | (both <= 0) | (v[1:] < 0))).size:
        raise ValueError(
            f"{path}, {table.place(int(bad[0]) + 1)}: the file has no times, and no times follow from the distances "
            f"{distance[0]!r} and the speeds {speed[0]!r}: the distances must increase and the speeds be positive. "
            "Otherwise pass rate= or times="
        )
    seconds = np.concatenate([[0.0], np.cumsum(2 * np.diff(s) / both)])
    text = f"from the distances {distance[0]!r} and the speeds {speed[0]!r}"
    columns: dict[str, tuple[str, ...] | None] = {"position": position, "velocity": None}
    return RaceLine((text, Times(seconds, "s")), columns, recorded_line(table, seconds))
