"""The abstract motion: which boundary velocities are variables, and how the angle depends on time."""

import abc
from collections.abc import Sequence
from typing import Any, ClassVar

import jax

from qtraj.path.boundary import Cylindrical

Velocities = tuple[tuple[Any, Any, Any], tuple[Any, Any, Any]]
"""The cylindrical components (V_ρ, V_φ, V_h) [m/s] at the start and at the end: numbers, arrays or jets."""

COMPONENTS = ("V_rho", "V_phi", "V_h")
ENDS = ("start", "end")
VELOCITIES = tuple(f"{end}.{component}" for end in ENDS for component in COMPONENTS)

HEADINGS = tuple(f"{end}.heading" for end in ENDS)
"""Names of the directions of the horizontal velocities at both ends; the directions can be fixed like variables."""


class AbstractMotion(abc.ABC):
    """A family of paths between two positions.

    `velocities` names the cylindrical velocity components that are variables. The logarithm of the duration is another
    variable, unless the objective fixes the duration. `is_uniform` is true if the angular rate is constant. ρ, φ and h
    are polynomials in time of degree 3 or less, determined by their values and velocities at the ends. The boundary
    velocities must be linear in the changes. The terms of the velocities that do not contain the changes must be
    constant or inversely proportional to the duration. Motions have no fields, and all objects of a class are equal.
    """

    name: ClassVar[str]
    velocities: ClassVar[tuple[str, ...]]
    is_uniform: ClassVar[bool]

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        jax.tree_util.register_static(cls)

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other)

    def __hash__(self) -> int:
        return hash(type(self))

    @abc.abstractmethod
    def boundary_velocities(
        self, a: Cylindrical, b: Cylindrical, changes: Sequence[Any], turn: Any, duration: Any
    ) -> Velocities:
        """Return the cylindrical velocities [m/s] at both ends, for changes [m/s] of the components in `velocities`."""

    @abc.abstractmethod
    def duration(self, a: Cylindrical, b: Cylindrical, turn: Any) -> Any:
        """Return the initial duration [s], from the angular rates of the initial states and the turn [rad]."""
