"""Attitudes in a scenario file: a quaternion, Euler angles, a rotation vector or a Gibbs vector."""

import math
from typing import TypeVar

import jax.numpy as jnp
from pydantic import Field, model_validator

from qtraj.algebra import rotation
from qtraj.foundation.types import Quat
from qtraj.io.scenario_part import THREE, Part, Quaternion, Text, Vector, given

FORMS = ("quaternion", "euler", "rotation_vector", "gibbs")
SEQUENCE = "three axes, fixed such as 'xyz' or moving such as 'ZYX', none twice in a row"

A = TypeVar("A", bound="AttitudePart")


class AttitudePart(Part):
    """An attitude, body to inertial, in one of four forms; angles are in the file's unit."""

    quaternion: Quaternion | None = Field(
        default=None, description="four finite numbers, scalar first, of any length but 0"
    )
    euler: Vector | None = Field(default=None, description="three finite angles in the order of 'sequence'")
    sequence: Text | None = Field(default=None, description=SEQUENCE)
    rotation_vector: Vector | None = Field(
        default=None, description=f"{THREE}: the angle of the turn times its unit axis"
    )
    gibbs: Vector | None = Field(default=None, description=f"{THREE}: tan(angle/2) times the unit axis, without unit")

    @model_validator(mode="after")
    def _belonging(self: A) -> A:
        forms = given(self, *FORMS)
        if len(forms) > 1:
            raise ValueError(f"there are several attitudes ({', '.join(forms)}): give one of {', '.join(FORMS)}")
        if (self.euler is None) != (self.sequence is None):
            raise ValueError(f"euler and sequence belong together: give three angles, and as sequence {SEQUENCE}")
        if self.quaternion is not None and not any(self.quaternion):
            raise ValueError("the quaternion is zero, which is no attitude")
        return self

    def unit_quaternion(self, angles: str) -> Quat | None:
        """The attitude; its quaternion keeps the sign that it was given. None where no form is given.

        `angles`: "deg" or "rad".

        **Raises:** ValueError for an Euler sequence that is none.
        """
        scale = radians(angles)
        if self.quaternion is not None:
            q = jnp.asarray(self.quaternion, float)
            return q / jnp.linalg.norm(q)
        if self.euler is not None and self.sequence is not None:
            return rotation.from_euler(self.sequence, scale * jnp.asarray(self.euler, float))
        if self.rotation_vector is not None:
            return rotation.from_rotation_vector(scale * jnp.asarray(self.rotation_vector, float))
        return None if self.gibbs is None else rotation.from_gibbs(jnp.asarray(self.gibbs, float))


class KnownAttitudePart(AttitudePart):
    """An attitude that must be there."""

    @model_validator(mode="after")
    def _there(self) -> "KnownAttitudePart":
        if not given(self, *FORMS):
            raise ValueError(f"there is no attitude: give one of {', '.join(FORMS)}")
        return self


def radians(angles: str) -> float:
    """What turns numbers in the unit `angles`, "deg" or "rad", into radians."""
    return math.pi / 180 if angles == "deg" else 1.0
