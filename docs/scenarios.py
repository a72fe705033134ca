"""Write docs/scenarios.md, the reference of all keys of scenario files, from the models that read them.

Run it from the folder of the project:  .venv/bin/python docs/scenarios.py
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from qtraj.scenario import KINDS

FIRST = ("name", "description", "angles")
"""Keys of the whole scenario, wherever a model has them."""

LAST = {"ProgramPart": ("sequence",)}
"""Tables of models that refer to the tables before them."""

PAGE = Path(__file__).with_suffix(".md")

COMMANDS: dict[str, type[BaseModel]] = {kind.title: kind.model for kind in KINDS.values()}
"""The heading of each chapter, and the model of its scenario."""

INTRODUCTION = """# Scenarios

A scenario is a TOML file with the input of a command. This page lists all keys. A key is required if its default is
"required". A dash means that the key has no default, or that the second column explains the default. Unknown keys and
values of the wrong type are errors. The error message names the key and the expected value. File names are relative to
the folder of the scenario. Numbers are in SI units, with one exception: in scenarios of `qtraj slew` and
`qtraj simulate` the key `angles` sets the unit of all angles, including the angles in rates and accelerations. The
folder `examples` contains complete scenarios. The folder `src/qtraj/io/data` contains the built-in scenarios, which the
commands run if no scenario is given. Until version 1.0, the old keys `[program.turn]` for `[program.slew]` and
`error.gauge` for `error.normalization` are accepted, with a warning.

`docs/scenarios.py` generates this page from the models that read the files. So change the models, not this page.
"""


EXAMPLES = {
    "SlewScenario": """axis = [0.0, 0.0, 1.0]         # two turns and 30° about the z axis
angle = 30.0
turns = 2""",
    "NextPart": """[[program.sequence]]
[program.sequence.slew]        # from rest to 6°/s
start = {quaternion = [1.0, 0.0, 0.0, 0.0]}
axis = [0.0, 0.0, 1.0]
angle = 9.0
law = {max_acceleration = 2.0, end_rate = 6.0}

[[program.sequence]]
spin = {rate = [0.0, 0.0, 6.0], duration = 20.0}

[[program.sequence]]
[program.sequence.slew]        # to rest
axis = [0.0, 0.0, 1.0]
angle = 9.0
law = {max_acceleration = 2.0, start_rate = 6.0}""",
    "HysteresisPart": """[law.hysteresis]
half_width = 0.25              # the sign changes at an error of 209°
sampling = 0.1                 # [s]""",
    "RigidBodyPart": """[body]
inertia = [12.0, 15.0, 9.0]    # [kg m²]
assumed = [11.0, 15.0, 10.0]   # the law is designed for another inertia
max_torque = 2.0               # [N m]""",
    "WheelsPart": """[body]
inertia = [12.0, 15.0, 9.0]    # [kg m²]

[body.wheels]                  # a pyramid of four wheels
axes = [[1, 0, 1], [0, 1, 1], [-1, 0, 1], [0, -1, 1]]
max_torque = 0.5               # [N m]
max_momentum = 20.0            # [N m s]
momentum = [1.0, 1.0, 1.0, 1.0]""",
    "DisturbancePart": """[disturbance]
torque = [0.005, 0.0, -0.003]  # [N m], constant
inertia = [12.0, 15.0, 9.0]    # [kg m²]""",
    "GravityPart": """[body]
inertia = [12.0, 15.0, 9.0]    # [kg m²]

[disturbance.orbit]
radius = 7e6                   # [m]

[disturbance.gravity_gradient] # at the position on the orbit""",
    "MagneticPart": """[disturbance]
inertia = [12.0, 15.0, 9.0]    # [kg m²]

[disturbance.magnetic]
dipole = [0.0, 0.0, 5.0]       # [A m²], body axes
field = [3e-5, 0.0, 0.0]       # [T], inertial axes""",
    "AirPart": """[disturbance]
inertia = [12.0, 15.0, 9.0]    # [kg m²]

[disturbance.aerodynamic]
centre = [0.1, 0.0, 0.0]       # [m]
area = 2.0                     # [m²]
density = 1e-11                # [kg/m³]
velocity = [0.0, 7500.0, 0.0]  # [m/s]; or [disturbance.orbit]""",
    "SensorPart": """[sensor]
kind = "gyros"
sampling = 0.1                 # [s]
rate_bias = [0.005, 0.0, 0.0]  # [°/s]
rate_noise = 0.01              # [°/s]
seed = 1""",
    "ActuatorPart": """[actuator]
limit = [3.0, 3.0, 2.0]        # [°/s²]
saturation = "axis"
time_constant = 0.2            # [s]""",
}
"""Examples of tables by the name of their model; angles are in degrees."""


