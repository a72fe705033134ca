"""One axis of an atlas: a parameter, its range, the coarse cells and the tolerance of the border."""

import math

import equinox as eqx
import numpy as np

from qtraj.foundation.document import storable
from qtraj.foundation.units import symbol
from qtraj.path.own_units import unit_of

MAX_STEPS, MAX_LEVELS = 4096, 30
"""Largest number of coarse cells along an axis, and of halvings of a cell."""


@storable
class AtlasAxis(eqx.Module):
    """A parameter of an atlas, with its range and the tolerance of the border along it.

    Args:
        name: The name of the parameter, used in datasets and figures.
        low: The first value, in `unit`.
        high: The last value, larger than `low`.
        tolerance: Largest distance of the border from its true position along this axis, in `unit`. The cells along the
            border are at most this wide.
        steps: Number of coarse cells, by default 16. A region of another class that no corner of the coarse cells
            touches may be missed.
        unit: The unit, a product of powers of m, s, kg, rad, N and W, such as "m/s"; by default "1".

    Raises:
        ValueError: For an empty name, a range or a tolerance that is not finite and positive, a number of steps that
            is not an integer from 1 to 4096, a tolerance below 2⁻³⁰ coarse cells, or an unknown unit.

    Example:
        >>> AtlasAxis("radius", 10.0, 50.0, tolerance=0.5, unit="m").label
        'radius [m]'
    """

    name: str = eqx.field(static=True)
    low: float = eqx.field(static=True)
    high: float = eqx.field(static=True)
    tolerance: float = eqx.field(static=True)
    steps: int = eqx.field(static=True)
    unit: str = eqx.field(static=True)

    def __init__(self, name: str, low: float, high: float, tolerance: float, steps: int = 16, unit: str = "1"):
        if not isinstance(name, str) or not name.strip():
            raise ValueError(f"the name of an axis must be a text, such as 'radius', but {name!r} was given")
        self.name, self.unit, self.steps = name, unit_of(unit), steps
        self.low, self.high = (_number(x, f"{side} of the axis {name!r}") for side, x in (("low", low), ("high", high)))
        if not self.high > self.low:
            raise ValueError(f"the axis {name!r} must end above its start, but it goes from {low} to {high}")
        self.tolerance = _number(tolerance, f"tolerance of the axis {name!r}")
        if not self.tolerance > 0:
            raise ValueError(f"the tolerance of the axis {name!r} must be positive, but {tolerance} was given")
        if isinstance(steps, bool) or not isinstance(steps, int) or not 1 <= steps <= MAX_STEPS:
            raise ValueError(
                f"the steps of the axis {name!r} must be an integer from 1 to {MAX_STEPS}, but {steps} was given"
            )
        if self.levels > MAX_LEVELS:
            width = (self.high - self.low) / steps
            raise ValueError(
                f"the tolerance {tolerance} of the axis {name!r} is too small for cells of {width:.6g}: pass at least "
                f"{width / 2**MAX_LEVELS:.3g}"
            )

    @property
    def levels(self) -> int:
        """How often a coarse cell must be halved until it is not wider than the tolerance."""
        ratio = (self.high - self.low) / self.steps / self.tolerance
        return max(0, math.ceil(math.log2(ratio) - 1e-9)) if math.isfinite(ratio) else MAX_LEVELS + 1

    @property
    def label(self) -> str:
        """The name and the symbol of the unit, such as "radius [m]"."""
        shown = symbol(self.unit)
        return self.name.replace("_", " ") + (f" [{shown}]" if shown else "")

    def at(self, index: np.ndarray, count: int) -> np.ndarray:
        """Return the values at positions on a lattice of `count` cells; the ends are exact."""
        fraction = np.asarray(index, float) / count
        return self.low * (1 - fraction) + self.high * fraction


def _number(x: float, what: str) -> float:
    try:
        value = float(x)
    except (TypeError, ValueError):
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"the {what} must be a finite number, but {x!r} was given")
    return value
