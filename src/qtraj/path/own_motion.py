"""The motion that is passed to the function of a quantity of one's own: recorded as a formula, or as arrays."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

from qtraj.foundation.namespace import xp
from qtraj.path import components
from qtraj.path.own_recording import RecordedNumber, recorded
from qtraj.path.product import Factor, Product, product_of
from qtraj.path.product_vector import ProductVector

NAMES = ("position", "velocity", "acceleration", "jerk", "snap")
"""The derivatives of the path, from order 0."""

PARAMETERS = ("mass", "gravity", "drag", "rolling", "wheelbase", "friction")
"""The parameters of a vehicle that a function can use; `friction` is a pair."""

INVERSE_FRICTION = ("inv_long", "inv_lat")
"""The names in `RoadParameters` of the inverses of the two numbers of `friction`."""


class Motion:
    """The motion at one instant: `position`, `velocity`, `acceleration`, `jerk`, `snap`, `speed` and `vehicle`.

    The vectors have world components `p.velocity[2]` and the methods `dot`, `cross` and `norm`.
    """

    def __init__(self, vectors: list[Any], speed: Any, vehicle: Any):
        self._vectors, self.speed, self.vehicle = vectors, speed, vehicle

    def __getattr__(self, name: str) -> Any:
        if name in NAMES:
            return self._vectors[NAMES.index(name)]
        raise AttributeError(f"the motion has no {name!r}; it has {', '.join(NAMES)}, speed and vehicle")


class _Parameters:
    """The parameters of a vehicle; `of` returns one of them."""

    def __init__(self, of: Callable[[str], Any]):
        self._of = of

    def __getattr__(self, name: str) -> Any:
        if name not in PARAMETERS:
            raise AttributeError(f"the vehicle of a motion has no {name!r}; it has {', '.join(PARAMETERS)}")
        return self._of(name)


class ArrayVector:
    """A vector whose components are arrays of one shape."""

    def __init__(self, parts: Any):
        self.parts = tuple(parts)

    def dot(self, other: Any) -> Any:
        """Return the scalar product with another vector, or with three numbers."""
        return components.dot(self.parts, tuple(other))

    def cross(self, other: Any) -> ArrayVector:
        """Return the cross product with another vector, or with three numbers."""
        return ArrayVector(components.cross(self.parts, tuple(other)))

    def norm(self) -> Any:
        """Return the length of the vector."""
        return sqrt(self.dot(self))

    def __getitem__(self, axis: int) -> Any:
        return self.parts[axis]

    def __len__(self) -> int:
        return 3

    def __add__(self, other: Any) -> ArrayVector:
        return ArrayVector(x + y for x, y in zip(self.parts, tuple(other), strict=True))

    __radd__ = __add__

    def __neg__(self) -> ArrayVector:
        return self * -1

    def __sub__(self, other: Any) -> ArrayVector:
        return ArrayVector(x - y for x, y in zip(self.parts, tuple(other), strict=True))

    def __rsub__(self, other: Any) -> ArrayVector:
        return -self + other

    def __mul__(self, factor: Any) -> ArrayVector:
        return ArrayVector(x * factor for x in self.parts)

    __rmul__ = __mul__

    def __truediv__(self, divisor: Any) -> ArrayVector:
        return ArrayVector(x / divisor for x in self.parts)


def recorded_motion() -> Motion:
    """Return a motion whose numbers are formulas."""
    vectors = [ProductVector.derivative(k) for k in range(len(NAMES))]
    named = [recorded(vector, name) for vector, name in zip(vectors, NAMES, strict=True)]
    return Motion(named, recorded(vectors[1].norm(), "speed"), _Parameters(_recorded_parameter))


def _recorded_parameter(name: str) -> Any:
    if name != "friction":
        return recorded(_parameter(name), f"vehicle.{name}")
    return tuple(recorded(1 / _parameter(x), f"vehicle.friction[{k}]") for k, x in enumerate(INVERSE_FRICTION))


def _parameter(name: str) -> Product:
    return Product(Fraction(1), {Factor("parameter", (name,), positive=True): 2})


def motion_of(i: Any) -> Motion:
    """Return the motion of invariants whose derivatives are arrays in world axes."""
    zero = 0.0 * i.S
    vectors = [None if row is None else ArrayVector(x + zero for x in row) for row in i.r]
    friction = lambda: tuple(1 / getattr(i.vehicle, name) for name in INVERSE_FRICTION)  # noqa: E731
    return Motion(vectors, i.v, _Parameters(lambda x: friction() if x == "friction" else getattr(i.vehicle, x)))


def sqrt(x: Any) -> Any:
    """Return the square root in the function of a `Quantity`: of a formula, a number or an array.

    The root of a negative number is 0, with derivative 0 like the root of 0. On a path on which it occurs, a formula is
    undefined.

    **Raises:** TypeError for anything else.

    Example:
        >>> import qtraj as qt
        >>> level = qt.Quantity("level_speed", "m/s", lambda p: qt.sqrt(p.velocity[0] ** 2 + p.velocity[1] ** 2))
        >>> level.provable
        True
    """
    if isinstance(x, RecordedNumber):
        return x.sqrt()
    if not hasattr(x, "dtype") and product_of(x) is None:
        raise TypeError(f"sqrt expects a number, an array or a formula, but {x!r} was given")
    zero = x <= 0
    return xp.where(zero, 0.0, xp.sqrt(xp.where(zero, 1.0, x)))
