"""Standard deviations of boundary states, of a vehicle, and of limits."""

from __future__ import annotations  # so that `help` shows short names

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float

from qtraj.foundation.arrays import as_float
from qtraj.foundation.document import storable
from qtraj.foundation.shown import shown, shown_html
from qtraj.foundation.types import ArrayInput

STATES = ("start_position", "start_velocity", "end_position", "end_velocity")
VEHICLE = ("mass", "drag_area")
"""The numbers of a vehicle that may deviate."""


@storable
class Spread(eqx.Module):
    """Independent standard deviations of what is only known approximately, normally distributed.

    Args:
        start_position: [m], a number for all axes or (3,) in world axes; by default 0.
        start_velocity: [m/s], likewise.
        end_position: [m], likewise.
        end_velocity: [m/s], likewise.
        limits: Standard deviations of limits by name, in the unit of the limit, such as `{"friction": 0.05}`.
        mass: Of the mass of the vehicle in the limits [kg].
        drag_area: Of its drag area [m²], also for wind: at the speed v, a headwind w multiplies the drag by (1 + w/v)².
            The drag area is zero where the deviation makes it negative.

    Raises:
        ValueError: For numbers that are negative or not finite, other shapes, and if all numbers are zero.

    Example:
        >>> Spread(start_velocity=0.2, limits={"lateral_acceleration": 0.1}).start_velocity
        array([0.2, 0.2, 0.2])
    """

    start_position: Float[np.ndarray, 3]
    start_velocity: Float[np.ndarray, 3]
    end_position: Float[np.ndarray, 3]
    end_velocity: Float[np.ndarray, 3]
    limits: dict[str, float]
    mass: float
    drag_area: float

    def __init__(
        self,
        start_position: ArrayInput = 0.0,
        start_velocity: ArrayInput = 0.0,
        end_position: ArrayInput = 0.0,
        end_velocity: ArrayInput = 0.0,
        limits: Mapping[str, float] | None = None,
        mass: ArrayInput = 0.0,
        drag_area: ArrayInput = 0.0,
    ):
        states = (start_position, start_velocity, end_position, end_velocity)
        self.start_position, self.start_velocity, self.end_position, self.end_velocity = (
            _sigmas(x, name) for name, x in zip(STATES, states, strict=True)
        )
        self.limits = {str(name): float(_sigmas(x, f"limits[{name!r}]", ())) for name, x in (limits or {}).items()}
        self.mass, self.drag_area = (float(_sigmas(x, n, ())) for x, n in zip((mass, drag_area), VEHICLE, strict=True))
        if not (any(np.any(getattr(self, x)) for x in (*STATES, *VEHICLE)) or any(self.limits.values())):
            raise ValueError(
                "every standard deviation is zero: pass at least one that is positive, or use tune or tune_route"
            )

    def __repr__(self) -> str:
        return shown(
            self,
            start_position="m",
            start_velocity="m/s",
            end_position="m",
            end_velocity="m/s",
            mass="kg",
            drag_area="m²",
        )

    _repr_html_ = shown_html

    @property
    def states(self) -> Float[np.ndarray, 12]:
        """The standard deviations of both states, in the order of the arguments."""
        return np.concatenate([np.asarray(getattr(self, name)) for name in STATES])

    @property
    def vehicle(self) -> Float[np.ndarray, 2]:
        """The standard deviations of the mass [kg] and of the drag area [m²]."""
        return np.array([self.mass, self.drag_area])


def _sigmas(x: Any, name: str, shape: tuple[int, ...] = (3,)) -> np.ndarray:
    array = np.asarray(as_float(x))
    if array.shape not in {(), shape}:
        raise ValueError(f"{name} must be a number{' or (3,)' if shape else ''}, but has the shape {array.shape}")
    if not (np.isfinite(array).all() and (array >= 0).all()):
        raise ValueError(f"{name} must contain finite standard deviations, 0 or more, but {array.tolist()} was given")
    return np.broadcast_to(array, shape).copy()
