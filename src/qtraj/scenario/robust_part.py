"""Define the scenario keys of deviations, standard deviations or intervals, for tunings with margins."""

from collections.abc import Iterator
from typing import Any

from qtraj.design.robust.box import UNITS, Box
from qtraj.design.robust.spread import STATES, VEHICLE, Spread
from qtraj.scenario import keys
from qtraj.scenario.keys import Part, key

SIGMA = "a finite number, 0 or more, or three for the axes x, y, z"
INTERVAL = "a finite number b, for -b to b, or two finite numbers [lowest, highest]"

Sigmas = keys.Number | keys.Vector
Interval = keys.Number | keys.Pair


class SpreadPart(Part):
    """Standard deviations of what is only known approximately; `qtraj tune` then tightens the limits.

    All limits are satisfied together with the probability 'share'; see `qtraj.robust_tune`. `qtraj sweep` does the
    same; other commands ignore this table.
    """

    start_position: Sigmas = key("of the position at the start", 0.0, values=SIGMA, unit="m")
    start_velocity: Sigmas = key("of the velocity at the start", 0.0, values=SIGMA, unit="m/s")
    end_position: Sigmas = key("of the position at the end", 0.0, values=SIGMA, unit="m")
    end_velocity: Sigmas = key("of the velocity at the end", 0.0, values=SIGMA, unit="m/s")
    mass: keys.Number = key("of the mass of the vehicle", 0.0, values="a finite number, 0 or more [kg]")
    drag_area: keys.Number = key(
        "of the drag area of the vehicle, also for wind", 0.0, values="a finite number, 0 or more [m²]"
    )
    limits: dict[str, keys.Number] = key(
        "of limits, such as friction = 0.05", {}, values="a table [spread.limits] of numbers in the units of the limits"
    )
    share: keys.Positive = key("probability that all limits are satisfied", 0.99, values="a number from 0.5 to 0.9999")
    samples: keys.Counts = key("number of sampled paths", 8192, values="a power of two, 256 or more")
    seed: keys.Wholes = key("seed of the samples", 0)

    def _faults(self) -> Iterator[str]:
        self.arguments()  # raises for invalid standard deviations
        yield from ()

    def arguments(self) -> dict[str, Any]:
        """Return the arguments of `qtraj.robust_tune` for these deviations.

        **Raises:** ValueError for invalid standard deviations.
        """
        sigmas = {name: getattr(self, name) for name in (*STATES, *VEHICLE, "limits")}
        return {"spread": Spread(**sigmas), "share": self.share, "samples": self.samples, "seed": self.seed}


class BoxPart(Part):
    """Intervals of deviations; `qtraj tune` then proves the limits for all deviations in them.

    At most three of the keys besides 'limits'; see `qtraj.Box`. `qtraj sweep` does the same; other commands ignore this
    table.
    """

    start_speed: Interval | None = key("deviation of the speed at the start", None, values=INTERVAL, unit="m/s")
    start_radial_speed: Interval | None = key(
        "of the velocity away from the axis, at the start", None, values=INTERVAL, unit="m/s"
    )
    start_axial_speed: Interval | None = key(
        "of the velocity along the axis, at the start", None, values=INTERVAL, unit="m/s"
    )
    start_axial_position: Interval | None = key(
        "of the position along the axis, at the start", None, values=INTERVAL, unit="m"
    )
    end_speed: Interval | None = key("deviation of the speed at the end", None, values=INTERVAL, unit="m/s")
    end_radial_speed: Interval | None = key(
        "of the velocity away from the axis, at the end", None, values=INTERVAL, unit="m/s"
    )
    end_axial_speed: Interval | None = key(
        "of the velocity along the axis, at the end", None, values=INTERVAL, unit="m/s"
    )
    end_axial_position: Interval | None = key(
        "of the position along the axis, at the end", None, values=INTERVAL, unit="m"
    )
    mass: Interval | None = key("of the mass of the vehicle", None, values=INTERVAL, unit="kg")
    drag_area: Interval | None = key("of the drag area of the vehicle, also for wind", None, values=INTERVAL, unit="m²")
    limits: dict[str, Interval] = key(
        "of limits, such as friction = 0.05", {}, values="a table [box.limits] of intervals in the units of the limits"
    )

    def _faults(self) -> Iterator[str]:
        self.arguments()  # raises for invalid intervals
        yield from ()

    def arguments(self) -> dict[str, Any]:
        """Return the arguments of `qtraj.robust_tune` for these deviations.

        **Raises:** ValueError for invalid intervals.
        """
        return {"spread": Box(intervals={name: getattr(self, name) for name in self.given(*UNITS)}, limits=self.limits)}
