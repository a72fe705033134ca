"""The registry of outputs: everything that can be evaluated along a path and its frame.

An entry has the name, unit, meaning, axes and formula of an output. Path quantities are added from their own registry.
`qtraj.evaluate`, its tables and reductions, datasets and the command line use this registry.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from qtraj.foundation import record
from qtraj.path.frame_axes import labels_of
from qtraj.path.path_quantity import PathQuantity
from qtraj.path.quantity import QUANTITIES

SIZES = {axis: len(names) for axis, names in labels_of("").items()}
"""The number of components along each axis."""


VEHICLE, INERTIA = "vehicle", "inertia"


@dataclass(frozen=True)
class Channel:
    """An output: `axes` are the axes of its components, and `formula` computes it from `batch.instants.Instants`.

    `needs` is what it needs beside the path and the frame: "", "vehicle" or "inertia".
    """

    name: str
    unit: str
    meaning: str
    axes: tuple[str, ...]
    formula: Callable[[Any], Any]
    needs: str = ""

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape at one instant."""
        return tuple(SIZES[axis] for axis in self.axes)

    def labelled(self, values: Any, *lead: str) -> record.Quantity:
        """The values with unit and meaning; `lead` are the axes before the component axes."""
        return record.Quantity(values, self.unit, self.meaning, (*lead, *self.axes))


def _scalar(entry: PathQuantity, formula: Callable[[Any], Any] | None = None) -> Channel:
    needs = VEHICLE if entry.needs_vehicle else ""
    return Channel(
        entry.variable, entry.unit, entry.meaning, (), formula or (lambda at: at.path_quantity(entry)), needs
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
        "force that moves the vehicle along the path, against inertia, gravity and drag, body axes",
        ("body",),
        lambda at: at.force,
        VEHICLE,
    ),
    Channel(
        "moment",
        "N m",
        "moment that turns the vehicle with the frame, body axes",
        ("body",),
        lambda at: at.moment,
        INERTIA,
    ),
    Channel(
        "defined",
        "1",
        "whether the frame exists; where it does not, its numbers are finite fallback values",
        (),
        lambda at: at.defined,
    ),
)

CHANNELS: dict[str, Channel] = {entry.name: entry for entry in _ENTRIES}
"""The outputs by name, in the order in which they are displayed."""
CHANNELS |= {x.variable: _scalar(x) for x in QUANTITIES.values() if x.variable not in CHANNELS}


def outputs_with(vehicle: Any) -> tuple[str, ...]:
    """The names of the outputs that can be evaluated with this vehicle, or without one for None."""
    has = {
        "",
        *(() if vehicle is None else (VEHICLE,)),
        *(() if getattr(vehicle, INERTIA, None) is None else (INERTIA,)),
    }
    return tuple(name for name, entry in CHANNELS.items() if entry.needs in has)
