"""Summarize the outputs of a sweep shard by shard: mean, extreme values with their points, shares and histograms."""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from qtraj.sweeps.outputs import OK, Outcome

MOST_COMPONENTS = 64
"""Outputs with more components for each point are not summarized."""

BINS = 1024
"""Default number of bins of a histogram."""


class Histogram(NamedTuple):
    """Bins of equal width between `low` and `high`."""

    low: float
    high: float
    bins: int = BINS


def summarized(outcome: Outcome, first: int, histograms: Mapping[str, Histogram]) -> dict[str, Any]:
    """Return the summary of a shard as JSON types; `first` is the number of its first point.

    Only successful points count. The lists have one entry for each component of an output.
    """
    good = np.flatnonzero(outcome.status == OK)
    summary: dict[str, Any] = {}
    for name, values in outcome.values.items():
        flat = values.reshape(len(values), -1)[good]
        if not good.size or flat.shape[1] > MOST_COMPONENTS:
            continue
        low, high = flat.argmin(0), flat.argmax(0)
        each = np.arange(flat.shape[1])
        numbers = flat.astype(float) if flat.dtype == bool else flat
        summary[name] = {
            "sum": numbers.sum(0, dtype=float).tolist(),
            "minimum": flat[low, each].tolist(),
            "minimum_point": (first + good[low]).tolist(),
            "maximum": flat[high, each].tolist(),
            "maximum_point": (first + good[high]).tolist(),
        }
        if name in histograms:
            summary[name]["histogram"] = [_counts(numbers[:, k], histograms[name]) for k in each]
    return summary


def _counts(values: np.ndarray, histogram: Histogram) -> list[int]:
    """Return the numbers of values below the histogram, in its bins, and above it."""
    low, high, bins = histogram
    place = np.floor((values - low) / (high - low) * bins)
    place = np.where(values == high, bins - 1, np.clip(place, -1, bins)).astype(int)
    return np.bincount(place + 1, minlength=bins + 2).tolist()


class Summary(NamedTuple):
    """The values of one output at the successful points; arrays have the shape of the output for one point.

    `successes`: the number of successful points. `minimum_point`, `maximum_point`: the first points with the extreme
    values, as numbers of points. `mean`: for a bool, the share of points where it is true. `histogram`: numbers of
    values below `bounds`, in bins of equal width between them, and above; None if it was not requested.
    """

    successes: int
    mean: np.ndarray
    minimum: np.ndarray
    minimum_point: np.ndarray
    maximum: np.ndarray
    maximum_point: np.ndarray
    histogram: np.ndarray | None = None
    bounds: tuple[float, float] | None = None

    def quantile(self, share: float) -> np.ndarray:
        """Return the value below which this share of the points lies, accurate to the width of a bin.

        It is NaN where the quantile is outside the bounds of the histogram.

        **Raises:** ValueError without a histogram, or for a share outside [0, 1].
        """
        if self.histogram is None or self.bounds is None:
            raise ValueError("quantiles need a histogram: pass histograms={'name': (low, high)} to the sweep")
        if not 0 <= share <= 1:
            raise ValueError(f"a quantile is a share from 0 to 1, but {share!r} was given")
        low, high = self.bounds
        rows = self.histogram.reshape(-1, self.histogram.shape[-1])
        return np.array([_quantile(row, share, low, high) for row in rows]).reshape(self.histogram.shape[:-1])


def _quantile(counts: np.ndarray, share: float, low: float, high: float) -> float:
    edges = np.concatenate([[np.nan], np.linspace(low, high, counts.size - 1), [np.nan]])
    target, below = share * counts.sum(), np.concatenate([[0], np.cumsum(counts)])
    k = int(np.clip(np.searchsorted(below, target, side="left") - 1, np.flatnonzero(counts)[0], counts.size - 1))
    part = (target - below[k]) / max(counts[k], 1)
    return float(edges[k] + part * (edges[k + 1] - edges[k]))


def combined(
    entries: Iterable[Mapping[str, Any]], shapes: Mapping[str, tuple[int, ...]], histograms: Mapping[str, Histogram]
) -> dict[str, Summary]:
    """Return the summaries of all outputs from those of the shards, in the order of the shards."""
    totals: dict[str, dict[str, Any]] = {}
    for entry in entries:
        count = entry["points"] - entry["failed"]
        for name, own in entry["summary"].items():
            _add(totals.setdefault(name, {"count": 0}), {k: np.asarray(v) for k, v in own.items()}, count)
    return {name: _summary(total, shapes[name], histograms.get(name)) for name, total in totals.items()}


def _add(total: dict[str, Any], own: dict[str, np.ndarray], count: int) -> None:
    total["count"] += count
    for name in ("sum", "histogram"):
        if name in own:
            total[name] = total.get(name, 0) + own[name]
    for name, less in (("minimum", np.less), ("maximum", np.greater)):
        point = f"{name}_point"
        if name not in total:
            total[name], total[point] = own[name], own[point]
        better = less(own[name], total[name])
        total[name] = np.where(better, own[name], total[name])
        total[point] = np.where(better, own[point], total[point])


def _summary(total: dict[str, Any], shape: tuple[int, ...], histogram: Histogram | None) -> Summary:
    names = ("minimum", "minimum_point", "maximum", "maximum_point")
    extremes = {name: total[name].reshape(shape) for name in names}
    counts = None if histogram is None else total["histogram"].reshape(*shape, -1)
    bounds = None if histogram is None else (histogram.low, histogram.high)
    mean = (total["sum"] / total["count"]).reshape(shape)
    return Summary(total["count"], mean, **extremes, histogram=counts, bounds=bounds)
