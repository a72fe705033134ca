"""The value of a limit on one path quantity: a bound on its magnitude, or on two sides of its signed value."""

from __future__ import annotations  # so that `help` shows short names

from collections.abc import Collection, Iterator
from typing import Any

import equinox as eqx
import numpy as np

from qtraj.foundation.arrays import as_float, concrete, require_positive
from qtraj.foundation.document import storable
from qtraj.foundation.types import ArrayInput, Scalar
from qtraj.path.path_quantity import PathQuantity
from qtraj.path.quantity import quantity
from qtraj.path.sides import LOWER, has_sides, upper_side

Limit = ArrayInput | None | tuple[ArrayInput | None, ArrayInput | None]
"""The value of a limit: a number for the magnitude, or a pair (lower, upper); None means no limit."""


@storable
class Sides(eqx.Module):
    """The lower and the upper bound on a signed value; at most one of them is None."""

    lower: Scalar | None
    upper: Scalar | None

    def __iter__(self) -> Iterator[Scalar | None]:
        return iter((self.lower, self.upper))

    def __repr__(self) -> str:
        return f"({', '.join(map(_text, (self.lower, self.upper)))})"


Bound = Scalar | Sides
"""A limit that is set."""


def bound_of(value: Limit | Sides, name: str) -> Bound | None:
    """Check the limit on a quantity, and return it as arrays, or None if there is no limit.

    **Raises:** ValueError with the name of the limit and what was expected.
    """
    if value is None:
        return None
    entry = quantity(name)
    if isinstance(value, Sides):
        value = value.lower, value.upper
    if isinstance(value, tuple | list):
        return _two_sided(value, entry)
    limit = _number(value, f"the limit {name}", entry)
    require_positive(limit, f"the limit {name}", entry.label)
    return limit


def by_side(name: str, bound: Bound) -> Iterator[tuple[str, Scalar]]:
    """Return the names and the values of the bounds that a limit consists of; see `qtraj.path.sides`."""
    if not isinstance(bound, Sides):
        yield name, bound
        return
    for side, value in zip(_names(name), (bound.lower, bound.upper), strict=True):
        if value is not None:
            yield side, value


def part_of(bound: Bound, name: str, names: Collection[str]) -> Bound | None:
    """Return the bounds of a limit that are in `names`, or None without any."""
    kept = [side for side, _ in by_side(name, bound) if side in names]
    if not isinstance(bound, Sides):
        return bound if kept else None
    lower, upper = (
        x if side in kept else None for side, x in zip(_names(name), (bound.lower, bound.upper), strict=True)
    )
    return None if lower is None and upper is None else Sides(lower, upper)


def _names(name: str) -> tuple[str, str]:
    """Return the names of the lower and of the upper bound."""
    return name + LOWER, upper_side(quantity(name))


def _text(x: Scalar | None) -> str:
    known = None if x is None else concrete(x)
    return repr(x) if known is None else np.array2string(known, formatter={"float_kind": lambda x: f"{x:.6g}"})


def _two_sided(given: Any, entry: PathQuantity) -> Bound | None:
    what = f"the limit {entry.name}"
    if len(given) != 2:
        raise ValueError(f"{what} must be one number or a pair (lower, upper), but {given!r} was given")
    if not has_sides(entry):
        raise ValueError(f"{what} must be one number, which bounds the magnitude, but {given!r} was given")
    names = "lower", "upper"
    lower, upper = (
        None if x is None else _number(x, f"the {k} bound of {what}", entry) for k, x in zip(names, given, strict=True)
    )
    for k, x in zip(names, (lower, upper), strict=True):
        if x is not None and (known := concrete(x)) is not None and not np.all(np.isfinite(known)):
            raise ValueError(f"the {k} bound of {what} must be finite, or None for no bound, but {given!r} was given")
    if lower is None and upper is None:
        return None
    if entry.component is None and entry.signed is None:
        return _of_magnitude(lower, upper, entry)
    _require_ascending(lower, upper, what)
    return Sides(lower, upper)


def _of_magnitude(lower: Scalar | None, upper: Scalar | None, entry: PathQuantity) -> Bound | None:
    """Return a two-sided limit on a quantity that is never negative."""
    what = f"the limit {entry.name}"
    if upper is not None:
        require_positive(upper, f"the upper bound of {what}", entry.label)
    known = None if lower is None else concrete(lower)
    if known is not None and np.any(known < 0):
        raise ValueError(
            f"the lower bound of {what} must not be negative, because the {entry.title} never is, but {known.tolist()} "
            f"was given: pass None instead{_signed_instead(entry)}"
        )
    _require_ascending(lower, upper, what)
    return Sides(lower, upper)


def _signed_instead(entry: PathQuantity) -> str:
    return "; the yaw rate is signed, positive in left turns" if entry.name in ("curvature", "angular_rate") else ""


def _require_ascending(lower: Scalar | None, upper: Scalar | None, what: str) -> None:
    low, high = (None if x is None else concrete(x) for x in (lower, upper))
    if low is not None and high is not None and np.any(low >= high):
        raise ValueError(
            f"the lower bound of {what} must be below the upper one, but ({low.tolist()}, {high.tolist()}) was given: "
            "leave some room, because no search can keep a quantity exactly constant"
        )


def _number(value: Any, what: str, entry: PathQuantity) -> Scalar:
    try:
        limit = as_float(value)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{what} must be a number [{entry.label}], but {value!r} was given") from error
    if limit.ndim != 0:
        raise ValueError(
            f"{what} must be one number, or a pair as a tuple (lower, upper), but an array of shape {limit.shape} was "
            "given"
        )
    return limit
