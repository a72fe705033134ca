"""A limit on the combined longitudinal and lateral acceleration: an ellipse, or the ggv diagram of a vehicle."""

from __future__ import annotations

from typing import Any

from jaxtyping import Array, Float

from qtraj.design.along import Variable
from qtraj.design.by_speed import BySpeed, of_magnitude
from qtraj.foundation.arrays import concrete
from qtraj.foundation.devices import on_one_device
from qtraj.foundation.document import storable
from qtraj.foundation.namespace import namespace
from qtraj.foundation.types import ArrayInput


@storable
class Ellipse(Variable):
    """A limit on the combined acceleration, (a_τ/x)² + (a_n/y)² ≤ 1, which needs no vehicle.

    Here a_τ is the longitudinal and a_n the lateral acceleration, x is `accelerating` for a_τ > 0 and `braking` for a_τ
    < 0, and y is `lateral`. Each of them may depend on the speed (`BySpeed`): this is the ggv diagram of a vehicle.

        Limits(combined_acceleration=Ellipse(braking=8.0, accelerating=3.0, lateral=9.0))
        Limits(combined_acceleration=Ellipse(8.0, BySpeed([0, 15, 40], magnitude=[5, 5, 1]), 9.0))

    The value of the limited quantity is √((a_τ/x)² + (a_n/y)²) [-], and its limit is 1.

    Args:
        braking: the largest deceleration x [m/s²] without lateral acceleration, a positive number or a `BySpeed`.
        accelerating: the largest acceleration x [m/s²] without lateral acceleration.
        lateral: the largest lateral acceleration y [m/s²] at constant speed.

    Raises:
        ValueError: For values that are not positive at every speed, or not concrete.

    Example:
        >>> grip = Ellipse(braking=8.0, accelerating=3.0, lateral=9.0)
        >>> float(grip.usage(-4.0, 4.5, 10.0)) < 1.0
        True
    """

    braking: BySpeed
    accelerating: BySpeed
    lateral: BySpeed

    def __init__(
        self, braking: ArrayInput | BySpeed, accelerating: ArrayInput | BySpeed, lateral: ArrayInput | BySpeed
    ):
        self.braking = of_magnitude(braking, "braking")
        self.accelerating = of_magnitude(accelerating, "accelerating")
        self.lateral = of_magnitude(lateral, "lateral")

    def __repr__(self) -> str:
        return f"Ellipse({', '.join(f'{name}={_text(getattr(self, name))}' for name in FIELDS)})"

    @property
    def values(self) -> Float[Array, " n"]:
        """All values [m/s²]."""
        each = [getattr(self, name).values for name in FIELDS]
        return namespace(*each).concatenate(each)

    @on_one_device
    def usage(self, longitudinal: Any, lateral: Any, speed: Any) -> Any:
        """Return √((a_τ/x)² + (a_n/y)²) for accelerations [m/s²] and speeds [m/s]."""
        xp = namespace(longitudinal, lateral, speed)
        x = xp.where(xp.asarray(longitudinal) > 0, self.accelerating.at(speed), self.braking.at(speed))
        return xp.hypot(longitudinal / x, lateral / self.lateral.at(speed))

    def scaled(self, factor: Any) -> Ellipse:
        """Return the same with the values multiplied by `factor`."""
        return Ellipse(*(getattr(self, name).scaled(factor) for name in FIELDS))


FIELDS = ("braking", "accelerating", "lateral")


def _text(x: BySpeed) -> str:
    known = concrete(x.values)
    return f"{known[0]:.6g}" if known is not None and known.size == 1 else repr(x)


OfSpeed = BySpeed | Ellipse
"""A limit that depends on the speed."""
