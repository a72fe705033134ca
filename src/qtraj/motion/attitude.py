"""Attitude with its first two derivatives, and the abstract program: attitude as a function of time."""

import abc
import os

import equinox as eqx
import numpy as np

from qtraj.foundation import document
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, batch_prefix, extent, vector_text
from qtraj.foundation.types import Quat, Scalar, ScalarLike, Vec3


class Attitude(AbstractResult):
    """Attitude, angular rate and angular acceleration at one instant.

    `quaternion` (4,), body to inertial, scalar first; `rate` (3,) [rad/s] and `acceleration` (3,) [rad/s²] in body
    axes. A program's quaternion is a unit quaternion; that of a simulated body may have any length.
    """

    quaternion: Quat
    rate: Vec3
    acceleration: Vec3

    def record(self) -> Record:
        """The fields; a batch, as from `jax.vmap(program)(times)`, has its dimensions in front."""
        variables = {
            "quaternion": Quantity(self.quaternion, "1", "attitude, scalar first, body to inertial", ("component",)),
            "rate": Quantity(self.rate, "rad s-1", "angular rate, body axes", ("body",)),
            "acceleration": Quantity(self.acceleration, "rad s-2", "angular acceleration, body axes", ("body",)),
        }
        rates, accelerations = (np.linalg.norm(np.asarray(x), axis=-1) for x in (self.rate, self.acceleration))
        shown = f"|rate| {extent(rates, 'rad s-1')}, |acceleration| {extent(accelerations, 'rad s-2')}"
        first = "" if self.quaternion.ndim > 1 else f"quaternion {vector_text(self.quaternion)}, "
        return Record(
            f"{batch_prefix(self.quaternion.shape[:-1])}{first}{shown}", variables, attributes={"frame": "body"}
        )


class AbstractProgram(eqx.Module):
    """An attitude program λ⁰(t), ω⁰(t), ε⁰(t) on [0, duration] (paper C, (1.5)): t in seconds from its own start."""

    duration: eqx.AbstractVar[Scalar]

    @abc.abstractmethod
    def __call__(self, t: ScalarLike) -> Attitude:
        """The program's attitude at one instant; its quaternion is continuous in t on [0, duration]."""

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the program to a TOML or JSON file, exactly; `qtraj.load` reads it.

        **Raises:** ValueError for another suffix, or for a program that contains a user's function.
        """
        document.save(self, file)
