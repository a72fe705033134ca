"""Define the types of the keys of scenario files, and the tables of attitudes.

The `title` of a key says what the key means. The `description` of a key says which values are valid, and completes
"expected …" in error messages; it is part of a type or is specified for one key. docs/scenarios.md contains both.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Annotated, Any, Literal, Self, get_args, get_origin

import jax.numpy as jnp
import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator
from pydantic.fields import FieldInfo

from qtraj.algebra import rotation
from qtraj.algebra.euler import parse
from qtraj.algebra.inertia import inertia_matrix
from qtraj.design.tuning.choices import either
from qtraj.foundation.types import Quat
from qtraj.path.boundary_problem import MAX_TURNS


def _form(value: Any) -> str:
    """Return "open" for a range with the keys min or max, and "pair" for other values, which are validated as pairs."""
    return "open" if isinstance(value, dict) and value and value.keys() <= {"min", "max"} else "pair"


def checked_by(check: Callable[[Any], object]) -> AfterValidator:
    """Return a validator that rejects a value if `check` raises a ValueError for this value."""

    def checked(value: Any) -> Any:
        check(value)
        return value

    return AfterValidator(checked)


def one_of(names: Iterable[str]) -> Any:
    """Return the constraint of a string type whose values are `names`; a hyphen in a name may be an underscore."""
    names = tuple(names)
    return Field(pattern=f"^({'|'.join(names).replace('-', '[-_]')})$", description=either(names))


def with_hyphens(name: str) -> str:
    """Replace the underscores in a name by hyphens."""
    return name.replace("_", "-")


THREE = "three finite numbers [x, y, z]"

Number = Annotated[float, Field(allow_inf_nan=False, description="a finite number")]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False, description="a positive finite number")]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False, description="a finite number, 0 or more")]
Seconds = Annotated[Positive, Field(description="a positive finite number [s]")]
Metres = Annotated[Positive, Field(description="a positive finite number [m]")]
Speed = Annotated[NotNegative, Field(description="a finite number, 0 or more [m/s]")]
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]
PositivePair = Annotated[list[Positive], Field(min_length=2, max_length=2)]
OpenPair = Annotated[dict[Literal["min", "max"], Number], Field(min_length=1)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3, description=THREE)]
PositiveVector = Annotated[list[Positive], Field(min_length=3, max_length=3)]
Rows = Annotated[list[Vector], Field(min_length=3, max_length=3)]
Quaternion = Annotated[list[Number], Field(min_length=4, max_length=4)]
Wholes = Annotated[int, Field(ge=0, description="an integer, 0 or more")]
Turns = Annotated[
    int,
    Field(ge=-MAX_TURNS, le=MAX_TURNS, description=f"an integer from -{MAX_TURNS} to {MAX_TURNS}, without a point"),
]
Counts = Annotated[int, Field(ge=1, description="an integer, 1 or more")]
Inertia = Annotated[
    Positive | PositiveVector | Rows,
    checked_by(inertia_matrix),
    Field(description="one or three positive finite numbers, or three rows of three finite numbers [kg m²]"),
]
Text = Annotated[str, Field(min_length=1, description="a string")]
Angles = Literal["deg", "rad"]

Range = Annotated[Annotated[Pair, Tag("pair")] | Annotated[OpenPair, Tag("open")], Discriminator(_form)]
"""A range of the form [low, high], {min = low}, {max = high} or {min = low, max = high}."""

RangeMap = dict[str, Range]
"""Ranges by name, each of the form [low, high], {min = low}, {max = high} or {min = low, max = high}."""

ANGLES = "'deg' or 'rad': the unit of every angle in this file, including those in rates and accelerations"
FORMS = ("quaternion", "euler", "rotation_vector", "gibbs", "mrp")
SEQUENCE = "three axes, none twice in a row: fixed axes in lower case ('xyz') or moving axes in upper case ('ZYX')"
LONGER = 1e-9
"""Relative tolerance by which a rotation vector may exceed half a turn."""


def key(title: str, *default: Any, values: str | None = None, unit: str = "") -> Any:
    """Return a key of a table with the meaning `title`, a `default`, and the description `values` of valid values.

    A key without a default is required. By default, `values` is the description of the type. The `unit` is appended.
    """
    more: dict[str, Any] = {} if values is None else {"description": values}
    return Field(*default, title=title, json_schema_extra={"unit": f" [{unit}]" if unit else ""}, **more)


def described(annotation: Any, name: str) -> str | None:
    """Return the description of the valid values of a type, for a key with this name; None for an unknown type."""
    if isinstance(annotation, FieldInfo):
        return annotation.description
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return f"a table [{name}]"
    parts = get_args(annotation)
    if get_origin(annotation) is Literal:
        return either(parts)
    outer = parts[1:] if get_origin(annotation) is Annotated else parts
    return next((text for part in reversed(outer) if (text := described(part, name))), None)


class Part(BaseModel):
    """A table of a scenario file; unknown keys and values of the wrong type are rejected."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        """Describe the keys by their types and units, unless they have a description."""
        for name, field in cls.model_fields.items():
            extra: Any = field.json_schema_extra
            text = field.description or described(field.annotation, name) or ""
            field.description = text.removesuffix(extra["unit"]) + extra["unit"]  # inherited keys already have a unit

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        """Raise a ValueError with the first of the `_faults` of this table."""
        for fault in self._faults():
            raise ValueError(fault)
        return self

    def _faults(self) -> Iterator[str]:
        """Yield a message for each combination of keys that is not valid."""
        yield from ()

    def given(self, *names: str) -> list[str]:
        """Return the names of the keys that are set."""
        return [name for name in names if getattr(self, name) is not None]


class NamedPart(Part):
    """A table with the name and the description of a scenario."""

    name: Text | None = key("the name of the scenario, used in titles", None)
    description: Text | None = key("a description, which the commands print", None)


class AttitudePart(Part):
    """An attitude, body to inertial, as quaternion, euler with sequence, rotation_vector, gibbs or mrp."""

    quaternion: Quaternion | None = key(
        "quaternion of any norm except 0", None, values="four finite numbers, scalar first, not all zero"
    )
    euler: Vector | None = key("Euler angles [angle]", None, values="three finite angles in the order of 'sequence'")
    sequence: Text | None = key("axes of the Euler angles", None, values=SEQUENCE)
    rotation_vector: Vector | None = key(
        "rotation vector [angle]", None, values=f"{THREE}: the angle of the rotation times its unit axis"
    )
    gibbs: Vector | None = key("Gibbs vector", None, values=f"{THREE}: tan(angle/2) times the unit axis, dimensionless")
    mrp: Vector | None = key(
        "modified Rodrigues parameters",
        None,
        values=f"{THREE}: tan(angle/4) times the unit axis, dimensionless; a norm above 1 is the longer rotation",
    )

    def _faults(self) -> Iterator[str]:
        forms = self.given(*FORMS)
        if len(forms) > 1:
            yield (
                f"the attitude is specified in several forms ({', '.join(forms)}): specify one of {', '.join(FORMS)}"
            )
        if (self.euler is None) != (self.sequence is None):
            yield f"euler and sequence must be specified together: euler is three angles, sequence is {SEQUENCE}"
        if self.sequence is not None:
            parse(self.sequence)  # raises for an unknown sequence
        if self.quaternion is not None and not any(self.quaternion):
            yield "the quaternion is zero, which does not represent an attitude"

    def unit_quaternion(self, angles: str) -> Quat | None:
        """Return the attitude as a unit quaternion, or None if no form is specified; `angles` is "deg" or "rad".

        The sign of the key `quaternion` is not changed.
        """
        scale = radians(angles)
        if self.quaternion is not None:
            return _unit(self.quaternion)
        if self.euler is not None and self.sequence is not None:
            return rotation.from_euler(self.sequence, scale * jnp.asarray(self.euler, float))
        if self.rotation_vector is not None:
            return rotation.from_rotation_vector(scale * jnp.asarray(self.rotation_vector, float))
        if self.mrp is not None:
            return rotation.from_mrp(jnp.asarray(self.mrp, float))
        return None if self.gibbs is None else _unit([1.0, *self.gibbs])

    def beyond_half_turn(self, angles: str) -> float | None:
        """Return the angle [rad] of the rotation vector, or the largest Euler angle, if more than half a turn.

        Otherwise return None.
        """
        if self.rotation_vector is None and self.euler is None:
            return None
        size = (
            math.hypot(*self.rotation_vector) if self.rotation_vector is not None else max(map(abs, self.euler or ()))
        )
        length = radians(angles) * size
        return length if length > math.pi * (1 + LONGER) else None


class KnownAttitudePart(AttitudePart):
    """An attitude, body to inertial, as quaternion, euler with sequence, rotation_vector, gibbs or mrp."""

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        if not self.given(*FORMS):
            yield f"there is no attitude: specify one of {', '.join(FORMS)}"

    def attitude(self, angles: str) -> np.ndarray:
        """Return the attitude as a unit quaternion (4,); `angles` is "deg" or "rad"."""
        return np.asarray(self.unit_quaternion(angles))


def radians(angles: str) -> float:
    """Return the factor from the unit `angles`, "deg" or "rad", to radians."""
    return math.pi / 180 if angles == "deg" else 1.0


def _unit(components: Sequence[float]) -> Quat:
    """Normalise four components, even if their squares overflow or underflow."""
    largest = max(map(abs, components))
    q = np.array([x / largest for x in components])
    return jnp.asarray(q / np.linalg.norm(q), float)
