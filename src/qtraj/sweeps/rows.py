"""Compute the parameters of the points of a sweep by their numbers, without storing them.

The points are the product of all grids with the samples. The sample is the fastest index, and the last grid the next.
All cells of the grids have the same samples, so that differences between cells are not differences of samples.
"""

import functools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from qtraj.foundation.argument import described
from qtraj.sweeps.distributions import Distribution
from qtraj.sweeps.draws import random_numbers, sobol_numbers

Dependent = Callable[[Mapping[str, np.ndarray]], Any]
"""A parameter that is a function of the parameters before it, as arrays."""


@dataclass(frozen=True)
class Rows:
    """The parameters of all points.

    `grids`: the values of each grid. `random`: the distributions, by parameter. `columns`: for each parameter, a file
    with its value for each sample; if the parameter is in `random`, too, the file contains numbers in (0, 1).
    `dependent`: functions of all other parameters. `names`: the order of all parameters.
    """

    names: tuple[str, ...]
    grids: Mapping[str, np.ndarray]
    random: Mapping[str, Distribution]
    columns: Mapping[str, Path]
    dependent: Mapping[str, Dependent]
    samples: int = 1
    design: str = "random"
    seed: int = 0
    shape: tuple[int, ...] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "shape", tuple(len(values) for values in self.grids.values()))

    @property
    def count(self) -> int:
        """The number of points."""
        return math.prod(self.shape) * self.samples

    def at(self, start: int, stop: int) -> dict[str, np.ndarray]:
        """Return the parameters of points `start` to `stop`, each an array (stop - start,).

        **Raises:** ValueError if a dependent parameter is not a finite number for each point.
        """
        numbers = np.arange(start, stop)
        known = self._on_grids(numbers // self.samples) | self._sampled(start, stop)
        for name, function in self.dependent.items():
            known[name] = _computed(name, function, known, stop - start)
        return {name: known[name] for name in self.names}

    def point(self, number: int) -> dict[str, Any]:
        """Return the parameters of one point as Python numbers."""
        return {name: values[0].item() for name, values in self.at(number, number + 1).items()}

    def _on_grids(self, cells: np.ndarray) -> dict[str, np.ndarray]:
        values: dict[str, np.ndarray] = {}
        for name, grid in reversed([*self.grids.items()]):
            cells, place = np.divmod(cells, len(grid))
            values[name] = grid[place]
        return values

    def _sampled(self, start: int, stop: int) -> dict[str, np.ndarray]:
        parts = [self._samples(first, last) for first, last in _cycles(start, stop, self.samples)]
        joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        if stop - start > self.samples:  # all samples once, from which each cell takes its own
            place = np.arange(start, stop) % self.samples
            joined = {name: values[place] for name, values in joined.items()}
        return joined

    def _samples(self, start: int, stop: int) -> dict[str, np.ndarray]:
        """Return the random parameters and the columns of samples `start` to `stop`."""
        values = {name: np.array(_column(file)[start:stop]) for name, file in self.columns.items()}
        rest = [name for name in self.random if name not in self.columns]
        if self.design == "sobol" and rest:
            drawn = sobol_numbers(self.seed, len(rest), start, stop)
            values |= {name: drawn[:, k] for k, name in enumerate(rest)}
        else:
            values |= {name: random_numbers(self.seed, name, start, stop) for name in rest}
        return values | {name: source.from_unit(values[name]) for name, source in self.random.items()}


def _cycles(start: int, stop: int, period: int) -> Iterator[tuple[int, int]]:
    """Yield the ranges of samples that points `start` to `stop` need: all samples, or one or two ranges in order."""
    if stop - start > period:
        yield 0, period
        return
    first, last = start % period, (stop - 1) % period + 1
    if first < last:
        yield first, last
    else:
        yield first, period
        yield 0, last


def _computed(name: str, function: Dependent, known: Mapping[str, np.ndarray], count: int) -> np.ndarray:
    """Return the values of a dependent parameter."""
    given = function(dict(known))
    values = np.asarray(given)
    if values.dtype.kind not in "biuf" or values.shape not in ((), (count,)):
        raise ValueError(
            f"the function of the parameter '{name}' must return one number for each of {count} points, but "
            f"{described(given)} was returned"
        )
    if not np.isfinite(values).all():
        raise ValueError(f"the function of the parameter '{name}' returns values that are not finite")
    return np.broadcast_to(values, (count,))


def _column(file: Path) -> np.ndarray:
    state = file.stat()
    return _mapped(file, state.st_mtime_ns, state.st_ino, state.st_size)


@functools.lru_cache(maxsize=64)
def _mapped(file: Path, *state: int) -> np.ndarray:
    """Return the content of a file; its `state` is another one after the file was replaced."""
    return np.load(file, mmap_mode="r", allow_pickle=False)
