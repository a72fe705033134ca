"""Call the function of a sweep, and describe its outputs."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from qtraj.foundation.argument import described
from qtraj.foundation.suggestion import suggestion
from qtraj.sweeps.results import NoValidPointError

OK, NOT_A_NUMBER, FAILED, RAISED = range(4)
"""The status of a point."""

STATUSES = ("successful", "not_a_number", "failed", "raised_an_error")
"""The meanings of the statuses, in order."""

FAILED_KEY = "failed"
"""The output of a function that is true for points that failed; it becomes part of the status."""

FATAL = (MemoryError, OSError)
"""Errors of the machine, not of a point."""


class WrongOutputError(ValueError):
    """The function returned other names, shapes or types than for the first points."""


@dataclass(frozen=True)
class Output:
    """One output: dtype as a string of NumPy, and shape for one point."""

    dtype: str
    shape: tuple[int, ...]

    @property
    def fill(self) -> Any:
        """The value of points that failed: NaN, -1, 0 or false."""
        kind = np.dtype(self.dtype).kind
        return {"f": float("nan"), "i": -1, "u": 0, "b": False}[kind]


Schema = dict[str, Output]
"""The outputs of a function by name."""


class Outcome(NamedTuple):
    """The outputs of some points, the status of each point, and the texts of errors by the position of the point."""

    values: dict[str, np.ndarray]
    status: np.ndarray
    texts: dict[int, str]


def schema_of(result: Any, count: int | None) -> Schema:
    """Return the schema of the result of a function for one point (`count` is None), or for `count` points.

    **Raises:** WrongOutputError if the result is not a mapping from names to numbers or arrays of numbers.
    """
    schema = {}
    for name, value in _mapping(result).items():
        array = _array(name, value)
        if count is not None and array.shape[:1] != (count,):
            raise WrongOutputError(
                f"the function must return one row for each of {count} points, but the output '{name}' has the shape "
                f"{array.shape}"
            )
        if name != FAILED_KEY:
            schema[name] = Output(array.dtype.str, array.shape if count is None else array.shape[1:])
    return schema


def call(
    function: Callable[..., Any], batch: bool, points: Mapping[str, np.ndarray], count: int, schema: Schema
) -> Outcome:
    """Return the outcome of `count` points.

    **Raises:** WrongOutputError for other names, shapes or types than those in `schema`; for a `batch`, any error of
    the function.
    """
    outcome = Outcome(
        {name: np.full((count, *x.shape), x.fill, x.dtype) for name, x in schema.items()},
        np.zeros(count, np.int8),
        {},
    )
    if batch:
        try:
            _fill(outcome, slice(None), function(dict(points)), schema, (count,))
        except NoValidPointError as error:
            outcome.status[:], outcome.texts[0] = RAISED, str(error)
    else:
        columns = {name: values.tolist() for name, values in points.items()}
        for k in range(count):
            point = {name: values[k] for name, values in columns.items()}
            try:
                result = function(point)
            except FATAL:
                raise
            except Exception as error:
                outcome.status[k], outcome.texts[k] = RAISED, f"{type(error).__name__}: {error}"
                continue
            try:
                _fill(outcome, k, result, schema, ())
            except WrongOutputError as error:
                raise WrongOutputError(f"{error}; the parameters of this point are {_text(point)}") from None
    _find_nan(outcome)
    return outcome


def _fill(outcome: Outcome, place: Any, result: Any, schema: Schema, rows: tuple[int, ...]) -> None:
    """Store the result for one point or for a batch; the floats of a point that failed become NaN."""
    given = dict(_mapping(result))
    failed = _failed(given.pop(FAILED_KEY, False), rows)
    if given.keys() != schema.keys():
        _refuse_names(given, schema)
    for name, output in schema.items():
        array = _array(name, given[name])
        if array.shape != (*rows, *output.shape):
            raise WrongOutputError(
                f"the output '{name}' has the shape {array.shape}, but {(*rows, *output.shape)} was expected, as for "
                "the first points"
            )
        if not np.can_cast(array.dtype, output.dtype, "same_kind"):
            raise WrongOutputError(
                f"the output '{name}' has the dtype {array.dtype}, but {np.dtype(output.dtype)} was expected, as for "
                "the first points: always return the same type, such as float(x)"
            )
        outcome.values[name][place] = array
    if failed.any():
        outcome.status[place] = np.where(failed, FAILED, OK)
        for name, output in schema.items():
            if output.dtype[1] == "f":
                wide = failed.reshape((*rows, *(1 for _ in output.shape)))
                outcome.values[name][place] = np.where(wide, output.fill, outcome.values[name][place])


def _find_nan(outcome: Outcome) -> None:
    """Set the status of points that have a NaN, although the function reports success."""
    bad = np.zeros(outcome.status.size, bool)
    for values in outcome.values.values():
        if values.dtype.kind == "f":
            bad |= np.isnan(values).any(axis=tuple(range(1, values.ndim)))
    outcome.status[bad & (outcome.status == OK)] = NOT_A_NUMBER


def _mapping(result: Any) -> Mapping[str, Any]:
    if not isinstance(result, Mapping) or not result or not all(isinstance(name, str) for name in result):
        raise WrongOutputError(
            "the function of a sweep must return a dictionary from names to numbers or arrays, such as "
            f"{{'duration': 3.5}}, but returned {described(result)}"
        )
    return result


def _array(name: str, value: Any) -> np.ndarray:
    array = np.asarray(value)
    if array.dtype.kind not in "biuf":
        raise WrongOutputError(
            f"the output '{name}' must be a number, an array of numbers, or a bool, but the function returned "
            f"{described(value)}"
        )
    return array.astype(array.dtype.newbyteorder("<"), copy=False)


def _failed(value: Any, rows: tuple[int, ...]) -> np.ndarray:
    failed = np.asarray(value)
    if failed.dtype != bool or failed.shape not in ((), rows):
        raise WrongOutputError(
            f"the output 'failed' must be one bool for each point, but {described(value)} was returned"
        )
    return np.broadcast_to(failed, rows)


def _refuse_names(given: Mapping[str, Any], schema: Schema) -> None:
    known = tuple(schema)
    missing, unknown = [n for n in known if n not in given], [n for n in given if n not in schema]
    if unknown:
        raise WrongOutputError(
            f"the function returned '{unknown[0]}', which it did not return for the first points; "
            f"{suggestion(unknown[0], known, 'outputs')}"
        )
    raise WrongOutputError(f"the function did not return '{missing[0]}', which it returned for the first points")


def _text(point: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} = {value:.9g}" for name, value in point.items())
