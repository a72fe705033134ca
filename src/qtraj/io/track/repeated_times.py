"""Combine samples of a recording that have the same time."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

CHOICES = ("first", "last", "mean")


class Merged(NamedTuple):
    """Samples with distinct times, and a note about those that were combined."""

    times: np.ndarray
    parts: dict[str, np.ndarray]
    note: str = ""


class DifferentSamplesError(ValueError):
    """Samples at one time that are too different to be combined; `index` is the number of the second."""

    def __init__(self, index: int):
        super().__init__("the samples at one time differ")
        self.index = index


def merge(times: np.ndarray, parts: Mapping[str, np.ndarray], choice: str | None = None) -> Merged:
    """Return one sample for each time of the sorted `times` (n,) and the arrays (n, m) of each quantity.

    With `choice`, the first or the last sample of a time counts, or the mean. Without it, equal samples count once, and
    samples whose positions differ by less than a step to a neighbour are averaged. Quaternions are averaged after
    their signs are made equal.

    **Raises:** DifferentSamplesError, without `choice`, for samples that differ more.
    """
    starts = np.flatnonzero(np.concatenate([[True], np.diff(times) > 0]))
    if len(starts) == len(times):
        return Merged(times, dict(parts))
    groups = np.repeat(np.arange(len(starts)), np.diff(np.append(starts, len(times))))
    equal = all(np.array_equal(part, part[starts][groups]) for part in parts.values())
    if choice is None and not equal:
        _require_close(np.asarray(parts["position"]), starts, groups)
    ends = np.append(starts[1:], len(times)) - 1
    count = len(times) - len(starts)
    rows = "row" if count == 1 else "rows"
    if equal or choice in ("first", "last"):
        chosen = ends if choice == "last" else starts
        kept = {name: part[chosen] for name, part in parts.items()}
        return Merged(times[starts], kept, f"{count} repeated {rows} omitted")
    signed = {name: _same_sign(part, starts, groups) if name == "attitude" else part for name, part in parts.items()}
    sizes = np.bincount(groups)[:, None]
    means = {name: _exact_mean(part, starts, sizes) for name, part in signed.items()}
    return Merged(times[starts], means, f"{count} {rows} averaged with another row at the same time")


def _exact_mean(part: np.ndarray, starts: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Return the means of the groups; a group of one sample is unchanged."""
    return np.where(sizes == 1, part[starts], np.add.reduceat(part, starts, axis=0) / sizes)


def _same_sign(quaternions: np.ndarray, starts: np.ndarray, groups: np.ndarray) -> np.ndarray:
    opposite = np.sum(quaternions * quaternions[starts][groups], axis=1, keepdims=True) < 0
    return np.where(opposite, -quaternions, quaternions)


def _require_close(positions: np.ndarray, starts: np.ndarray, groups: np.ndarray) -> None:
    """Raise a DifferentSamplesError if a position is not closer to the first of its time than a neighbour is.

    The distance to a neighbouring time is the smallest between the first and last positions of both times, so that one
    outlier does not increase it.
    """
    distance = np.linalg.norm(positions - positions[starts][groups], axis=1)
    ends = np.append(starts[1:], len(positions)) - 1
    pairs = [(starts[1:], ends[:-1]), (ends[1:], ends[:-1]), (starts[1:], starts[:-1]), (ends[1:], starts[:-1])]
    jumps = np.min([np.linalg.norm(positions[a] - positions[b], axis=1) for a, b in pairs], axis=0)
    steps = np.maximum(np.append(jumps, 0.0), np.insert(jumps, 0, 0.0))[groups]
    far = np.flatnonzero((distance > 0) & (distance >= steps))
    if far.size:
        raise DifferentSamplesError(int(far[0]))
