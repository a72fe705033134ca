"""Define an attitude with its rate and acceleration, and the base class of programs, which are attitudes over time."""

import abc
import os

import equinox as eqx
import numpy as np

from qtraj.algebra.quaternion import conjugate, rotate
from qtraj.foundation import document
from qtraj.foundation.argument import require_type
from qtraj.foundation.namespace import as_floats
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, batch_prefix, extent, vector_text
from qtraj.foundation.shown import shown_html
from qtraj.foundation.types import Quat, Scalar, ScalarLike, Vec3
from qtraj.path.rate_axes import BODY, INERTIAL, require_axes


class Attitude(AbstractResult):
    """The attitude, angular rate and angular acceleration at one instant.

    `quaternion` (4,), scalar first, transforms from body to inertial axes. `rate` (3,) [rad/s] and `acceleration` (3,)
    [rad/s²] are in `axes`, "body" (the default) or "inertial". Feedback laws and `dynamics.torque` accept only body
    axes. The quaternion of a program has norm 1; the quaternion of a simulated body need not be normalised.
    """

    quaternion: Quat = eqx.field(converter=as_floats)
    rate: Vec3 = eqx.field(converter=as_floats)
    acceleration: Vec3 = eqx.field(converter=as_floats)
    axes: str = eqx.field(static=True, default=BODY)

    def in_axes(self, axes: str) -> "Attitude":
        """Return the same attitude with rate and acceleration in `axes`, "body" or "inertial".

        With the quaternion λ, and the components ω_x and ε_x of rate and acceleration in body axes, the components in
        inertial axes are ω_ξ = λ∘ω_x∘λ⁻¹ and ε_ξ = λ∘ε_x∘λ⁻¹.
        The attitude must not be batched: use `jax.vmap` for a batch.

        **Raises:** ValueError if `axes` is neither "body" nor "inertial".
        """
        require_axes(axes)
        if axes == self.axes:
            return self
        turn = self.quaternion if axes == INERTIAL else conjugate(self.quaternion)
        return Attitude(self.quaternion, rotate(turn, self.rate), rotate(turn, self.acceleration), axes)

    def record(self) -> Record:
        """Return the fields with units; for a batch, such as a result of `jax.vmap(program)`, batch axes come first."""
        along = ("body",) if self.axes == BODY else ("world",)
        variables = {
            "quaternion": Quantity(self.quaternion, "1", "attitude, scalar first, body to inertial", ("component",)),
            "rate": Quantity(self.rate, "rad s-1", f"angular rate, {self.axes} axes", along),
            "acceleration": Quantity(self.acceleration, "rad s-2", f"angular acceleration, {self.axes} axes", along),
        }
        rates, accelerations = (np.linalg.norm(np.asarray(x), axis=-1) for x in (self.rate, self.acceleration))
        shown = f"|rate| {extent(rates, 'rad s-1')}, |acceleration| {extent(accelerations, 'rad s-2')}"
        first = "" if self.quaternion.ndim > 1 else f"quaternion {vector_text(self.quaternion)}, "
        return Record(
            f"{batch_prefix(self.quaternion.shape[:-1])}{first}{shown}", variables, attributes={"frame": self.axes}
        )


def require_body_axes(attitude: Attitude) -> None:
    """Raise a ValueError if rate and acceleration are in inertial axes."""
    if attitude.axes != BODY:
        raise ValueError(
            "rate and acceleration of the attitude must be in body axes, but they are in inertial axes: "
            "pass attitude.in_axes('body')"
        )


class AbstractProgram(eqx.Module):
    """An attitude program: quaternion λ⁰(t), rate ω⁰(t) and acceleration ε⁰(t) on [0, duration] (paper C, (1.5)).

    The time t [s] is measured from the start of the program.
    """

    duration: eqx.AbstractVar[Scalar]

    @abc.abstractmethod
    def __call__(self, t: ScalarLike) -> Attitude:
        """Return the program's attitude at time `t` [s]; its quaternion is continuous on [0, duration]."""

    def at(self, t: ScalarLike, axes: str = BODY) -> Attitude:
        """Return the program's attitude at time `t` [s], with rate and acceleration in `axes` (paper C, (1.6)).

        **Raises:** ValueError if `axes` is neither "body" nor "inertial".
        """
        return self(t).in_axes(axes)

    def prepared(self) -> "AbstractProgram":
        """Return an equal program in which everything that does not depend on the time is already computed.

        Simulations call it once before the integration. The default is the program itself.
        """
        return self

    _repr_html_ = shown_html

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the program without loss of precision to a TOML or JSON file, which `qtraj.load` reads.

        **Raises:** ValueError for a suffix other than .toml or .json, or for a program that contains a user's function.
        """
        document.save(self, file)


def require_program(program: AbstractProgram) -> None:
    """Raise a ValueError if the argument `program` is not an attitude program."""
    require_type(program, AbstractProgram, "program", "a program, such as a FrameProgram or an EulerTurn")
