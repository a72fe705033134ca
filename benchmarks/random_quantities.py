"""Random quantities of one's own, as functions of a motion in any arithmetic."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np

import qtraj as qt

from .exact_motion import Arithmetic


class Vector:
    """A vector of numbers of any kind, with their square root."""

    def __init__(self, parts: Any, sqrt: Any):
        self.parts, self.sqrt = list(parts), sqrt

    def __getitem__(self, k: int) -> Any:
        return self.parts[k]

    def dot(self, other: "Vector") -> Any:
        return sum(x * y for x, y in zip(self.parts, other.parts, strict=True))

    def cross(self, other: "Vector") -> "Vector":
        a, b = self.parts, other.parts
        return Vector([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]], self.sqrt)

    def norm(self) -> Any:
        return self.sqrt(self.dot(self))


OF_SHAPE = (
    lambda p: p.velocity[2] / p.speed,
    lambda p: p.velocity.cross(p.acceleration).norm() / p.speed**3,
    lambda p: p.velocity.cross(p.acceleration)[2] / p.speed**3,
    lambda p: p.position[2],
)
"""Values that do not depend on the timing."""

INVARIANT = (
    lambda p: p.velocity.dot(p.acceleration),
    lambda p: p.velocity.cross(p.acceleration).norm(),
    lambda p: p.acceleration.norm(),
    lambda p: p.velocity[2],
    lambda p: p.velocity.cross(p.acceleration)[2],
    lambda p: p.velocity.dot(p.jerk),
    lambda p: p.velocity.cross(p.acceleration).dot(p.jerk),
    lambda p: p.speed,
)
"""Values that do not depend on the directions of the horizontal axes."""

WORLD = (
    *INVARIANT,
    lambda p: p.velocity[0],
    lambda p: p.acceleration[1],
    lambda p: p.position[2],
    lambda p: p.position.norm(),
)

Function = Callable[[Any, Any], Any]
"""A function of a motion and of the square root of its arithmetic."""


def random_function(rng: np.random.Generator, atoms: Any) -> Function:
    """Return a random function of a motion p and of the function that computes roots."""
    first, second, third = (atoms[k] for k in rng.integers(len(atoms), size=3))
    a, b = (round(float(x), 3) for x in rng.uniform(0.3, 2.0, 2))
    forms: tuple[Function, ...] = (
        lambda p, sqrt: first(p) / p.speed,
        lambda p, sqrt: first(p) * second(p) / p.speed**3,
        lambda p, sqrt: a * first(p) - b * second(p),
        lambda p, sqrt: sqrt(first(p) ** 2 + a * second(p) ** 2) / p.speed,
        lambda p, sqrt: first(p) / (a + second(p) ** 2),
        lambda p, sqrt: a * p.speed - sqrt(b + first(p) ** 2),
        lambda p, sqrt: (first(p) + a * p.speed) / sqrt(second(p) ** 2 + third(p) ** 2 + b),
        lambda p, sqrt: abs(first(p)) * sqrt(p.speed) + b * second(p),
        lambda p, sqrt: first(p) / (p.speed + sqrt(second(p) ** 2 + a)),
    )
    of_shape: tuple[Function, ...] = (
        lambda p, sqrt: a * first(p) - b * second(p),
        lambda p, sqrt: first(p) * second(p),
        lambda p, sqrt: sqrt(first(p) ** 2 + a * second(p) ** 2),
        lambda p, sqrt: first(p) / (a + second(p) ** 2),
        lambda p, sqrt: (first(p) + a) / sqrt(second(p) ** 2 + third(p) ** 2 + b),
        lambda p, sqrt: abs(first(p)) + b * second(p),
    )
    chosen = of_shape if atoms is OF_SHAPE else forms
    return chosen[rng.integers(len(chosen))]


def quantity_of(function: Function) -> qt.Quantity | None:
    """Return the quantity with the unit that its function has, or None for a constant and for a unit with roots."""
    try:
        return qt.Quantity("mine", "1", lambda p: function(p, qt.sqrt))
    except ValueError as error:
        if "does not depend" in str(error):
            return None
        unit = str(error).split("has the unit ")[1].split(",")[0]
    return None if "^" in unit else qt.Quantity("mine", unit, lambda p: function(p, qt.sqrt))


def value_of(function: Function, rows: list[list[Any]], arithmetic: Arithmetic) -> Any:
    """Return the value of a function for position, velocity, acceleration and jerk."""
    position, velocity, acceleration, jerk = (Vector(row, arithmetic.sqrt) for row in rows)
    speed = velocity.norm()
    p = SimpleNamespace(position=position, velocity=velocity, acceleration=acceleration, jerk=jerk, speed=speed)
    return function(p, arithmetic.sqrt)
