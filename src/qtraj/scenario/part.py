"""Types of the keys of scenario files, and attitudes.

The `title` of a key is its meaning. Its `description` states the valid values and completes "expected …" in error
messages. docs/scenarios.md contains both.
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
    """The form of a range; invalid values are validated as a pair."""
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
"""Ranges by name: [low, high], or only {min = low} or {max = high}."""

SECONDS = "a positive finite number [s]"
THREE = "three finite numbers [x, y, z]"
ANGLES = "'deg' or 'rad': the unit of every angle in this file, including those in rates and accelerations"
FORMS = ("quaternion", "euler", "rotation_vector", "gibbs")
SEQUENCE = "three axes, fixed such as 'xyz' or moving such as 'ZYX', no axis twice in succession"
LONGER = 1e-9
"""Relative tolerance by which a rotation vector may exceed a half turn."""


def key(title: str, description: str, *default: Any) -> Any:
    """A key of a table: its meaning, its valid values, and its default; without a default it is required."""
    return Field(*default, title=title, description=description)


def is_number(x: Any) -> bool:
    """Whether a value of a TOML file is a finite number within the range of a float."""
    return isinstance(x, int | float) and not isinstance(x, bool) and abs(x) <= sys.float_info.max


class Part(BaseModel):
    """A table of a scenario file; unknown keys, wrong types and infinite numbers are rejected."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    def given(self, *names: str) -> list[str]:
        """The names of the keys that are set."""
        return [name for name in names if getattr(self, name) is not None]


class NamedPart(Part):
    """Name and description of a scenario."""

    name: Text | None = key("name, for titles", "a string", None)
    description: Text | None = key("description, for the output", "a string", None)


class AttitudePart(Part):
    """An attitude, body to inertial, in one of four forms: quaternion, euler with sequence, rotation_vector, gibbs."""

    quaternion: Quaternion | None = key(
        "quaternion; its norm is ignored", "four finite numbers, scalar first, not all zero", None
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
            raise ValueError(f"there are several attitudes ({', '.join(forms)}): give one of {', '.join(FORMS)}")
        if (self.euler is None) != (self.sequence is None):
            raise ValueError(
                f"euler and sequence must be given together: euler is three angles, sequence is {SEQUENCE}"
            )
        if self.sequence is not None:
            rotation.from_euler(self.sequence, jnp.zeros(3))  # raises for an unknown sequence
        if self.quaternion is not None and not any(self.quaternion):
            raise ValueError("the quaternion is zero, which does not represent an attitude")
        return self

    def unit_quaternion(self, angles: str) -> Quat | None:
        """The attitude as a unit quaternion, with the sign of the key `quaternion`; None if no form is given.

        `angles`: "deg" or "rad".
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
        """The length [rad] of a rotation vector that is longer than a half turn; else None."""
        if self.rotation_vector is None:
            return None
        length = radians(angles) * math.hypot(*self.rotation_vector)
        return length if length > math.pi * (1 + LONGER) else None


class KnownAttitudePart(AttitudePart):
    """An attitude, body to inertial, in one of four forms: quaternion, euler with sequence, rotation_vector, gibbs."""

    @model_validator(mode="after")
    def _required(self) -> "KnownAttitudePart":
        if not self.given(*FORMS):
            raise ValueError(f"there is no attitude: give one of {', '.join(FORMS)}")
        return self

    def attitude(self, angles: str) -> np.ndarray:
        """The unit quaternion (4,)."""
        return np.asarray(self.unit_quaternion(angles))


def radians(angles: str) -> float:
    """The factor from the unit `angles`, "deg" or "rad", to radians."""
    return math.pi / 180 if angles == "deg" else 1.0


def _unit(components: Sequence[float]) -> Quat:
    """The unit quaternion of components whose squares may overflow or underflow."""
    largest = max(map(abs, components))
    q = np.array([x / largest for x in components])
    return jnp.asarray(q / np.linalg.norm(q), float)
