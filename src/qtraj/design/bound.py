"""The value of a limit on one path quantity: a bound on its magnitude, or on two sides of its signed value.

A bound is a number, an `Along` or `Regions` whose value changes along the way, or a `BySpeed` or `Ellipse` whose value
depends on the speed.
"""

from __future__ import annotations  # so that `help` shows short names

from collections.abc import Collection, Iterator, Mapping
from typing import Any

import equinox as eqx
import numpy as np

from qtraj.design.along import Along, Changing, Variable
from qtraj.design.by_speed import BySpeed, one_side
from qtraj.design.ellipse import Ellipse
from qtraj.design.regions import Regions
from qtraj.foundation.arrays import as_float, concrete, require_positive
from qtraj.foundation.document import storable
from qtraj.foundation.types import ArrayInput, Scalar
from qtraj.path.path_quantity import PathQuantity
from qtraj.path.quantity import COMBINED, quantity
from qtraj.path.sides import LOWER, has_sides, upper_side

BY_SPEED = ("longitudinal_acceleration", "lateral_acceleration")
"""Quantities whose limits may depend on the speed."""

Limit = ArrayInput | Variable | None | tuple[ArrayInput | Changing | None, ArrayInput | Changing | None]
"""The value of a limit: a number for the magnitude, or a pair (lower, upper); None means no limit."""

OneBound = Scalar | Changing | Ellipse
"""A bound that is set: a number, or one that changes along the way."""


@storable
class Sides(eqx.Module):
    """The lower and the upper bound on a signed value; at most one of them is None."""

    lower: OneBound | None = None
    upper: OneBound | None = None

    def __iter__(self) -> Iterator[OneBound | None]:
        return iter((self.lower, self.upper))

    def __repr__(self) -> str:
        return f"({', '.join(map(_text, (self.lower, self.upper)))})"


Bound = OneBound | Sides
"""A limit that is set."""


def bound_of(value: Limit | Sides, name: str) -> Bound | None:
    """Check the limit on a quantity, and return it as arrays, or None if there is no limit.

    **Raises:** ValueError with the name of the limit and what was expected.
    """
    if value is None:
        return None
    _require_support(value, name)
    found, entry = _bound_of(value, name), quantity(name)
    if entry.tangent_of and found is not None:
        for side in found if isinstance(found, Sides) else (found,):
            _require_angle(side, f"the limit {name}", entry)
    return found


def _bound_of(value: Any, name: str) -> Bound | None:
    entry = quantity(name)
    if isinstance(value, Ellipse):
        return value
    if isinstance(value, Sides):
        value = value.lower, value.upper
    if isinstance(value, Changing):
        by_speed = isinstance(value, BySpeed) and (entry.component is not None or value.kind == "lower")
        value = value.sides() if by_speed or value.values.ndim > 1 else value
    if isinstance(value, tuple | list):
        return _two_sided(value, entry)
    limit = _bound(value, f"the limit {name}", entry, 1)
    _require_positive(limit, f"the limit {name}", entry)
    return limit


def _require_support(value: Any, name: str) -> None:
    """Raise a ValueError for a limit on the combined acceleration or with the speed that the quantity cannot have."""
    each = (value.lower, value.upper) if isinstance(value, Sides) else value
    each = each if isinstance(each, tuple | list) else (each,)
    if name == COMBINED and not isinstance(value, Ellipse):
        raise ValueError(
            f"the limit {name} must be an Ellipse, such as Ellipse(braking=8.0, accelerating=3.0, lateral=9.0), but "
            f"{value!r} was given"
        )
    if name != COMBINED and any(isinstance(x, Ellipse) for x in each):
        raise ValueError(f"an Ellipse limits the combined acceleration: pass {COMBINED}= instead of {name}=")
    if name not in BY_SPEED and any(isinstance(x, BySpeed) for x in each):
        raise ValueError(
            f"only limits on {' and '.join(BY_SPEED)} may depend on the speed, but {name} is {value!r}: pass a number"
        )


def numbers(bound: OneBound) -> Any:
    """Return the number, or all numbers, of a bound as an array."""
    return bound.values if isinstance(bound, Changing) else bound


def _require_positive(bound: Any, what: str, entry: PathQuantity) -> None:
    """Raise a ValueError for a bound that is not positive and finite; an `Along` may be infinite in parts."""
    if not isinstance(bound, Changing):
        require_positive(bound, what, entry.label)
        return
    known = concrete(bound.values)
    if known is not None and not (known > 0).all():
        bad = float(known[~(known > 0)][0])
        raise ValueError(f"the values of {what} must be positive, or None [{entry.label}], but {bad:g} was given")


def _require_angle(bound: OneBound | None, what: str, entry: PathQuantity) -> None:
    """Raise a ValueError for an angle that has no tangent."""
    if bound is None:
        return
    known, largest = concrete(numbers(bound)), entry.tangent_of * np.pi / 2
    if known is not None and (np.isfinite(known) & (np.abs(known) >= largest)).any():
        bad = np.ravel(known)[np.ravel(np.abs(known) >= largest)][0]
        raise ValueError(
            f"{what} must be an angle below {largest:.6g} rad, but {bad:g} rad was given (3 degrees are 0.0524 rad)"
        )


def by_side(name: str, bound: Bound) -> Iterator[tuple[str, OneBound]]:
    """Return the names and the values of the bounds that a limit consists of; see `qtraj.path.sides`."""
    if not isinstance(bound, Sides):
        yield name, bound
        return
    for side, value in zip(_names(name), (bound.lower, bound.upper), strict=True):
        if value is not None:
            yield side, value


