"""Define the scenario keys of a spin, for [program.spin] of `qtraj simulate`."""

from typing import Literal

import numpy as np

from qtraj.motion.programs.spin import Spin
from qtraj.scenario import keys
from qtraj.scenario.keys import AttitudePart, Part, key, radians


class SpinPart(Part):
    """A rotation at a constant rate."""

    rate: keys.Vector = key("the angular rate", unit="angle/s")
    axes: Literal["body", "inertial"] = key("the axes of the rate", "body")
    duration: keys.Seconds = key("the duration")
    start: AttitudePart = key(
        "the attitude at the start; default: no rotation, or in a sequence the end of the program before",
        AttitudePart(),
        values="a table with an attitude",
    )

    def program(self, angles: str, start: np.ndarray | None = None) -> Spin:
        """Return the spin; `angles` is "deg" or "rad". Without an attitude of its own, it starts with `start` (4,)."""
        own = self.start.unit_quaternion(angles)
        first = start if own is None else own
        rate = [radians(angles) * x for x in self.rate]
        return Spin(rate, self.duration, (1.0, 0.0, 0.0, 0.0) if first is None else first, self.axes)
