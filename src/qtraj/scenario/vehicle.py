"""Define the scenario keys of a vehicle and of a road that changes along the way."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from qtraj.io.road_file import read_road
from qtraj.path.path_quantity import INERTIA, PRINCIPAL, WHEELBASE
from qtraj.path.road import Road
from qtraj.path.road_parameters import GRAVITY
from qtraj.path.vehicle import AIR_DENSITY, MAX_BANK, Vehicle, require
from qtraj.scenario import keys
from qtraj.scenario.keys import Part, key

Beside = Callable[[str], Path]
"""Maps the name of a file to a path, relative to the folder of the scenario."""


class RoadPart(Part):
    """Bank, friction and direction of the road by the distance along the path: in the scenario or in a file.

    The file is a table with a header: the columns distance, bank, friction (or friction_along and friction_across) and
    inverted, as far as they exist. Units may be in their names, such as bank_deg.
    """

    file: keys.Text | None = key("the file with the table", None)
    distance: list[keys.NotNegative] | None = key(
        "distances from the start of the path", None, values="ascending numbers from 0 [m]"
    )
    bank: list[keys.Number] | None = key(
        "bank angle at each distance, positive if the left side is lower",
        None,
        values="numbers between -pi/2 and pi/2 [rad]",
    )
    friction: list[keys.Positive | keys.PositivePair] | None = key(
        "coefficient of friction at each distance, or two: along and across the vehicle",
        None,
        values="positive numbers, or pairs of them [-]",
    )
    inverted: list[bool] | None = key(
        "whether the road is above the vehicle, from each distance on, as in a loop", None, values="true or false"
    )
    left: list[keys.Number] | list[list[keys.Number]] | None = key(
        "direction to the left of the vehicle, which the road follows instead of the horizontal, as on a vertical loop",
        None,
        values="three numbers, or three for each distance (none where the road is level)",
    )
    kind: Literal["linear", "step"] = key("linear between the distances, or in steps", "linear")

    def road(self, beside: Beside) -> Road:
        """Return the road of this table."""
        return self.table() if self.file is None else read_road(beside(self.file), self.kind)

    def table(self) -> Road:
        """Return the road that is in the scenario."""
        pairs = self.friction and [x if isinstance(x, list) else [x, x] for x in self.friction]
        distance = [0.0] if self.distance is None else self.distance
        return Road(distance, self.bank, pairs, self.kind, self.inverted, self.left)

    def _faults(self) -> Iterator[str]:
        named = self.given("distance", "bank", "friction", "inverted", "left")
        if self.file is not None and named:
            yield f"file and {named[0]} are both specified: specify one of them"
        if self.file is None and self.distance is None and (self.left is None or len(named) > 1):
            yield "a road needs 'distance', or 'file'"
        if self.file is None:
            self.table()


class VehiclePart(Part):
    """The vehicle, for limits on friction, power, forces and moments: a point mass with tyres, on a banked road."""

    mass: keys.Positive = key("mass", unit="kg")
    inertia: keys.Inertia | None = key(
        "moments of inertia about the vehicle's axes (one number if they are equal), or the tensor; used only for "
        "moments",
        None,
    )
    drag_area: keys.NotNegative = key("drag coefficient times frontal area", 0.0, unit="m²")
    rolling_resistance: keys.NotNegative = key("coefficient of rolling resistance", 0.0, unit="-")
    friction: keys.Positive | keys.PositivePair = key(
        "coefficients of friction along and across the vehicle, or one coefficient for both; with 1, the "
        "quantity `friction` is the coefficient of friction that the path requires of the road",
        1.0,
        values="one or two positive finite numbers [-]",
    )
    bank: Annotated[float, Field(gt=-MAX_BANK, lt=MAX_BANK, allow_inf_nan=False)] = key(
        "bank angle of the road, positive if the left side is lower, as in a banked left turn",
        0.0,
        values="a number between -pi/2 and pi/2 [rad]; 3 degrees are 0.0524",
    )
    air_density: keys.NotNegative = key("density of the air", AIR_DENSITY, unit="kg/m³")
    gravity: keys.NotNegative = key("gravitational acceleration, downwards", GRAVITY, unit="m/s²")
    wheelbase: keys.Positive | None = key(
        "distance of the axles, for limits on the steering angle and its rate", None, unit="m"
    )

    road: RoadPart | None = key("a road that changes along the way, instead of bank and friction", None)

    def vehicle(self, beside: Beside) -> Vehicle:
        """Return the vehicle of this table; `beside` maps the name of a file to its path."""
        road = self.road and self.road.road(beside)
        return Vehicle(**self.model_dump(exclude={"road"}), road=road)

    def without_file(self) -> Vehicle:
        """Return the vehicle of this table without a road that is in a file."""
        road = None if self.road is None or self.road.file is not None else self.road.table()
        return Vehicle(**self.model_dump(exclude={"road"}), road=road)

    def _faults(self) -> Iterator[str]:
        self.without_file()
        yield from ()


def require_vehicle(vehicle: Vehicle | None, needs: str, what: str) -> None:
    """Raise a ValueError if the vehicle, or the property of it named by `needs`, is missing.

    The message says that `what`, such as a limit, needs it.
    """
    if needs and vehicle is None:
        contents = "the mass and the wheelbase" if needs == WHEELBASE else "the mass"
        raise ValueError(f"{what} needs a vehicle: add a table [vehicle] with {contents}")
    if needs in (INERTIA, PRINCIPAL) and vehicle is not None and vehicle.inertia is None:
        raise ValueError(f"{what} needs the vehicle's inertia: set the key 'vehicle.inertia' [kg m²]")
    if needs == WHEELBASE and vehicle is not None and vehicle.wheelbase is None:
        raise ValueError(f"{what} needs the vehicle's wheelbase: set the key 'vehicle.wheelbase' [m]")
    require(vehicle, needs, what)
