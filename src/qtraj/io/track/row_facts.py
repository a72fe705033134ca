"""State how many rows of a recording were read, where they have a gap, and how long the vehicle stands at the ends."""

import numpy as np

from qtraj.foundation.size_text import duration_text, length_text
from qtraj.io.track.segments import Segment
from qtraj.path.track import STANDSTILL, Track

GAP = 10.0
"""Minimum length of a gap that is stated, in median time steps."""

STANDING = 10.0
"""Minimum time [s] of a standstill at an end that is stated."""


def row_text(track: Track, rows: Segment) -> str:
    """Return the number of rows, the largest gap and the standstills at the ends."""
    times, positions = np.asarray(track.times), np.asarray(track.positions)
    count = rows.stop - rows.start
    of = "" if rows.segments == 1 else f" in {rows.segments} segments"
    segment = of if rows.number is None else f" of segment {rows.number} of {rows.segments}"
    if (farthest := float(np.linalg.norm(positions - positions[0], axis=1).max())) <= STANDSTILL:
        still = f"stays within {length_text(farthest)} of its first position" if farthest else "never moves"
        return "; ".join(filter(None, (f"rows: {count}{segment}", _gap(times), f"the vehicle {still}")))
    ends = [
        f"stands for the {word} {duration_text(length)}"
        for word, length in zip(("first", "last"), _standing(times, positions), strict=True)
        if length >= STANDING
    ]
    return "; ".join(filter(None, (f"rows: {count}{segment}", _gap(times), *ends)))


def _gap(times: np.ndarray) -> str:
    steps = np.diff(times)
    k = int(steps.argmax())
    if steps[k] <= GAP * np.median(steps):
        return ""
    return f"largest gap {duration_text(steps[k])} after {times[k] - times[0]:.6g} s"


def _standing(times: np.ndarray, positions: np.ndarray) -> tuple[float, float]:
    """Return the time [s] that the vehicle stays within `STANDSTILL` of its first and of its last position."""
    lengths = []
    for t, r in ((times, positions), (-times[::-1], positions[::-1])):
        away = np.linalg.norm(r - r[0], axis=1) > STANDSTILL
        lengths.append(float(t[int(away.argmax()) - 1] - t[0]) if away.any() else 0.0)
    return lengths[0], lengths[1]
