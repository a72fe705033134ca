"""Limits on accelerations that depend on the speed, such as motor and brake curves."""

from __future__ import annotations

from typing import Any, Literal

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from qtraj.design.along import Changing
from qtraj.foundation.argument import described
from qtraj.foundation.arrays import as_float, concrete
from qtraj.foundation.devices import on_one_device
from qtraj.foundation.document import storable, stored_as
from qtraj.foundation.namespace import namespace
from qtraj.foundation.types import ArrayInput

MAX_LISTED = 6
"""Largest number of values that are listed in texts."""

NEAR_ZERO = 0.01
"""Magnitudes below this fraction of the largest one count as this fraction in a relative tolerance."""

SIDES = ("lower", "upper")
"""The bounds of a limit, which are also the names of arguments."""

Kind = Literal["magnitude", "lower", "upper", "sides"]


def _stored(x: BySpeed) -> dict[str, Any]:
    columns = dict(zip(SIDES, x.values.T, strict=True)) if x.kind == "sides" else {x.kind: x.values}
    return {"speeds": x.speeds} | columns


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
        ValueError: For speeds that are negative or do not increase, another number of values, values that are not
            finite, a magnitude that is not positive, and for no values or a magnitude together with a bound.

    Example:
        >>> grip = BySpeed([0.0, 30.0], magnitude=[9.0, 7.0])
        >>> float(grip.at(15.0))
        8.0
    """

    speeds: Float[Array, " n"]
    values: Float[Array, " n *sides"]
    kind: Kind = eqx.field(static=True)

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
        given: dict[Kind, Any] = {"lower": lower, "upper": upper, "magnitude": magnitude}
        found: dict[Kind, Array] = {what: _values(x, what, self.speeds) for what, x in given.items() if x is not None}
        self.kind = next(iter(found)) if len(found) == 1 else "sides"
        self.values = found[self.kind] if len(found) == 1 else namespace(*found.values()).stack([*found.values()], 1)
        if self.kind == "magnitude" and not (np.asarray(self.values) > 0).all():
            raise ValueError(f"magnitude must be positive at every speed [m/s²], but {_listed(self.values)} was given")

    def __repr__(self) -> str:
        v, known = np.asarray(self.speeds), concrete(self.values)
        if known is None or v.size > MAX_LISTED:
            return f"BySpeed({v.size} values up to {v[-1]:.6g} m/s)"
        columns = zip(SIDES, known.T, strict=True) if self.kind == "sides" else [(self.kind, known)]
        return f"BySpeed({_listed(v)}, {', '.join(f'{what}={_listed(x)}' for what, x in columns)})"

    @on_one_device
    def at(self, speed: Any) -> Any:
        """Return the value at a speed [m/s]; with two bounds a pair (lower, upper) on the last axis."""
        xp = namespace(self.values, speed)
        if self.kind != "sides":
            return xp.interp(xp.asarray(speed), xp.asarray(self.speeds), xp.asarray(self.values))
        columns = [xp.interp(xp.asarray(speed), xp.asarray(self.speeds), x) for x in xp.asarray(self.values).T]
        return xp.stack(columns, axis=-1)

    def sides(self) -> tuple[BySpeed | None, BySpeed | None]:
        """Return the lower and the upper bound, or None for a missing one."""
        if self.kind == "sides":
            lower, upper = np.asarray(self.values).T
            return BySpeed(self.speeds, lower=lower), BySpeed(self.speeds, upper=upper)
        if self.kind == "magnitude":
            return self.scaled(-1.0), BySpeed(self.speeds, upper=self.values)
        return (self, None) if self.kind == "lower" else (None, self)

    def scaled(self, factor: float) -> BySpeed:
        """Return the same with the values multiplied by `factor`; a negative one exchanges the bounds."""
        if not factor < 0:
            return self._with(self.values * factor)
        if self.kind == "sides":
            lower, upper = np.asarray(factor * self.values).T
            return BySpeed(self.speeds, lower=upper, upper=lower)
        return BySpeed(self.speeds, **{"upper" if self.kind == "lower" else "lower": factor * self.values})

    def stricter(self, side: int, fraction: float) -> BySpeed:
        """Return the bound on this `side`, stricter by `fraction` of its values, or of `NEAR_ZERO` of its size."""
        return self._with(self.values - side * fraction * np.maximum(np.abs(self.values), NEAR_ZERO * self.size))

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
    if isinstance(value, BySpeed):
        upper = one_side(value, 1, what)
        if not (np.asarray(upper.values) > 0).all():
            raise ValueError(f"{what} must be positive at every speed [m/s²], but {value!r} was given")
        return BySpeed(value.speeds, magnitude=value.values)
    try:
        number = as_float(value)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{what} must be a number [m/s²] or a BySpeed, but {described(value)} was given") from error
    if number.ndim:
        raise ValueError(f"{what} must be one number [m/s²] or a BySpeed, but {described(value)} was given")
    known = concrete(number)
    if known is None:
        raise ValueError(f"{what} must have a concrete value: create Ellipse outside jit, grad and vmap")
    if not 0 < known < np.inf:
        raise ValueError(f"{what} must be positive and finite [m/s²], but {known:g} was given")
    return BySpeed([0.0], magnitude=number[None])


def one_side(given: BySpeed, side: int, what: str) -> BySpeed:
    """Return the lower (`side` −1) or the upper bound (1) of a limit that has no other one.

    A magnitude is an upper bound.

    **Raises:** ValueError if there are two bounds, or only the one on the other side.
    """
    wanted, other = SIDES if side < 0 else SIDES[::-1]
    if given.kind == "magnitude" and side > 0:
        return BySpeed(given.speeds, upper=given.values)
    if given.kind != wanted:
        more = "" if side < 0 else " or magnitude="
        raise ValueError(f"{what} must have the bound {wanted}={more}, and no {other}=, but is {given!r}")
    return given


def _speeds(given: ArrayInput) -> Array:
    found, known = _known(given, "speeds", "must contain numbers [m/s]")
    ascends = known.ndim == 1 and known.size > 0 and np.isfinite(known).all() and (np.diff(known) > 0).all()
    if not ascends or known[0] < 0:
        raise ValueError(
            f"speeds must contain ascending, finite numbers [m/s], at least 0, but {known.tolist()} was given"
        )
    return found


def _values(given: ArrayInput, what: str, speeds: Array) -> Array:
    expected = f"must contain one finite number [m/s²] for each of the {speeds.shape[0]} speeds"
    found, known = _known(given, what, expected)
    if known.shape != speeds.shape or not np.isfinite(known).all():
        raise ValueError(f"{what} {expected}, but {known.tolist()} was given")
    return found


def _known(given: ArrayInput, what: str, expected: str) -> tuple[Array, np.ndarray]:
    """Return an array, and the same in NumPy."""
    try:
        found = as_float(given)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{what} {expected}, but {described(given)} was given") from error
    known = concrete(found)
    if known is None:
        raise ValueError(f"{what} must have concrete values: create BySpeed outside jit, grad and vmap")
    return found, known


def _listed(x: Any) -> str:
    return f"[{', '.join(f'{y:.6g}' for y in np.asarray(x).tolist())}]"
