"""Define the types of the keys of scenario files, and the tables of attitudes.

The `title` of a key says what the key means. The `description` of a key says which values are valid, and completes
"expected …" in error messages. docs/scenarios.md contains both.
"""

import math
import sys
from collections.abc import Sequence
from typing import Annotated, Any, Literal, Self

import jax.numpy as jnp
import numpy as np
from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator

from qtraj.algebra import rotation
from qtraj.foundation.types import Quat


def _form(value: Any) -> str:
    """Return the form of a range, "open" or "pair"; other values count as a pair, so that validation reports them."""
    return "open" if isinstance(value, dict) and value and value.keys() <= {"min", "max"} else "pair"


Number = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]
OpenPair = Annotated[dict[Literal["min", "max"], Number], Field(min_length=1)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]
Quaternion = Annotated[list[Number], Field(min_length=4, max_length=4)]
Wholes = Annotated[int, Field(ge=0)]
Counts = Annotated[int, Field(ge=1)]
Text = Annotated[str, Field(min_length=1)]
Angles = Literal["deg", "rad"]

RangeMap = dict[str, Annotated[Annotated[Pair, Tag("pair")] | Annotated[OpenPair, Tag("open")], Discriminator(_form)]]
"""Ranges by name, each of the form [low, high], {min = low}, {max = high} or {min = low, max = high}."""

SECONDS = "a positive finite number [s]"
THREE = "three finite numbers [x, y, z]"
ANGLES = "'deg' or 'rad': the unit of every angle in this file, including those in rates and accelerations"
FORMS = ("quaternion", "euler", "rotation_vector", "gibbs")
SEQUENCE = "three axes, fixed such as 'xyz' or moving such as 'ZYX', with different successive axes"
LONGER = 1e-9
"""Relative tolerance by which a rotation vector may exceed half a turn."""


def key(title: str, description: str, *default: Any) -> Any:
    """Return a key of a table with the meaning `title`, the valid values `description`, and a `default`.

    A key without a default is required.
    """
    return Field(*default, title=title, description=description)


def is_number(x: Any) -> bool:
    """Return whether a value of a TOML file is a finite number within the range of a float."""
    return isinstance(x, int | float) and not isinstance(x, bool) and abs(x) <= sys.float_info.max


class Part(BaseModel):
    """A table of a scenario file; unknown keys and values of the wrong type are rejected."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    def given(self, *names: str) -> list[str]:
        """Return the names of the keys that are set."""
        return [name for name in names if getattr(self, name) is not None]


class NamedPart(Part):
    """A table with the name and the description of a scenario."""

    name: Text | None = key("the name of the scenario, used in titles", "a string", None)
    description: Text | None = key("a description, which the commands print", "a string", None)


class AttitudePart(Part):
    """An attitude, body to inertial, in one of four forms: quaternion, euler with sequence, rotation_vector, gibbs."""

    quaternion: Quaternion | None = key(
        "quaternion, which need not be normalised", "four finite numbers, scalar first, not all zero", None
    )
    euler: Vector | None = key("Euler angles [angle]", "three finite angles in the order of 'sequence'", None)
    sequence: Text | None = key("axes of the Euler angles", SEQUENCE, None)
    rotation_vector: Vector | None = key(
        "rotation vector [angle]", f"{THREE}: the angle of the rotation times its unit axis", None
    )
    gibbs: Vector | None = key("Gibbs vector", f"{THREE}: tan(angle/2) times the unit axis, dimensionless", None)

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        forms = self.given(*FORMS)
        if len(forms) > 1:
            raise ValueError(
                f"the attitude is specified in several forms ({', '.join(forms)}): specify one of {', '.join(FORMS)}"
            )
        if (self.euler is None) != (self.sequence is None):
            raise ValueError(
                f"euler and sequence must be specified together: euler is three angles, sequence is {SEQUENCE}"
            )
        if self.sequence is not None:
            rotation.from_euler(self.sequence, jnp.zeros(3))  # raises for an unknown sequence
        if self.quaternion is not None and not any(self.quaternion):
            raise ValueError("the quaternion is zero, which does not represent an attitude")
        return self

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
        return None if self.gibbs is None else _unit([1.0, *self.gibbs])

    def beyond_half_turn(self, angles: str) -> float | None:
        """Return the angle [rad] of the rotation vector if it is more than half a turn, otherwise None."""
        if self.rotation_vector is None:
            return None
        length = radians(angles) * math.hypot(*self.rotation_vector)
        return length if length > math.pi * (1 + LONGER) else None


class KnownAttitudePart(AttitudePart):
    """An attitude, body to inertial, in one of four forms: quaternion, euler with sequence, rotation_vector, gibbs."""

    @model_validator(mode="after")
    def _required(self) -> "KnownAttitudePart":
        if not self.given(*FORMS):
            raise ValueError(f"there is no attitude: specify one of {', '.join(FORMS)}")
        return self

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