class Table(NamedTuple):
    """A table of a scenario: its possible headers, and its model."""

    headers: tuple[str, ...]
    model: type[BaseModel]


def page() -> str:
    """The whole page."""
    parts = [INTRODUCTION]
    known: dict[type[BaseModel], str] = {}
    for heading, model in COMMANDS.items():
        parts += [f"## {heading}\n", *_about(model), _keys(model), *_example(model)]
        for table in _tables(model):
            title = ", ".join(f"`{header}`" for header in table.headers)
            parts.append(f"### {title}\n")
            if table.model in known:
                parts.append(f"Same keys as {known[table.model]} above.\n")
                continue
            known[table.model] = f"{title} of {heading}"
            parts += [*_about(table.model), _keys(table.model), *_example(table.model)]
    return "\n".join(parts)


def _about(model: type[BaseModel]) -> list[str]:
    """The paragraphs of a model's docstring."""
    lines = [line.strip() for line in (model.__doc__ or "").strip().splitlines()]
    return [f"{paragraph}\n" for paragraph in " ".join(line or "\n" for line in lines).split(" \n ")]


def _example(model: type[BaseModel]) -> list[str]:
    """The example of a table, if it has one."""
    example = EXAMPLES.get(model.__name__)
    return [] if example is None else [f"```toml\n{example}\n```\n"]


def _tables(model: type[BaseModel], under: str = "") -> Iterator[Table]:
    """The tables below a model, neighbours of one kind together, each followed by its own."""
    found: dict[type[BaseModel], list[str]] = {}
    for name, field in _fields(model):
        if (inner := _inner(field.annotation)) is not None:
            bare = f"{under}{name}"
            found.setdefault(inner, []).append(f"[[{bare}]]" if get_origin(field.annotation) is list else f"[{bare}]")
    for inner, headers in found.items():
        yield Table(tuple(headers), inner)
        if len(headers) == 1:
            yield from _tables(inner, f"{headers[0].strip('[]')}.")


def _fields(model: type[BaseModel]) -> list[tuple[str, FieldInfo]]:
    """The keys of a table by name: name, description and angles first, and keys shared with other tables last."""
    own = model.__annotations__
    last = LAST.get(model.__name__, ())
    return sorted(
        model.model_fields.items(), key=lambda item: (item[0] not in FIRST, item[0] in last, item[0] not in own)
    )


def _inner(annotation: Any) -> type[BaseModel] | None:
    """The model of the table under a key; None for a plain value."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next(filter(None, map(_inner, get_args(annotation))), None)


def _keys(model: type[BaseModel]) -> str:
    rows = ["| key | meaning | value | default |", "|---|---|---|---|"]
    for name, field in _fields(model):
        cells = (f"`{name}`", _cell(field.title), _cell(field.description), _default(field))
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join(rows) + "\n"


def _cell(text: str | None) -> str:
    return (text or "").replace("|", "\\|").replace("] [", "] \\[")  # the second bracket is a unit, no link


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True)
    if value is None or value == [] or value == {} or isinstance(value, BaseModel):
        return "–"
    return f"`{json.dumps(value)}`"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
