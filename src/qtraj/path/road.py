"""Define roads whose bank and friction change along the way, by the distance travelled."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float

from qtraj.foundation.argument import described
from qtraj.foundation.arrays import as_float, concrete
from qtraj.foundation.document import storable
from qtraj.foundation.types import ArrayInput

MAX_BANK = np.pi / 2

Kind = Literal["linear", "step"]


class Surface(NamedTuple):
    """The surface of a road at some distances; `bank` and `friction` are None if the road does not define them.

    `side` is −1 where the road is above the vehicle, and otherwise 1. `left` are unit vectors to the left, or the zero
    vector where the road is level in the lateral direction; it is None if the road does not define it.
    """

    bank: Float[np.ndarray, "*n"] | None
    along: Float[np.ndarray, "*n"] | None
    across: Float[np.ndarray, "*n"] | None
    side: Float[np.ndarray, "*n"]
    left: Float[np.ndarray, "*n 3"] | None = None


@storable
class Road(eqx.Module):
    """The bank, friction, side and direction of a road, as functions of the distance from the start of the path.

    A road belongs to a vehicle: `Vehicle(mass, road=Road(...))`. What the road does not define, the vehicle does.

    With the `kind` "linear", bank and friction are interpolated linearly. With "step", the values at `distance[i]` hold
    up to `distance[i + 1]`. The last values hold to the end of the path. Within the uncertainty of a distance, which is
    about 1e-9 of the length of the path, a limit must hold on both sides of a step.

    The grade is not part of a road: it is the slope of the path, so a path in the plane is level.

    Without `left`, an unbanked road is level in the lateral direction, which is undefined where the path is vertical.
    With `left`, its plane contains the path and, as nearly as possible, the vector `left`. On a vertical loop, `left`
    is normal to the plane of the loop, so one road carries the vehicle through the whole loop: upright at the bottom,
    upside down at the top.

    Args:
        distance: (n,) [m], ascending, from 0. By default only 0: the road is the same everywhere.
        bank: (n,) [rad], or one number: the rotation of the road about the direction of motion, positive if the left
            side is lower, as in a banked left turn (see `Vehicle`). By default that of the vehicle.
        friction: (n,) or (n, 2), or one number [-]: the coefficients of friction, along and across the vehicle if there
            are two. By default those of the vehicle.
        kind: "linear" or "step".
        inverted: (n,), or one value: whether the road is above the vehicle, as at the top of a loop. A value holds up
            to the next distance, whatever the `kind`. The direction of the load is then reversed: `normal_load` is
            positive where the road pushes the vehicle down.
        left: (3,), or one vector or None for each of the n distances: the direction to the left of the vehicle in world
            axes, of any length, which the road follows instead of the horizontal. A vector holds up to the next
            distance, whatever the `kind`. The bank rotates the road from there. Forces are undefined where the path
            runs along `left`.

    Raises:
        ValueError: For distances that do not start at 0 or do not increase, another number of values, a bank of a right
            angle or more, a friction that is not positive, a vector `left` that is zero, an unknown `kind`, and traced
            values.

    Example:
        >>> ice = Road([0.0, 80.0, 95.0], friction=[0.8, 0.15, 0.8], kind="step")
        >>> ice.friction[1]
        (0.15, 0.15)
        >>> loop = Road(left=(0, 1, 0))  # for a vertical loop in the plane of x and z
    """

    distance: tuple[float, ...] = eqx.field(static=True)
    bank: tuple[float, ...] | None = eqx.field(static=True)
    friction: tuple[tuple[float, float], ...] | None = eqx.field(static=True)
    kind: str = eqx.field(static=True)
    inverted: tuple[bool, ...] | None = eqx.field(static=True)
    left: tuple[tuple[float, ...], ...] | None = eqx.field(static=True)

    def __init__(
        self,
        distance: ArrayInput = (0.0,),
        bank: ArrayInput | None = None,
        friction: ArrayInput | None = None,
        kind: Kind = "linear",
        inverted: Any = None,
        left: Any = None,
    ):
        if kind not in ("linear", "step"):
            raise ValueError(f"kind must be 'linear' or 'step', but {kind!r} was given")
        at = _numbers(distance, "distance", "m")
        if at.ndim != 1 or not at.size:
            raise ValueError(f"distance must contain ascending numbers [m], but {described(distance)} was given")
        if at[0] != 0:
            raise ValueError(
                f"the distances of a road are measured from the start of the path, but the first one is {at[0]:.9g} m: "
                "subtract it from all distances"
            )
        if (falling := np.flatnonzero(np.diff(at) <= 0)).size:
            k = int(falling[0]) + 1
            raise ValueError(
                f"the distances of a road must ascend, but distance[{k}] = {at[k]:.9g} m follows {at[k - 1]:.9g} m"
            )
        if bank is None and friction is None and inverted is None and left is None:
            raise ValueError("a road defines at least one of bank, friction, inverted and left, but none was given")
        self.kind, self.distance = kind, tuple(at.tolist())
        self.bank = None if bank is None else _banks(bank, at.size)
        self.friction = None if friction is None else _frictions(friction, at.size)
        self.inverted = None if inverted is None else _sides(inverted, at.size)
        self.left = None if left is None else _directions(left, at.size)

    def __repr__(self) -> str:
        known = [name for name in ("bank", "friction", "inverted", "left") if getattr(self, name) is not None]
        place = f"{len(self.distance)} distances over {self.distance[-1]:.6g} m"
        return f"Road({', '.join(known)} at {place}, kind={self.kind!r})"

    @property
    def is_constant(self) -> bool:
        """Whether the road is the same everywhere."""
        return all(x is None or len(set(x)) == 1 for x in (self.bank, self.friction, self.inverted, self.left))

    def sections(self, s: Float[np.ndarray, "*m"]) -> np.ndarray:
        """Return the indices of the sections that contain the distances `s` [m]; the later one where they meet."""
        return np.clip(np.searchsorted(self.distance, s, side="right") - 1, 0, len(self.distance) - 1)

    def at(self, s: Float[np.ndarray, "*m"], sections: np.ndarray | None = None) -> Surface:
        """Return the surface at the distances `s` [m].

        With `sections`, the values are those of the given sections; beyond their ends, those at the ends.
        """
        row = self.sections(s) if sections is None else sections
        side = np.ones(np.shape(row)) if self.inverted is None else np.where(np.array(self.inverted)[row], -1.0, 1.0)
        bank = None if self.bank is None else self._interpolated(np.array(self.bank), s, row)
        left = None if self.left is None else self._units[row]
        if self.friction is None:
            return Surface(bank, None, None, side, left)
        along, across = (self._interpolated(x, s, row) for x in np.array(self.friction).T)
        return Surface(bank, along, across, side, left)

    @property
    def _units(self) -> Float[np.ndarray, "n 3"]:
        """Return the unit vectors to the left, or zero vectors where the road is level in the lateral direction."""
        given = np.array([x or (0.0, 0.0, 0.0) for x in self.left or ()])
        scaled = given / np.where(given.any(axis=1), np.abs(given).max(axis=1), 1.0)[:, None]  # without overflow
        return scaled / np.maximum(np.linalg.norm(scaled, axis=1), 1.0)[:, None]

    def steepest(self, values: Float[np.ndarray, " n"], sections: np.ndarray) -> np.ndarray:
        """Return the largest slope of the `values` at the distances, in sections and next to them."""
        slopes = np.concatenate([[0.0], self._slopes(np.abs(np.diff(values))), [0.0]])
        return np.max([slopes[sections + k] for k in range(3)], axis=0)

    def _interpolated(self, values: Float[np.ndarray, " n"], s: Any, row: np.ndarray) -> np.ndarray:
        at, slope = np.array(self.distance), self._slopes(np.diff(values))[row]
        return values[row] + slope * (np.clip(s, at[row], np.append(at[1:], np.inf)[row]) - at[row])

    def _slopes(self, rises: Float[np.ndarray, " n-1"]) -> Float[np.ndarray, " n"]:
        """Return the slope in each section; the values are constant in the last one."""
        if self.kind == "step":
            return np.zeros(len(self.distance))
        return np.append(rises / np.diff(self.distance), 0.0)


def _numbers(given: Any, name: str, unit: str) -> np.ndarray:
    try:
        known = concrete(as_float(given))
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} of a road must contain numbers [{unit}], but {described(given)} was given") from error
    if known is None:
        raise ValueError(f"{name} of a road must have concrete values: create the Road outside jit, grad and vmap")
    if not np.isfinite(known).all():
        raise ValueError(f"{name} of a road must be finite [{unit}], but {described(given)} was given")
    return np.asarray(known, float)


def _of_each(values: np.ndarray, count: int, name: str, sizes: tuple[tuple[int, ...], ...]) -> np.ndarray:
    if values.shape not in ((), *sizes):
        raise ValueError(
            f"{name} of a road must be one number, or contain one value for each of the {count} distances, but its "
            f"shape is {values.shape}"
        )
    return values


def _banks(given: Any, count: int) -> tuple[float, ...]:
    bank = _of_each(_numbers(given, "bank", "rad"), count, "bank", ((count,),))
    if not (np.abs(bank) < MAX_BANK).all():
        raise ValueError(
            "the bank of a road must be between -pi/2 and pi/2 rad (3 degrees are 0.0524 rad), but "
            f"{described(given)} was given"
        )
    return tuple(np.broadcast_to(bank, count).tolist())


def _frictions(given: Any, count: int) -> tuple[tuple[float, float], ...]:
    friction = _of_each(_numbers(given, "friction", "-"), count, "friction", ((count,), (count, 2)))
    if not (friction > 0).all():
        raise ValueError(f"the friction of a road must be positive [-], but {described(given)} was given")
    pairs = friction if friction.ndim == 2 else np.broadcast_to(friction, count)[:, None]
    return tuple((float(x), float(y)) for x, y in np.broadcast_to(pairs, (count, 2)))


def _sides(given: Any, count: int) -> tuple[bool, ...]:
    values = np.asarray(given)
    if values.dtype != bool or values.shape not in ((), (count,)):
        raise ValueError(
            f"inverted must be true or false, once or for each of the {count} distances, but {described(given)} was "
            "given"
        )
    return tuple(np.broadcast_to(values, count).tolist())


def _directions(given: Any, count: int) -> tuple[tuple[float, ...], ...]:
    """Return a vector for each distance, which is empty where the road is level in the lateral direction."""
    rows: list[Any] = list(given) if np.iterable(given) else []
    if rows and not any(x is None or np.ndim(x) for x in rows):  # one vector
        rows = [given] * count
    if len(rows) != count:
        raise ValueError(
            f"left must be one vector, or one vector or None for each of the {count} distances, but {described(given)} "
            "was given"
        )
    return tuple(() if x is None or np.size(x) == 0 else _direction(x) for x in rows)


def _direction(given: Any) -> tuple[float, ...]:
    vector = _numbers(given, "left", "-")
    if vector.shape != (3,) or not vector.any():
        raise ValueError(
            "left must be a vector of three components that are not all zero, such as (0, 1, 0), but "
            f"{described(given)} was given"
        )
    return tuple(vector.tolist())
