"""Define the scenario keys of a spin, for [program.spin] of `qtraj simulate`."""

from typing import Literal

from qtraj.motion.programs.spin import Spin
from qtraj.scenario import keys
from qtraj.scenario.keys import AttitudePart, Part, key, radians


class SpinPart(Part):
    """A rotation at a constant rate."""

    rate: keys.Vector = key("the angular rate", unit="angle/s")
    axes: Literal["body", "inertial"] = key("the axes of the rate", "body")
    duration: keys.Seconds = key("the duration")
    start: AttitudePart = key("the attitude at the start", AttitudePart(), values="a table with an attitude")

    def program(self, angles: str) -> Spin:
        """Return the spin; `angles` is "deg" or "rad"."""
        start = self.start.unit_quaternion(angles)
        rate = [radians(angles) * x for x in self.rate]
        return Spin(rate, self.duration, (1.0, 0.0, 0.0, 0.0) if start is None else start, self.axes)
