"""Find the turns of a drive, and tabulate their radius, speed and lateral acceleration before and after a change."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import xarray

from qtraj.viz.map_colours import map_colours
from qtraj.viz.report.along import distance_travelled, match
from qtraj.viz.report.model import Table, number

SHARP = 0.2
"""A turn is where the curvature exceeds this fraction of the end of the colour scale of the map."""
MIN_ANGLE = np.radians(30.0)
"""Minimum change of direction [rad] of a turn."""
MERGED = 0.5
"""Two turns in the same direction are one if the distance between them is less than this multiple of their radius."""
TITLE = "Turns"
HEADER = [
    "turn",
    "distance [m]",
    "at [s]",
    "direction",
    "radius [m]",
    "speed [m/s]",
    "lateral acceleration [m/s²]",
]
NOTE = (
    "The number of a turn moves the time to its smallest radius. The radius is the smallest in the turn, the speed "
    "is the speed there, and the lateral acceleration is the largest in the turn."
)


class Turn(NamedTuple):
    """An interval of samples, from `start` to `end` inclusive, in which a path turns by `angle` [rad], left > 0."""

    start: int
    end: int
    angle: float


def turns(path: xarray.Dataset) -> list[Turn]:
    """Find the turns of a path, in order."""
    if not {"curvature", "velocity", "speed"} <= set(path.data_vars):
        return []
    colours = map_colours(path)
    heading = _headings(path)
    sharp = (colours.values > SHARP * colours.top) & (colours.top * np.ptp(distance_travelled(_position(path))) > 1e-6)
    side = np.where(sharp, np.sign(np.gradient(heading)), 0).astype(int)
    way = distance_travelled(_position(path))
    runs = _merged(_runs(side), way, colours.values)
    last = len(heading) - 1
    found = [Turn(i, j, float(heading[min(j + 1, last)] - heading[i])) for i, j, _ in runs]
    return [turn for turn in found if abs(turn.angle) >= MIN_ANGLE]


def turn_table(paths: Mapping[str, xarray.Dataset]) -> Table:
    """Tabulate the turns of the first path, and the same places of the other paths.

    The table contains the time of each turn on each path. It is empty if the first path has no turns, or if a path is
    not finite, as after a failed search.
    """
    first, *others = paths.values()
    finite = all(np.isfinite(path[name].values).all() for path in paths.values() for name in ("time", "position"))
    found = turns(first) if finite else []
    spans = [[(turn.start, turn.end) for turn in found], *(_same_places(found, first, other) for other in others)]
    facts = [[_facts(path, *span) for span in places] for path, places in zip(paths.values(), spans, strict=True)]
    mark = " → " if list(paths) == ["before", "after"] else " / "
    way, rows, times = distance_travelled(_position(first)), [], []
    for k, turn in enumerate(found):
        at = [own[k] for own in facts]
        side = "left" if turn.angle > 0 else "right"
        direction = f"{abs(np.degrees(turn.angle)):.0f}° {side}"
        row = [str(k + 1), f"{way[at[0].sample]:.0f}", number(at[0].time, 4), direction]
        columns = ([x.radius for x in at], [x.speed for x in at], [x.lateral for x in at])
        rows.append([*row, *(mark.join(number(value, 3) for value in column) for column in columns)])
        times.append([x.time for x in at])
    note = f"{NOTE} Each cell shows {mark.join(paths)}." if others else NOTE
    return Table(TITLE, HEADER, rows, 1, note, times)


class _Facts(NamedTuple):
    """The sample of the smallest radius, its time [s], radius [m] and speed [m/s], and the largest lateral [m/s²]."""

    sample: int
    time: float
    radius: float
    speed: float
    lateral: float


def _facts(path: xarray.Dataset, start: int, end: int) -> _Facts:
    inside = slice(start, end + 1)
    curvature = map_colours(path).values[inside]
    at = start + int(np.argmax(curvature))
    missing = np.full(len(path["time"]), np.nan)
    lateral = path["lateral_acceleration"].values if "lateral_acceleration" in path else missing
    sharpest = float(np.max(curvature))
    return _Facts(
        at,
        float(path["time"].values[at]),
        1 / sharpest if sharpest > 0 else np.inf,
        float(path["speed"].values[at]),
        float(np.fmax.reduce(np.abs(lateral[inside]))),
    )


def _same_places(found: Sequence[Turn], first: xarray.Dataset, other: xarray.Dataset) -> list[tuple[int, int]]:
    """Return the intervals of samples of another path at the places of the turns of the first path."""
    way, at = distance_travelled(_position(first)), match(_position(other), _position(first)).way
    ends = [np.searchsorted(at, way[[turn.start, turn.end]]) for turn in found]
    last = len(other["time"]) - 1
    return [(min(int(i), last), min(int(max(i, j)), last)) for i, j in ends]


def _position(path: xarray.Dataset) -> np.ndarray:
    return path["position"].values.astype(float)


def _headings(path: xarray.Dataset) -> np.ndarray:
    """Return the unwrapped direction of travel [rad], seen from above; stops keep the direction before them."""
    vx, vy = path["velocity"].values[:, :2].T
    speed = np.hypot(vx, vy)
    moving = speed > 1e-3 * max(float(np.nanmax(speed, initial=0.0)), 1e-300)
    if not moving.any():
        return np.zeros(len(speed))
    samples = np.arange(len(speed))
    return np.interp(samples, samples[moving], np.unwrap(np.arctan2(vy[moving], vx[moving])))


def _runs(side: np.ndarray) -> list[tuple[int, int, int]]:
    """Return the first and last index of each run of equal values other than zero, and the value."""
    edges = [0, *(np.flatnonzero(np.diff(side)) + 1), len(side)]
    return [(int(i), int(j) - 1, int(side[i])) for i, j in pairwise(edges) if side[i] != 0]


def _merged(runs: list[tuple[int, int, int]], way: np.ndarray, curvature: np.ndarray) -> list[tuple[int, int, int]]:
    """Join runs in the same direction that are close to each other."""
    result: list[tuple[int, int, int]] = []
    for run in runs:
        if result and run[2] == result[-1][2]:
            i, j, side = result[-1]
            sharpest = max(curvature[i : j + 1].max(), curvature[run[0] : run[1] + 1].max())
            if way[run[0]] - way[j] < MERGED / sharpest:
                result[-1] = (i, run[1], side)
                continue
        result.append(run)
    return result
