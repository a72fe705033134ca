"""Define the scenario keys of deviations, standard deviations or intervals, for tunings with margins."""

from collections.abc import Iterator
from typing import Annotated, Any

from pydantic import Field

from qtraj.design.robust.box import UNITS, Box
from qtraj.design.robust.box_requirements import require_states
from qtraj.design.robust.spread import STATES, VEHICLE, Spread
from qtraj.design.robust.to_share import LARGEST_SHARE, SAMPLES, SMALLEST_SHARE
from qtraj.foundation.naming import naming
from qtraj.scenario import keys
from qtraj.scenario.keys import Part, key

SIGMA = "a finite number, 0 or more, or three for the axes x, y, z"
INTERVAL = "a finite number b, for -b to b, or two finite numbers [lowest, highest]"

Share = Annotated[float, Field(ge=SMALLEST_SHARE, le=LARGEST_SHARE, allow_inf_nan=False)]
Sigmas = keys.Number | keys.Vector
Interval = keys.Number | keys.Pair


def _require_samples(count: int) -> None:
    if count not in SAMPLES:
        raise ValueError(f"it must be a power of two from {min(SAMPLES)} to {max(SAMPLES)}, not {count}")


class SpreadPart(Part):
    """Standard deviations of what is only known approximately; `qtraj tune` and `qtraj route` then tighten the limits.

    All limits are satisfied together with the probability 'share'; see `qtraj.robust_tune` and
    `qtraj.robust_tune_route`. `qtraj sweep` does the same; other commands ignore this table.
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
    share: Share = key(
        "probability that all limits are satisfied",
        0.99,
        values=f"a number from {SMALLEST_SHARE} to {LARGEST_SHARE}",
    )
    samples: Annotated[int, keys.checked_by(_require_samples)] = key(
        "number of sampled paths", 8192, values=f"a power of two from {min(SAMPLES)} to {max(SAMPLES)}"
    )
    seed: keys.Wholes = key("seed of the samples", 0)

    def _faults(self) -> Iterator[str]:
        self.arguments()  # raises for invalid standard deviations
        yield from ()

    def arguments(self) -> dict[str, Any]:
        """Return the arguments of `qtraj.robust_tune` and `qtraj.robust_tune_route` for these deviations.

        **Raises:** ValueError for invalid standard deviations.
        """
        sigmas = {name: getattr(self, name) for name in (*STATES, *VEHICLE, "limits")}
        return {"spread": Spread(**sigmas), "share": self.share, "samples": self.samples, "seed": self.seed}


class BoxPart(Part):
    """Intervals of deviations; `qtraj tune` and `qtraj route` then prove the limits for all deviations in them.

    At most three of the keys besides 'limits'; see `qtraj.Box`. Radial and axial deviations are for `qtraj tune`,
    lateral and vertical ones for `qtraj route`. `qtraj sweep` does the same; other commands ignore this table.
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
    start_lateral_speed: Interval | None = key(
        "of the velocity to the left, at the start", None, values=INTERVAL, unit="m/s"
    )
    start_vertical_speed: Interval | None = key(
        "of the velocity upwards, at the start", None, values=INTERVAL, unit="m/s"
    )
    start_lateral_position: Interval | None = key(
        "of the position to the left, at the start", None, values=INTERVAL, unit="m"
    )
    start_vertical_position: Interval | None = key(
        "of the position upwards, at the start", None, values=INTERVAL, unit="m"
    )
    end_lateral_speed: Interval | None = key(
        "of the velocity to the left, at the end", None, values=INTERVAL, unit="m/s"
    )
    end_vertical_speed: Interval | None = key("of the velocity upwards, at the end", None, values=INTERVAL, unit="m/s")
    end_lateral_position: Interval | None = key(
        "of the position to the left, at the end", None, values=INTERVAL, unit="m"
    )
    end_vertical_position: Interval | None = key("of the position upwards, at the end", None, values=INTERVAL, unit="m")
    mass: Interval | None = key("of the mass of the vehicle", None, values=INTERVAL, unit="kg")
    drag_area: Interval | None = key("of the drag area of the vehicle, also for wind", None, values=INTERVAL, unit="m²")
    limits: dict[str, Interval] = key(
        "of limits, such as friction = 0.05", {}, values="a table [box.limits] of intervals in the units of the limits"
    )

    def _faults(self) -> Iterator[str]:
        self.arguments()  # raises for invalid intervals
        yield from ()

    def arguments(self) -> dict[str, Any]:
        """Return the arguments of `qtraj.robust_tune` and `qtraj.robust_tune_route` for these deviations.

        **Raises:** ValueError for invalid intervals.
        """
        return {"spread": Box(intervals={name: getattr(self, name) for name in self.given(*UNITS)}, limits=self.limits)}


def faults_of_deviations(scenario: Any, of_route: bool) -> Iterator[str]:
    """Yield messages about tables [spread] and [box] that do not match the other tables of a scenario.

    **Raises:** ValueError for deviations of states that paths of another kind have.
    """
    tables = scenario.given("spread", "box")
    if len(tables) > 1:
        yield "spread and box both describe what deviates: specify one of them"
    for table in tables:
        part = getattr(scenario, table)
        for name in VEHICLE:
            if getattr(part, name) and scenario.vehicle is None:
                yield f"{table}.{name} is a deviation of the vehicle: add the table [vehicle]"
        known = scenario.limits.limits()
        for name in part.limits:
            if not {name, name.removesuffix("_min"), name.removesuffix("_max")} & known.keys():
                yield f"{table}.limits.{name} is the deviation of a limit that is not in [limits]: add limits.{name}"
    if scenario.box is not None:
        with naming("[box]: "):
            require_states(scenario.box.arguments()["spread"], of_route)
