"""Limits on accelerations that depend on the speed, such as motor and brake curves."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Array, Float

from qtraj.design.along import Changing, numbers_of
from qtraj.foundation.argument import described
from qtraj.foundation.arrays import as_float, concrete
from qtraj.foundation.document import storable, stored_as
from qtraj.foundation.namespace import namespace
from qtraj.foundation.types import ArrayInput

MAX_LISTED = 6
"""Largest number of values that are listed in texts."""


def _stored(x: BySpeed) -> dict[str, Any]:
    if x.values.ndim == 1:
        return {"speeds": x.speeds, "magnitude": x.values}
    sides = dict(zip(("lower", "upper"), x.values.T, strict=True))
    return {"speeds": x.speeds} | {name: y for name, y in sides.items() if not np.isnan(np.asarray(y)).any()}


def _built(speeds: Any, lower: Any | None = None, upper: Any | None = None, magnitude: Any | None = None) -> BySpeed:
    return BySpeed(speeds, lower, upper, magnitude=magnitude)


@stored_as(_stored, _built)
@storable
class BySpeed(Changing):
    """A limit on an acceleration as a function of the speed, linear between the given speeds.

    Below the first speed the first value holds, and above the last speed the last one: a limit on the speed itself is
    `Limits(speed=...)`. In `Limits`, it may be the limit on `longitudinal_acceleration` and `lateral_acceleration`:

        Limits(longitudinal_acceleration=BySpeed([0, 10, 30], lower=[-6, -6, -4], upper=[3, 3, 0.8]))
        Limits(longitudinal_acceleration=(-6, BySpeed([0, 10, 30], upper=[3, 3, 0.8])))
        Limits(lateral_acceleration=BySpeed([0, 30], magnitude=[9, 7]))

    Args:
        speeds: (n,) [m/s], ascending, at least 0.
        lower: (n,) [m/s²], the lower bound on the signed value at these speeds, or None for no bound.
        upper: (n,) [m/s²], the upper bound, or None for no bound.
        magnitude: (n,) [m/s²], positive, the bound on the magnitude, instead of `lower` and `upper`.

    Raises:
        ValueError: For speeds that are negative or do not increase, for another number of values, values that are not
            finite, and for no values or a magnitude together with `lower` or `upper`.

    Example:
        >>> grip = BySpeed([0.0, 30.0], magnitude=[9.0, 7.0])
        >>> float(grip.at(15.0))
        8.0
    """

    speeds: Float[Array, " n"]
    values: Float[Array, " n *sides"]

    def __init__(
        self,
        speeds: ArrayInput,
        lower: ArrayInput | None = None,
        upper: ArrayInput | None = None,
        *,
        magnitude: ArrayInput | None = None,
    ):
        if (magnitude is None) == (lower is None and upper is None):
            raise ValueError("pass either a magnitude, or a lower bound, an upper bound or both")
        self.speeds = _speeds(speeds)
        if magnitude is not None:
            self.values = _values(magnitude, "magnitude", self.speeds)
            return
        sides = zip(("lower", "upper"), (lower, upper), strict=True)
        absent = np.full(self.speeds.shape, np.nan)
        self.values = as_float(
            np.stack([absent if x is None else np.asarray(_values(x, what, self.speeds)) for what, x in sides], axis=1)
        )

    def __repr__(self) -> str:
        v, known = np.asarray(self.speeds), concrete(self.values)
        if known is None or v.size > MAX_LISTED:
            return f"BySpeed({v.size} values up to {v[-1]:.6g} m/s)"
        if known.ndim == 1:
            return f"BySpeed({_listed(v)}, {'magnitude' if (known > 0).all() else 'values'}={_listed(known)})"
        sides = [f"{what}={_listed(x)}" for what, x in zip(("lower", "upper"), known.T, strict=True) if x[0] == x[0]]
        return f"BySpeed({_listed(v)}, {', '.join(sides)})"

    def at(self, speed: Any) -> Any:
        """Return the value at a speed [m/s]; for two bounds a pair on the last axis, NaN for a missing one."""
        xp = namespace(self.values, speed)
        if self.values.ndim == 1:
            return xp.interp(xp.asarray(speed), xp.asarray(self.speeds), xp.asarray(self.values))
        columns = [xp.interp(xp.asarray(speed), xp.asarray(self.speeds), x) for x in xp.asarray(self.values).T]
        return xp.stack(columns, axis=-1)

    def scaled(self, factor: Any) -> BySpeed:
        """Return the same with the values multiplied by `factor`."""
        return self._with(self.values * factor)

    def stricter(self, side: int, fraction: float) -> BySpeed:
        """Return the bound on this `side` that is stricter by `fraction` of its largest magnitude."""
        return self._with(self.values - side * fraction * self.size)

    @property
    def size(self) -> float:
        """The largest magnitude [m/s²], or 1 if all values are zero."""
        return float(np.abs(self.values).max()) or 1.0

    def strictest(self, side: int) -> float:
        """Return the strictest value of the bound on this `side`."""
        return float(side * np.min(side * np.asarray(self.values)))

    def loosest(self, side: int) -> float:
        """Return the loosest value of the bound on this `side`."""
        return float(side * np.max(side * np.asarray(self.values)))


def of_magnitude(value: Any, what: str) -> BySpeed:
    """Return a positive number, or a `BySpeed` with one bound, as a magnitude.

    **Raises:** ValueError with the name `what` and what was expected.
    """
    found = value
    if not isinstance(value, BySpeed):
        try:
            number = as_float(value)
        except (TypeError, ValueError) as error:
            raise ValueError(
                f"{what} must be a number [m/s²] or a BySpeed, but {described(value)} was given"
            ) from error
        if number.ndim:
            raise ValueError(f"{what} must be one number [m/s²] or a BySpeed, but {described(value)} was given")
        found = BySpeed([0.0], magnitude=number[None])
    elif value.values.ndim > 1:
        found = one_side(value, 1, what)
    if not (np.asarray(found.values) > 0).all():
        raise ValueError(f"{what} must be positive at every speed [m/s²], but {value!r} was given")
    return found


def one_side(given: BySpeed, side: int, what: str) -> BySpeed:
    """Return the lower (`side` −1) or the upper bound (1) of a limit that has no other one.

    **Raises:** ValueError if there are two bounds, or only the one on the other side.
    """
    if given.values.ndim == 1:
        return given
    lower, upper = given.sides()
    found, other = (lower, upper) if side < 0 else (upper, lower)
    if found is None or other is not None:
        names = ("lower", "upper") if side < 0 else ("upper", "lower")
        raise ValueError(f"{what} must have the bound {names[0]}= or magnitude=, and no {names[1]}=, but is {given!r}")
    return found


def _speeds(given: ArrayInput) -> Array:
    try:
        found = as_float(given)
    except (TypeError, ValueError) as error:
        raise ValueError(f"speeds must contain numbers [m/s], but {described(given)} was given") from error
    known = concrete(found)
    if known is None:
        raise ValueError("speeds must have concrete values: create BySpeed outside jit, grad and vmap")
    ascends = known.ndim == 1 and known.size > 0 and np.isfinite(known).all() and (np.diff(known) > 0).all()
    if not ascends or known[0] < 0:
        raise ValueError(
            f"speeds must contain ascending, finite numbers [m/s], at least 0, but {known.tolist()} was given"
        )
    return found


def _values(given: ArrayInput, what: str, speeds: Array) -> Array:
    found = numbers_of(given)
    known = concrete(found)
    if known is None:
        raise ValueError(f"{what} must have concrete values: create BySpeed outside jit, grad and vmap")
    if known.shape != speeds.shape or not np.isfinite(known).all():
        raise ValueError(
            f"{what} must contain one finite number [m/s²] for each of the {speeds.shape[0]} speeds, but "
            f"{known.tolist()} was given"
        )
    return found


def _listed(x: Any) -> str:
    return f"[{', '.join(f'{y:.6g}' for y in np.asarray(x).tolist())}]"