def joined_sides(bounds: Mapping[str, Any]) -> dict[str, Any]:
    """Return the limits that consist of these bounds: the inverse of `by_side`."""
    limits: dict[str, Any] = {}
    for name, bound in bounds.items():
        entry = quantity(name)
        own = entry.base or entry.name
        if entry.lower or name != own or f"{own}{LOWER}" in bounds:
            lower, upper = limits.get(own, (None, None))
            limits[own] = (bound, upper) if entry.lower else (lower, bound)
        else:
            limits[own] = bound
    return limits


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
    entry = quantity(name)
    return name + LOWER, name + upper_side(entry).removeprefix(entry.name)


def _text(x: OneBound | None) -> str:
    known = None if x is None or isinstance(x, Changing) else concrete(x)
    return repr(x) if known is None else np.array2string(known, formatter={"float_kind": lambda x: f"{x:.6g}"})


def _two_sided(given: Any, entry: PathQuantity) -> Bound | None:
    what = f"the limit {entry.name}"
    if len(given) != 2:
        raise ValueError(f"{what} must be one number or a pair (lower, upper), but {given!r} was given")
    if not has_sides(entry):
        raise ValueError(f"{what} must be one number, which bounds the magnitude, but {given!r} was given")
    names = "lower", "upper"
    lower, upper = (
        None if x is None else _bound(x, f"the {k} bound of {what}", entry, side)
        for k, x, side in zip(names, given, (-1, 1), strict=True)
    )
    for k, x in zip(names, (lower, upper), strict=True):
        if x is None or isinstance(x, Changing):
            continue
        if (known := concrete(x)) is not None and not np.all(np.isfinite(known)):
            raise ValueError(f"the {k} bound of {what} must be finite, or None for no bound, but {given!r} was given")
    if lower is None and upper is None:
        return None
    if entry.component is None and entry.signed is None:
        return _of_magnitude(lower, upper, entry)
    _require_ascending(lower, upper, what)
    return Sides(lower, upper)


def _of_magnitude(lower: OneBound | None, upper: OneBound | None, entry: PathQuantity) -> Bound | None:
    """Return a two-sided limit on a quantity that is never negative."""
    what = f"the limit {entry.name}"
    if upper is not None:
        _require_positive(upper, f"the upper bound of {what}", entry)
    if isinstance(lower, BySpeed):
        raise ValueError(f"{what} by speed can only have an upper bound: pass upper= or magnitude= alone")
    if isinstance(lower, Changing):  # without a bound it is not below zero anyway
        lower = lower.at_least(0.0)
    known = None if lower is None else concrete(numbers(lower))
    if known is not None and np.any(known < 0):
        raise ValueError(
            f"the lower bound of {what} must not be negative, because the {entry.title} never is, but {known.tolist()} "
            f"was given: pass None instead{_signed_instead(entry)}"
        )
    _require_ascending(lower, upper, what)
    return Sides(lower, upper)


def _signed_instead(entry: PathQuantity) -> str:
    return "; the yaw rate is signed, positive in left turns" if entry.name in ("curvature", "angular_rate") else ""


def _require_ascending(lower: OneBound | None, upper: OneBound | None, what: str) -> None:
    if lower is None or upper is None:
        return
    if isinstance(lower, Regions) or isinstance(upper, Regions):  # their values do not belong to the same places
        return
    if isinstance(lower, BySpeed) and isinstance(upper, Along):  # only a contradiction at every speed is one
        lower = as_float(lower.loosest(-1))
    elif isinstance(lower, Along) and isinstance(upper, BySpeed):
        upper = as_float(upper.loosest(1))
    low, high, place = *(concrete(x) for x in _compared(lower, upper)), ""
    if low is None or high is None or not np.any(low >= high):
        return
    if isinstance(lower, Changing) or isinstance(upper, Changing):
        worst = int(np.argmax(low >= high))
        unit = "m/s" if isinstance(lower, BySpeed) or isinstance(upper, BySpeed) else "m"
        low, high = (x[worst] for x in np.broadcast_arrays(low, high))
        place = f" at {_places(lower, upper)[worst]:.6g} {unit}"
    raise ValueError(
        f"the lower bound of {what} must be below the upper one, but ({low.tolist()}, {high.tolist()}) was given"
        f"{place}: leave some room, because no search can keep a quantity exactly constant"
    )


def _places(*bounds: OneBound) -> np.ndarray:
    """Return all distances [m] or speeds [m/s] at which one of the bounds changes."""
    places = [np.asarray(x.distance) for x in bounds if isinstance(x, Along)]
    return np.unique(np.concatenate([*places, *(np.asarray(x.speeds) for x in bounds if isinstance(x, BySpeed))]))


def _compared(lower: OneBound, upper: OneBound) -> tuple[Any, Any]:
    """Return the values of both bounds at all distances or speeds where one of them changes."""
    if not (isinstance(lower, Changing) or isinstance(upper, Changing)):
        return lower, upper
    at = _places(lower, upper)
    sides = ((lower, -1), (upper, 1))
    return tuple(  # type: ignore[return-value]
        x.strictest(at, at, side) if isinstance(x, Along) else x.at(at) if isinstance(x, BySpeed) else x
        for x, side in sides
    )


def _bound(value: Any, what: str, entry: PathQuantity, side: int) -> OneBound:
    """Return a number or an `Along` as a bound; missing values become infinite on this `side`."""
    if not isinstance(value, Changing):
        return _number(value, what, entry)
    if isinstance(value, BySpeed):
        return one_side(value, side, what)
    if value.values.ndim > 1:
        raise ValueError(f"{what} must have one value for each distance, but {value!r} has pairs: pass it as the limit")
    found = value.without_missing(side)
    known = concrete(found.values)
    if known is not None and (side * known == -np.inf).any():
        raise ValueError(f"the values of {what} must be finite, or None for no limit, but {value!r} was given")
    return found


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
