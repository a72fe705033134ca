"""Registry of outputs: all quantities that can be evaluated along a path and its frame.

Each entry consists of the name, unit, meaning, axes and formula of an output. The path quantities of
`quantity.QUANTITIES` are added to the entries of this module. `qtraj.evaluate`, its tables and reductions, datasets and
the command line use this registry.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from qtraj.foundation import record
from qtraj.path.frame_axes import labels_of
from qtraj.path.own_name import OwnName
from qtraj.path.path_quantity import INERTIA, PARAMETERS, PRINCIPAL, VEHICLE, WHEELBASE, PathQuantity
from qtraj.path.quantity import QUANTITIES, SIDES, quantity
from qtraj.path.sides import upper_side
from qtraj.path.vehicle import Vehicle, has_principal_inertia

MAGNITUDE = "_magnitude"
"""The ending of the output with the magnitude of a signed quantity."""

SIZES = {axis: len(names) for axis, names in labels_of("").items()}
"""Number of components along each axis."""


@dataclass(frozen=True)
class Channel:
    """An output of `qtraj.evaluate`: name, unit, meaning, axes and formula.

    `axes` are the names of the component axes. `formula` computes the output from `batch.instants.Instants`. `needs`
    names the data required in addition to the path and the frame: "" for none, or a constant of `path_quantity`.
    `gravity` indicates that the gravity of a vehicle is used if there is one.
    """

    name: str
    unit: str
    meaning: str
    axes: tuple[str, ...]
    formula: Callable[[Any], Any]
    needs: str = ""
    gravity: bool = False

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the output at one instant."""
        return tuple(SIZES[axis] for axis in self.axes)

    def labelled(self, values: Any, *lead: str) -> record.Quantity:
        """Add unit and meaning to the values; `lead` are the names of the axes before the component axes."""
        return record.Quantity(values, self.unit, self.meaning, (*lead, *self.axes))


def _scalar(entry: PathQuantity, formula: Callable[[Any], Any] | None = None) -> Channel:
    formula = formula or (lambda at: at.path_quantity(entry))
    return Channel(entry.variable, entry.unit, entry.meaning, (), formula, entry.needs, entry.gravity)


def _magnitude(entry: PathQuantity) -> PathQuantity:
    """Return the magnitude of a quantity that is signed in the registry."""
    value, meaning = entry.signed, entry.meaning.partition(";")[0]
    return replace(
        entry,
        output=f"{entry.name}{MAGNITUDE}",
        meaning=f"magnitude of the {meaning}",
        signed=None if value is None else lambda i: abs(value(i)),
    )


_ENTRIES = (
    Channel("position", "m", "position, world axes", ("world",), lambda at: at.derivative(0)),
    Channel("velocity", "m s-1", "velocity, world axes", ("world",), lambda at: at.derivative(1)),
    Channel("acceleration", "m s-2", "acceleration, world axes", ("world",), lambda at: at.derivative(2)),
    Channel("jerk", "m s-3", "jerk, world axes", ("world",), lambda at: at.derivative(3)),
    Channel(
        "dcm",
        "1",
        "direction cosines: rows are the body axes in world components; maps world to body",
        ("body", "world"),
        lambda at: at.dcm,
    ),
    Channel(
        "quaternion",
        "1",
        "unit quaternion, scalar first, Hamilton, body to world",
        ("quaternion_component",),
        lambda at: at.quaternion,
    ),
    Channel("gibbs", "1", "Gibbs vector e tan(angle/2)", ("body",), lambda at: at.gibbs),
    _scalar(QUANTITIES["speed"], lambda at: at.speed),
    _scalar(QUANTITIES["curvature"], lambda at: at.curvature),
    Channel("torsion", "m-1", "torsion of the path", (), lambda at: at.torsion),
    Channel("rate", "rad s-1", "angular rate of the frame, body axes", ("body",), lambda at: at.rate),
    Channel(
        "angular_acceleration",
        "rad s-2",
        "angular acceleration of the frame, body axes",
        ("body",),
        lambda at: at.acceleration,
    ),
    Channel(
        "force",
        "N",
        "force that moves the vehicle along the path against inertia, gravity and drag; body axes",
        ("body",),
        lambda at: at.force,
        VEHICLE,
    ),
    Channel(
        "moment",
        "N m",
        "moment that rotates the vehicle with the frame, body axes",
        ("body",),
        lambda at: at.moment,
        INERTIA,
    ),
    Channel(
        "defined",
        "1",
        "whether the frame exists; where it does not exist, the other outputs are finite fallback values",
        (),
        lambda at: at.defined,
    ),
)


class _Channels(dict[str, Channel]):
    """The outputs by name; the `OwnName` of a quantity of one's own carries its output."""

    def __missing__(self, name: str) -> Channel:
        if isinstance(name, OwnName):
            return _scalar(name.output)
        raise KeyError(name)

    def __contains__(self, name: object) -> bool:
        return isinstance(name, OwnName) or super().__contains__(name)


CHANNELS: dict[str, Channel] = _Channels({entry.name: entry for entry in _ENTRIES})
"""The outputs by name, in the order in which they are displayed."""
for _entry in (x for entry in QUANTITIES.values() for x in (quantity(upper_side(entry)), entry)):
    CHANNELS.setdefault(_entry.variable, _scalar(_entry))
MAGNITUDES = {f"{x.name}{MAGNITUDE}": _magnitude(x) for x in QUANTITIES.values() if x.signed is not None}
"""The magnitudes of quantities whose value is limited by a number, so that they are no entries of the registry."""
CHANNELS.update({_name: _scalar(_entry) for _name, _entry in MAGNITUDES.items()})


def outputs_with(vehicle: Vehicle | None) -> tuple[str, ...]:
    """Return the names of the outputs that can be evaluated with this vehicle, or without a vehicle if it is None."""
    has = provided(vehicle)
    return tuple(name for name, entry in CHANNELS.items() if entry.needs in has)


def vehicle_outputs(vehicle: Vehicle | None) -> list[str]:
    """Return the names of the path quantities that need a vehicle and can be evaluated with this vehicle.

    Without a vehicle (None), the list is empty.
    """
    has = provided(vehicle)
    of_quantities = {x.variable for x in QUANTITIES.values()} | {x.variable for x in SIDES.values()}
    return [name for name, x in CHANNELS.items() if name in of_quantities and x.needs and x.needs in has]


def provided(vehicle: Vehicle | None) -> set[str]:
    """Return the values of `Channel.needs` that this vehicle satisfies; if it is None, only "" is satisfied."""
    has_inertia = vehicle is not None and vehicle.inertia is not None
    has_wheelbase = vehicle is not None and vehicle.wheelbase is not None
    satisfied = {VEHICLE: vehicle is not None, INERTIA: has_inertia, PRINCIPAL: has_principal_inertia(vehicle)}
    satisfied |= {PARAMETERS: vehicle is not None, WHEELBASE: has_wheelbase}
    return {"", *(need for need, holds in satisfied.items() if holds)}
