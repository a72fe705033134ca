"""Attitudes in a scenario file: a quaternion, Euler angles, a rotation vector or a Gibbs vector."""

import math
from collections.abc import Sequence
from typing import TypeVar

import jax.numpy as jnp
import numpy as np
from pydantic import Field, model_validator

from qtraj.algebra import rotation
from qtraj.foundation.types import Quat
from qtraj.io.scenario_part import THREE, Part, Quaternion, Text, Vector, given

FORMS = ("quaternion", "euler", "rotation_vector", "gibbs")
SEQUENCE = "three axes, fixed such as 'xyz' or moving such as 'ZYX', none twice in a row"
LONGER = 1e-9
"""Relative: a rotation vector may be so much longer than a half turn."""

A = TypeVar("A", bound="AttitudePart")


class AttitudePart(Part):
    """An attitude, body to inertial, in one of four forms: quaternion, euler with sequence, rotation_vector, gibbs."""

    quaternion: Quaternion | None = Field(
        default=None, title="its direction counts", description="four finite numbers, scalar first, of any length but 0"
    )
    euler: Vector | None = Field(
        default=None, title="Euler angles [angle]", description="three finite angles in the order of 'sequence'"
    )
    sequence: Text | None = Field(default=None, title="axes of the Euler angles", description=SEQUENCE)
    rotation_vector: Vector | None = Field(
        default=None, title="rotation vector [angle]", description=f"{THREE}: the angle of the turn times its unit axis"
    )
    gibbs: Vector | None = Field(
        default=None,
        title="Gibbs vector",
        description=f"{THREE}: tan(angle/2) times the unit axis, without unit",
    )

    @model_validator(mode="after")
    def _belonging(self: A) -> A:
        forms = given(self, *FORMS)
        if len(forms) > 1:
            raise ValueError(f"there are several attitudes ({', '.join(forms)}): give one of {', '.join(FORMS)}")
        if (self.euler is None) != (self.sequence is None):
            raise ValueError(f"euler and sequence belong together: give three angles, and as sequence {SEQUENCE}")
        if self.sequence is not None:
            rotation.from_euler(self.sequence, jnp.zeros(3))  # its home knows which sequences there are
        if self.quaternion is not None and not any(self.quaternion):
            raise ValueError("the quaternion is zero, which is no attitude")
        return self

    def unit_quaternion(self, angles: str) -> Quat | None:
        """The attitude; its quaternion keeps the sign that it was given. None where no form is given.

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

    def excess_turn(self, angles: str) -> float | None:
        """The length [rad] of a rotation vector beyond a half turn, whose attitude a shorter one gives; else None."""
        if self.rotation_vector is None:
            return None
        length = radians(angles) * math.hypot(*self.rotation_vector)
        return length if length > math.pi * (1 + LONGER) else None


class KnownAttitudePart(AttitudePart):
    """An attitude, body to inertial, in one of four forms: quaternion, euler with sequence, rotation_vector, gibbs."""

    @model_validator(mode="after")
    def _there(self) -> "KnownAttitudePart":
        if not given(self, *FORMS):
            raise ValueError(f"there is no attitude: give one of {', '.join(FORMS)}")
        return self

    def attitude(self, angles: str) -> np.ndarray:
        """The unit quaternion (4,)."""
        return np.asarray(self.unit_quaternion(angles))


def radians(angles: str) -> float:
    """What turns numbers in the unit `angles`, "deg" or "rad", into radians."""
    return math.pi / 180 if angles == "deg" else 1.0


def _unit(components: Sequence[float]) -> Quat:
    """A quaternion of any length but 0 as one of length 1; the squares of its components need not be numbers."""
    largest = max(map(abs, components))
    q = np.array([x / largest for x in components])
    return jnp.asarray(q / np.linalg.norm(q), float)
