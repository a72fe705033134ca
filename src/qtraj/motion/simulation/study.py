"""Store a Monte-Carlo study of a closed loop: percentiles of the error, the worst flights, and what influences them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, extent

PERCENTS = (5.0, 50.0, 95.0, 100.0)
"""The percentiles in the dataset of a study."""


class WorstFlight(NamedTuple):
    """One of the worst flights of a `Study`.

    `seed`: its number, from 0. `metric`: its value. `cause`: the name of the spread whose draw was unusually large, of
    those that influence the metric. `rank`: the fraction of flights in which this draw was not larger.
    """

    seed: int
    metric: float
    cause: str
    rank: float


class Study(AbstractResult):
    """The flights of a Monte-Carlo study, along `seed`, from 0 to n − 1.

    `times` (m,) [s]. `angle` (n, m) [rad]: the attitude errors. `metric` (n,): the measure of a flight, by default its
    last error [rad]; larger is worse, and a flight that did not reach every instant has infinity. `settling_time` (n,)
    [s]: NaN for flights that do not settle. `peak_command` (n,): the largest physical command at `times`. `code` (n,):
    `ResultCode` of each flight. `draws`: the values (n, …) that were drawn, by name. `sizes`: the size (n,) of each
    draw, its norm in standard deviations. `influence`: the rank correlation of size and metric by name, from −1 to 1.
    """

    times: Float[Array, " m"]
    angle: Float[Array, "n m"]
    metric: Float[Array, " n"]
    settling_time: Float[Array, " n"]
    peak_command: Float[Array, " n"]
    code: Int[Array, " n"]
    draws: dict[str, Any]
    sizes: dict[str, Any]

    @property
    def influence(self) -> dict[str, float]:
        """The rank correlation (Spearman) of the size of each draw and the metric."""
        order = _ranks(self.metric)
        return {name: _correlation(_ranks(size), order) for name, size in self.sizes.items()}

    def percentiles(self, percents: Any = PERCENTS) -> Float[Array, "k m"]:
        """Return percentiles (k, m) [rad] of the attitude error at `times`; NaN where a flight did not arrive."""
        rows: Any = np.percentile(np.asarray(self.angle), np.atleast_1d(percents), axis=0)
        return rows

    def worst(self, count: int = 5) -> list[WorstFlight]:
        """Return the worst flights, the worst first, and the spread that most probably made each of them so bad.

        The cause is the spread with the largest product of influence and rank of the draw.
        """
        influence, metric = self.influence, np.asarray(self.metric)
        ranks = {name: (_ranks(size) + 1) / len(metric) for name, size in self.sizes.items()}
        flights = []
        for seed in np.argsort(-metric, kind="stable")[:count]:
            cause = max(ranks, key=lambda name: influence[name] * ranks[name][seed], default="")
            rank = float(ranks[cause][seed]) if cause else float("nan")
            flights.append(WorstFlight(int(seed), float(metric[seed]), cause, rank))
        return flights

    def draw(self, seed: int) -> dict[str, Any]:
        """Return the arguments of the flight with this number, to repeat it alone: `flight(**study.draw(seed))`.

        **Raises:** IndexError for a number that does not exist.
        """
        count = len(self.metric)
        if not 0 <= seed < count:
            raise IndexError(f"the study has the flights 0 to {count - 1}, but {seed} was given")
        return {name: values[seed] for name, values in self.draws.items()}

    def record(self) -> Record:
        """Return the flights with units along `seed`, percentiles of the error along `time`, and the influences."""
        numbers = np.arange(len(self.metric))
        variables = {
            "angle_percentiles": Quantity(
                self.percentiles(), "rad", "percentiles of the attitude error", ("percent", "time")
            ),
            "angle": Quantity(self.angle, "rad", "attitude error angle", ("seed", "time")),
            "metric": Quantity(self.metric, "", "measure of the flight, larger is worse", ("seed",)),
            "settling_time": Quantity(self.settling_time, "s", "instant after which the error is small", ("seed",)),
            "peak_command": Quantity(self.peak_command, "", "largest physical command", ("seed",)),
            "code": Quantity(self.code, "1", "result code", ("seed",)),
            "influence": Quantity(
                np.array([*self.influence.values()], float), "1", "rank correlation with the metric", ("spread",)
            ),
        }
        for name, size in self.sizes.items():
            variables[f"size_{name}"] = Quantity(size, "1", f"size of the draw of {name}", ("seed",))
        coordinates = {
            "time": Quantity(self.times, "s", "time", ("time",)),
            "seed": Quantity(numbers, "1", "number of the flight", ("seed",)),
            "percent": Quantity(np.array(PERCENTS), "percent", "percentile", ("percent",)),
        }
        arrived = int(np.sum(np.asarray(self.code) == ResultCode.successful))
        settled = int(np.isfinite(self.settling_time).sum())
        summary = (
            f"{len(numbers)} flights: {arrived} reached every instant, {settled} settled in "
            f"{extent(self.settling_time, 's')}, last error {extent(np.asarray(self.angle)[:, -1], 'rad')}"
        )
        return Record(summary, variables, coordinates, labels={"spread": list(self.sizes)})


def _ranks(values: Any) -> np.ndarray:
    """Return the number of smaller values for each value, the mean of these numbers for equal values."""
    values = np.asarray(values)
    ordered = np.sort(values)
    return 0.5 * (np.searchsorted(ordered, values, "left") + np.searchsorted(ordered, values, "right") - 1)


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    a, b = a - a.mean(), b - b.mean()
    size = float(np.sqrt(np.sum(a * a) * np.sum(b * b)))
    return float(np.sum(a * b)) / size if size > 0 else 0.0
