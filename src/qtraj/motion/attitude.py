"""Attitude with its first two derivatives, and the programs that give it as a function of time."""

import abc
import os

import equinox as eqx

from qtraj.foundation import document
from qtraj.foundation.types import Quat, Scalar, ScalarLike, Vec3


class Attitude(eqx.Module):
    """Where a body points at one instant, and how it turns.

    `quaternion` (4,), body to inertial, scalar first; `rate` (3,) [rad/s] and `acceleration` (3,) [rad/s²] in body
    axes. A program's quaternion is of unit length; a real body's may have any.
    """

    quaternion: Quat
    rate: Vec3
    acceleration: Vec3


class AbstractProgram(eqx.Module):
    """An attitude program λ⁰(t), ω⁰(t), ε⁰(t) on [0, duration] (paper C, (1.5)): t in seconds from its own start."""

    duration: eqx.AbstractVar[Scalar]

    @abc.abstractmethod
    def __call__(self, t: ScalarLike) -> Attitude:
        """The program's attitude at one instant; its quaternion is continuous in t on [0, duration]."""

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the program to a TOML or JSON file, exactly; `qtraj.load` reads it.

        **Raises:** ValueError for another suffix, or for a program that holds a function of the user's own.
        """
        document.save(self, file)
