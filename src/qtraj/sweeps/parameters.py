"""Read the parameters of a sweep: grids, distributions, columns, and functions of other parameters."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from qtraj.foundation.argument import described, require_whole
from qtraj.foundation.suggestion import suggestion
from qtraj.sweeps.distributions import Column, Distribution, Normal, Uniform, as_values
from qtraj.sweeps.draws import DESIGNS, MOST_LATIN, MOST_SOBOL, latin_numbers
from qtraj.sweeps.names import require_distinct, require_name
from qtraj.sweeps.rows import Rows

MOST_POINTS = 10**10
"""Maximum number of points of a sweep."""


def rows_of(
    parameters: Mapping[str, Any], samples: int | None, design: str, seed: int, folder: Path
) -> tuple[Rows, dict[str, np.ndarray]]:
    """Return the rows of a sweep, and the arrays that they need in files in `folder`.

    **Raises:** ValueError for parameters that do not define points, or that define too many.
    """
    _require_names(parameters)
    if design not in DESIGNS:
        raise ValueError(f"design must be one of {', '.join(DESIGNS)}, but {described(design)} was given")
    require_whole(seed, "seed")
    of_kind = {name: _kind(value) for name, value in parameters.items()}
    chosen = {kind: {n: v for n, v in parameters.items() if of_kind[n] == kind} for kind in set(of_kind.values())}
    columns: dict[str, Column] = chosen.get("column", {})
    random: dict[str, Distribution] = chosen.get("random", {})
    count = _samples(columns, random, samples)
    grids = {name: as_values(values, f"the parameter '{name}'") for name, values in chosen.get("grid", {}).items()}
    _require_few(math.prod(len(values) for values in grids.values()) * count)
    arrays = {name: column.values for name, column in columns.items()}
    if random and design == "latin":
        arrays |= _latin(random, count, seed)
    if random and design == "sobol" and count > MOST_SOBOL:
        raise ValueError(f"a Sobol sequence has at most {MOST_SOBOL} samples, but {count} were requested")
    files = {name: folder / f"{k}.npy" for k, name in enumerate(arrays)}
    dependent = chosen.get("dependent", {})
    return Rows(tuple(parameters), grids, random, files, dependent, count, design, seed), arrays


def description(rows: Rows, arrays: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Return what determines each parameter: values, a distribution, or a function."""
    known: dict[str, Any] = {**rows.grids, **arrays, **rows.random}
    return {name: known.get(name, rows.dependent.get(name)) for name in rows.names}


def _kind(value: Any) -> str:
    if isinstance(value, Column):
        return "column"
    if isinstance(value, Uniform | Normal):
        return "random"
    return "dependent" if callable(value) else "grid"


def _require_names(parameters: Any) -> None:
    if not isinstance(parameters, Mapping):
        raise ValueError(f"parameters must be a dictionary from name to values, but {described(parameters)} was given")
    if not parameters:
        raise ValueError("there are no parameters: pass at least one, such as {'speed': [5.0, 10.0]}")
    for name in parameters:
        require_name(name, "a parameter")
    require_distinct(parameters)
    if all(callable(value) for value in parameters.values()):
        raise ValueError("all parameters are functions of other parameters: pass at least one with values")


def _samples(columns: Mapping[str, Column], random: Mapping[str, Distribution], samples: int | None) -> int:
    """Return the number of samples, which the columns determine if there are any."""
    lengths = {name: len(column.values) for name, column in columns.items()}
    if len(set(lengths.values())) > 1:
        text = ", ".join(f"'{name}' has {length}" for name, length in lengths.items())
        raise ValueError(f"all columns must have the same number of values, but {text}")
    if samples is None:
        if random and not columns:
            name = next(iter(random))
            raise ValueError(f"the parameter '{name}' is random: pass the number of samples")
        return next(iter(lengths.values()), 1)
    require_whole(samples, "samples", 1)
    if columns and samples != next(iter(lengths.values())):
        raise ValueError(
            f"samples is {samples}, but the columns have {next(iter(lengths.values()))} values: omit samples"
        )
    if not random and not columns:
        raise ValueError("samples needs a random parameter, such as Uniform(0, 1), but there is none")
    return samples


def _require_few(count: int) -> None:
    if count > MOST_POINTS:
        raise ValueError(
            f"the parameters define {count:.3g} points, but a sweep has at most {MOST_POINTS:.0e}: use fewer values in "
            "each grid, or draw samples with Uniform and design='sobol'"
        )


def _latin(random: Mapping[str, Distribution], count: int, seed: int) -> dict[str, np.ndarray]:
    if count * len(random) > MOST_LATIN:
        raise ValueError(
            f"a Latin hypercube of {count} samples of {len(random)} parameters is too large, because it is drawn as a "
            "whole: use design='sobol'"
        )
    drawn = latin_numbers(seed, len(random), count)
    return {name: drawn[:, k].copy() for k, name in enumerate(random)}


def require_known(names: Mapping[str, Any], known: tuple[str, ...], what: str) -> None:
    """Raise a ValueError for a name that is not the name of an output."""
    for name in names:
        if name not in known:
            raise ValueError(f"{what} '{name}' is unknown; {suggestion(name, known, 'outputs')}")
