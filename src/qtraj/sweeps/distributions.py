"""Define random parameters of sweeps, and parameters that are columns of a table."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from qtraj.foundation.argument import described


@dataclass(frozen=True)
class Uniform:
    """A parameter with a uniform distribution between `low` and `high`, in the unit of the parameter.

    **Raises:** ValueError unless both bounds are finite numbers, and `low` is less than `high`.
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        _require_finite(low=self.low, high=self.high)
        if not self.low < self.high:
            raise ValueError(f"low must be less than high, but {self.low!r} and {self.high!r} were given")

    def from_unit(self, unit: np.ndarray) -> np.ndarray:
        """Convert numbers that are uniform in (0, 1) to values of the parameter."""
        return self.low + (self.high - self.low) * unit


@dataclass(frozen=True)
class Normal:
    """A parameter with a normal distribution, with `mean` and standard deviation `sigma` in the unit of the parameter.

    **Raises:** ValueError unless `mean` is finite, and `sigma` is positive and finite.
    """

    mean: float
    sigma: float

    def __post_init__(self) -> None:
        _require_finite(mean=self.mean, sigma=self.sigma)
        if not self.sigma > 0:
            raise ValueError(f"sigma must be positive, but {self.sigma!r} was given")

    def from_unit(self, unit: np.ndarray) -> np.ndarray:
        """Convert numbers that are uniform in (0, 1) to values of the parameter."""
        from scipy.special import ndtri  # imported here, because it delays the import of qtraj

        return self.mean + self.sigma * ndtri(unit)


Distribution = Uniform | Normal


class Column:
    """A parameter whose values are one column of a table; all columns of a sweep belong together row by row.

    Args:
        values: The values, (n,): numbers, integers or bools. Or a CSV file with one header line, with `name`.
        name: The name of the column in the header of the file.

    Raises:
        ValueError: If the values are not one-dimensional and finite, or the file has no such column.
        OSError: If the file cannot be read.
    """

    def __init__(self, values: Any, name: str | None = None):
        self.values = _read(Path(values), name) if isinstance(values, str | Path) else as_values(values, "values")

    def __repr__(self) -> str:
        return f"Column({len(self.values)} values)"


def as_values(values: Any, name: str) -> np.ndarray:
    """Return the values of a parameter as a one-dimensional array of finite numbers, integers or bools.

    **Raises:** ValueError for anything else; the message starts with `name`.
    """
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise ValueError(f"{name} must be a list of numbers ({error})") from None
    array = array.reshape(1) if array.ndim == 0 else array
    if array.ndim != 1 or array.dtype.kind not in "biuf":
        raise ValueError(f"{name} must be numbers or bools in one dimension, but {described(values)} was given")
    if not array.size:
        raise ValueError(f"{name} must contain at least one value, but none was given")
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite, but value {int(np.argmin(np.isfinite(array)))} is not")
    return array


def _read(file: Path, name: str | None) -> np.ndarray:
    with file.open(encoding="utf-8") as lines:
        header = [title.strip().strip('"') for title in lines.readline().split(",")]
        if name not in header:
            raise ValueError(f"{file}: there is no column {name!r}; the columns are {', '.join(header)}")
        try:
            values = np.loadtxt(lines, delimiter=",", usecols=header.index(str(name)), ndmin=1, quotechar='"')
        except ValueError as error:
            raise ValueError(f"{file}: the column {name!r} must contain numbers only ({error})") from None
    return as_values(values, f"{file}: the column {name!r}")


def _require_finite(**numbers: Any) -> None:
    for name, value in numbers.items():
        if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not math.isfinite(value):
            raise ValueError(f"{name} must be a finite number, but {described(value)} was given")
