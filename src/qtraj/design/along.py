"""Limits that change along the way, as functions of the distance travelled."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, Literal, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from qtraj.foundation.argument import described
from qtraj.foundation.arrays import as_float, concrete
from qtraj.foundation.devices import on_one_device
from qtraj.foundation.document import storable
from qtraj.foundation.namespace import namespace
from qtraj.foundation.types import ArrayInput, ScalarLike
from qtraj.path.distances import distances
from qtraj.path.hodograph import AbstractHodograph

Kind = Literal["step", "linear"]

MAX_LISTED = 4
"""Largest number of values that are listed in texts."""


class Variable(eqx.Module):
    """A limit that is not constant: it changes along the way, or depends on the speed."""


class Changing(Variable):
    """A limit with several `values`, of which missing ones are NaN or infinite."""

    values: eqx.AbstractVar[Float[Array, " n *sides"]]

    def without_missing(self, side: int) -> Self:
        """Return the same with infinite values instead of missing ones; `side` is −1 for a lower bound, otherwise 1."""
        xp = namespace(self.values)
        return self._with(xp.where(xp.isnan(self.values), side * np.inf, self.values))

    def at_least(self, least: float) -> Self:
        """Return the same with infinite lower bounds replaced by `least`."""
        xp = namespace(self.values)
        return self._with(xp.where(self.values == -np.inf, least, self.values))

    def sides(self) -> tuple[Self | None, Self | None]:
        """Return the lower and the upper side of pairs; a side without any value is None."""
        lower, upper = (self._with(self.values[:, k]) for k in (0, 1))
        return None if _is_empty(lower) else lower, None if _is_empty(upper) else upper

    def _with(self, values: Any) -> Self:
        return eqx.tree_at(lambda x: x.values, self, values)


@storable
class Along(Changing):
    """The value of a limit as a function of the distance travelled from the start of the path.

    With the `kind` "step", the value `values[i]` holds from `distance[i]` to `distance[i + 1]` [m], and at a distance
    where the value changes, both values hold. With "linear", the values are interpolated linearly. The last value holds
    to the end of the path.

    In `Limits`, such a value may replace a number or a side of a pair:

        Limits(speed=Along([0, 120, 300], [13.9, 8.3, 13.9]))
        Limits(longitudinal_acceleration=(Along([0, 50], [-6, -3]), 2))

    Args:
        distance: (n,) [m], ascending, from 0.
        values: (n,), in the unit of the limit; None where there is no limit (only for steps). For a limit with two
            sides also n pairs (lower, upper).
        kind: "step" or "linear".

    Raises:
        ValueError: For distances that do not start at 0 or do not increase, another number of values, a `kind` other
            than "step" and "linear", and for values that are missing although the kind is "linear".

    Example:
        >>> zones = Along([0.0, 40.0, 60.0], [12.0, 5.0, None])
        >>> float(zones.at(50.0))
        5.0
    """

    distance: Float[Array, " n"]
    values: Float[Array, " n *sides"]
    kind: str = eqx.field(static=True)

    def __init__(self, distance: ArrayInput, values: Any, kind: Kind = "step"):
        if kind not in ("step", "linear"):
            raise ValueError(f"kind must be 'step' or 'linear', but {kind!r} was given")
        self.distance, self.values, self.kind = _distances(distance), numbers_of(values), kind
        count = self.distance.shape[0]
        if self.values.shape not in ((count,), (count, 2)):
            raise ValueError(
                f"values must contain one number or one pair (lower, upper) for each of the {count} distances, but its "
                f"shape is {self.values.shape}"
            )
        known = concrete(self.values)
        if kind == "linear" and known is not None and not np.isfinite(known).all():
            raise ValueError("a value is missing or not finite, but linear values need one at each distance: use steps")

    @classmethod
    def from_samples(cls, path: AbstractHodograph, times: ArrayInput, values: Any) -> Along:
        """Return a limit that was recorded along a path, as steps over the distance travelled on this path.

        A value holds from its sample to the next one, and the first value also before its sample.

        Args:
            path: One path with concrete values, such as the result of `fit_route`.
            times: (n,) [s] from the start of the path, such as `track.elapsed`; must not decrease.
            values: (n,), in the unit of the limit; None or NaN where there is no limit.

        Raises:
            ValueError: For times that decrease or are not finite, and another number of values.

        Example:
            >>> line = qt.Route([0.0, 10.0], [[0, 0, 0], [100, 0, 0]], [[10, 0, 0]] * 2, [[0, 0, 0]] * 2)
            >>> qt.Along.from_samples(line, [0.0, 4.0, 6.0], [12.0, 5.0, None])
            Along([0, 40, 60], [12, 5, None])
        """
        t, x = np.asarray(as_float(times), float), np.asarray(numbers_of(values), float)
        if t.ndim != 1 or not t.size or x.shape[:1] != t.shape or not np.isfinite(t).all() or (np.diff(t) < 0).any():
            raise ValueError(
                "times must be finite numbers [s] that do not decrease, one for each value, but the shapes of times "
                f"and values are {t.shape} and {x.shape}"
            )
        on = distances(path)
        s = on.at(np.clip(t, 0.0, on.ends[-1]))
        last = np.append(np.diff(s) > on.uncertainty, True)  # of several samples at one place
        s, x = s[last], x[last]
        s[0] = 0.0
        other = np.append(True, ~np.array([np.array_equal(a, b, equal_nan=True) for a, b in pairwise(x)], bool))
        return cls(s[other], x[other])

    def __repr__(self) -> str:
        d, known = np.asarray(self.distance), concrete(self.values)
        kind = "" if self.kind == "step" else ", kind='linear'"
        if known is None or d.size > MAX_LISTED:
            return f"Along({d.size} values over {d[-1]:.6g} m{kind})"
        values = [_text(x) for x in known]
        return f"Along([{', '.join(f'{x:.6g}' for x in d)}], [{', '.join(values)}]{kind})"

    def scaled(self, factor: Any) -> Along:
        """Return the same with the values multiplied by `factor`."""
        return self._with(self.values * factor)

    @on_one_device
    def at(self, s: ScalarLike) -> Array:
        """Return the value at the distance `s` [m]; the later one where the value changes."""
        xp = namespace(self.values, s)
        if self.kind == "linear":
            return xp.interp(s, self.distance, self.values)
        k = xp.clip(xp.searchsorted(xp.asarray(self.distance), s, side="right") - 1, 0, self.distance.shape[0] - 1)
        return xp.asarray(self.values)[k]

    def strictest(self, low: Float[np.ndarray, " m"], high: Float[np.ndarray, " m"], side: int) -> Float[Any, " m"]:
        """Return the strictest values from `low` to `high` [m]: the smallest, or for `side` −1 the largest."""
        xp, d = namespace(self.values), np.asarray(self.distance)
        own = side * xp.asarray(self.values)
        if self.kind == "linear":
            inside = (d >= low[:, None]) & (d <= high[:, None])
            ends = xp.minimum(xp.interp(low, d, own), xp.interp(high, d, own))
            return side * xp.minimum(ends, _least(own, inside))
        until = np.append(d[1:], np.inf)
        first = np.searchsorted(until, low)  # the first step that has not ended before
        last = np.maximum(np.searchsorted(d, high, side="right") - 1, 0)
        if xp is jnp:
            steps = np.arange(d.size)
            return side * _least(own, (steps >= first[:, None]) & (steps <= last[:, None]))
        found = np.minimum.reduceat(np.append(own, np.inf), np.stack([first, last + 1], axis=1).ravel())
        return side * found[::2]


def _least(values: Float[Any, " n"], wanted: Bool[np.ndarray, "m n"]) -> Float[Any, " m"]:
    xp = namespace(values)
    return xp.min(xp.where(wanted, values, np.inf), axis=1)


def _text(x: Any) -> str:
    """Return a value, or a pair of values, as text; a missing value is None."""
    if np.ndim(x):
        return f"({', '.join(map(_text, x))})"
    return f"{x:.6g}" if np.isfinite(x) else "None"


def _is_empty(x: Changing) -> bool:
    known = concrete(x.values)
    return known is not None and bool(np.isnan(known).all())


def _distances(given: ArrayInput) -> Array:
    try:
        found = as_float(given)
    except (TypeError, ValueError) as error:
        raise ValueError(f"distance must contain numbers [m], but {described(given)} was given") from error
    known = concrete(found)
    if known is None:
        raise ValueError("distance must have concrete values: create Along outside jit, grad and vmap")
    if (
        known.ndim != 1
        or not known.size
        or not np.isfinite(known).all()
        or known[0] != 0
        or (np.diff(known) <= 0).any()
    ):
        raise ValueError(
            f"distance must contain ascending numbers [m] that start with 0, but {known.tolist()} was given; a value "
            "of None means that there is no limit up to the next distance"
        )
    return found


def numbers_of(given: Any) -> Array:
    """Return the values of a limit that changes as an array; a missing value is NaN.

    **Raises:** ValueError for values that are not numbers, pairs or None.
    """

    def number(x: Any) -> Any:
        return [number(y) for y in x] if isinstance(x, list | tuple) else np.nan if x is None else x

    try:
        return as_float(number(given))
    except (TypeError, ValueError) as error:
        raise ValueError(
            "values must contain one number, pair (lower, upper) or None for each distance, but "
            f"{described(given)} was given"
        ) from error
