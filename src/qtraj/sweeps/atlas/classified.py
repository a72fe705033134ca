"""What a function says about points: their class, the limits that are met first, and values."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from typing_extensions import TypeAliasType

from qtraj.foundation.suggestion import suggestion

CLASSES = ("feasible", "sampled", "infeasible", "undecided", "failed")
"""The classes of points; the code of a class is its index.

- feasible: a solution was found, and every limit is proved to be satisfied.
- sampled: a solution was found, but some limits were only checked on a fine grid.
- infeasible: no solution was found that satisfies the limits.
- undecided: the search stopped too early.
- failed: the problem is ill-posed, or its numbers are not finite.
"""
FEASIBLE, SAMPLED, INFEASIBLE, UNDECIDED, FAILED = range(len(CLASSES))

STATUS, FIRST_LIMIT = "status", "first_limit"

PointFunction = TypeAliasType("PointFunction", Callable[[Any, Any], Any])
"""A function of the values x (n,) and y (n,) of two parameters: booleans (n,), or a mapping with the key "status"."""


class Classified(NamedTuple):
    """The codes of the classes, the limit of each point ("" for none), and values by name, for n points."""

    status: Int[np.ndarray, " n"]
    first_limit: np.ndarray
    values: dict[str, Float[np.ndarray, " n"]]


def classify(function: PointFunction, x: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"]) -> Classified:
    """Call the function of a user with n points, and check what it returns.

    **Raises:** ValueError for arrays of other shapes, for unknown classes, and without the key "status".
    """
    found = function(x, y)
    found = dict(found) if isinstance(found, Mapping) else {STATUS: found}
    if STATUS not in found:
        raise ValueError(f"the function of an atlas must return 'status', but it returned {', '.join(found) or 'none'}")
    status = _codes(_array(found.pop(STATUS), STATUS, len(x)))
    names = _array(found.pop(FIRST_LIMIT, np.full(len(x), "")), FIRST_LIMIT, len(x)).astype(str)
    return Classified(status, names, {name: _numbers(values, name, len(x)) for name, values in found.items()})


def joined(parts: list[Classified]) -> Classified:
    """Join the results of several calls.

    **Raises:** ValueError if they contain different values.
    """
    names = [*parts[0].values]
    for part in parts:
        if [*part.values] != names:
            raise ValueError(
                "the function of an atlas must return the same values for all points, but it returned "
                f"{', '.join(names) or 'none'} and then {', '.join(part.values) or 'none'}"
            )
    values = {name: np.concatenate([part.values[name] for part in parts]) for name in names}
    status = np.concatenate([part.status for part in parts])
    return Classified(status, np.concatenate([part.first_limit for part in parts]), values)


def _array(values: Any, name: str, count: int) -> np.ndarray:
    array = np.asarray(values)
    if array.shape != (count,):
        raise ValueError(
            f"{name!r} must have the shape ({count},), one entry for each point, but the function of the atlas "
            f"returned the shape {array.shape}"
        )
    return array


def _numbers(values: Any, name: str, count: int) -> np.ndarray:
    array = _array(values, name, count)
    if array.dtype.kind not in "fiub":
        raise ValueError(f"the values {name!r} of an atlas must be real numbers, but they have dtype {array.dtype}")
    return array.astype(float)


def _codes(status: Bool[np.ndarray, " n"] | np.ndarray) -> Int[np.ndarray, " n"]:
    if status.dtype == bool:
        return np.where(status, FEASIBLE, INFEASIBLE)
    names = status.astype(str)
    if unknown := sorted(set(names.tolist()) - set(CLASSES)):
        raise ValueError(
            f"{unknown[0]!r} is not a class of points ({suggestion(unknown[0], CLASSES, 'classes')}): return booleans, "
            "true where feasible, or names of classes"
        )
    return np.array([CLASSES.index(name) for name in names], np.int64)
