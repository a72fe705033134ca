"""The abstract motion: which boundary velocities are variables, and how the angle runs between the ends."""

import abc
from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from qtraj.foundation.types import Scalar, Vec3
from qtraj.path.boundary import Cylindrical

COMPONENTS = ("V_rho", "V_phi", "V_h")
ENDS = ("start", "end")
VELOCITIES = tuple(f"{end}.{component}" for end in ENDS for component in COMPONENTS)


HEADINGS = tuple(f"{end}.heading" for end in ENDS)
"""What may be fixed besides the variables: the direction of the horizontal velocity."""


class AbstractMotion(eqx.Module):
    """A family of paths between two boundary states.

    `velocities` names the variables among the cylindrical velocity components; the logarithm of the duration is one
    more variable, unless the objective holds it. `is_uniform` says whether the angle turns at one rate. ρ, φ and h are
    the cubics of their values and velocities at the ends; the velocities are linear in the changes, and what else they
    consist of is in inverse proportion to the duration or does not depend on it.
    """

    name: ClassVar[str]
    velocities: ClassVar[tuple[str, ...]]
    is_uniform: ClassVar[bool]

    @abc.abstractmethod
    def boundary_velocities(
        self, a: Cylindrical, b: Cylindrical, changes: Float[Array, " n"], turn: Scalar, duration: Scalar
    ) -> tuple[Vec3, Vec3]:
        """The cylindrical velocities [m/s] at both ends, given the changes [m/s] of those named in `velocities`."""

    @abc.abstractmethod
    def duration(self, a: Cylindrical, b: Cylindrical, turn: Scalar) -> Scalar:
        """The duration [s] that the initial states suggest for this turn [rad]."""
