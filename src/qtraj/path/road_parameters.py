"""Define the parameters of a vehicle and its road that the formulas of path quantities contain."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

GRAVITY = 9.80665
"""Standard gravity [m/s²]."""


class RoadParameters(NamedTuple):
    """The parameters of a vehicle and its road in the formulas of path quantities, of any numeric type.

    `mass` is in kg, `gravity` in m/s², and `rolling` is the coefficient of rolling resistance. `drag` is ½ρC_dA/m
    [1/m], with the air density ρ, the drag area C_dA and the mass m; at the speed v, air drag causes the deceleration
    drag·v². `cos` and `sin` are the cosine and sine of the bank angle. `inv_long` and `inv_lat` are the inverses of the
    coefficients of friction. `inertia_tangent` and `inertia_binormal` [kg m²] are the moments of inertia about the
    first axis τ and the third axis b of the frame; both are zero without an inertia, and NaN if the axes τ, n and b of
    the frame are not principal axes. `wheelbase` is in m, and zero without one.

    `axis_x`, `axis_y` and `axis_z` are the components of the axis about which the frame of the road is upright, in
    world axes; they are None if this axis is the vertical. On a road with a direction `left`, the axis is this
    direction. The road is then at a right angle to the one that is level relative to this axis, so `cos` and `sin` are
    those of the bank less a right angle.
    """

    mass: Any
    gravity: Any
    drag: Any
    rolling: Any
    cos: Any
    sin: Any
    inv_long: Any
    inv_lat: Any
    inertia_tangent: Any
    inertia_binormal: Any
    wheelbase: Any = 0.0
    axis_x: Any = None
    axis_y: Any = None
    axis_z: Any = None

    @property
    def numbers(self) -> tuple[Any, ...]:
        """The parameters that are not None; `RoadParameters(*numbers)` are the same parameters."""
        return self[:-3] if self.axis_x is None else self[:]

    @property
    def axis(self) -> tuple[Any, Any, Any] | None:
        """The axis about which the frame of the road is upright; None is the vertical."""
        return None if self.axis_x is None else self[-3:]

    def each(self, change: Callable[[Any], Any]) -> RoadParameters:
        """Return the parameters, each of them changed by a function."""
        return RoadParameters(*map(change, self.numbers))


NO_VEHICLE = RoadParameters(1.0, GRAVITY, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 0.0)
"""Parameters for formulas that do not depend on the vehicle."""


def about_left(cos: Any, sin: Any, left: Any, xp: Any) -> tuple[Any, Any, tuple[Any, Any, Any]]:
    """Return the `cos`, the `sin` and the axis of `RoadParameters` on a road whose left is `left` (*n, 3).

    `cos` and `sin` are those of the bank. Where `left` is zero, they do not change, and the axis is the vertical. The
    arrays belong to the module `xp`, NumPy or JAX's NumPy.
    """
    known = (left != 0).any(axis=-1)
    x, y, z = (xp.where(known, left[..., k], float(k == 2)) for k in range(3))
    return xp.where(known, sin, cos), xp.where(known, -cos, sin), (x, y, z)
