"""What a problem must provide to `nonconvex`: minimise an objective f(z) under the constraints g(z) ≤ margins.

The structure of its matrices does not matter to the method: a problem solves its own linear systems, for example with a
`chain.Chain`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from jaxtyping import Float

Variables = Float[np.ndarray, "groups size"]
"""The variables z: one row for each group, for example the state of a joint of a route."""

PerConstraint = Float[np.ndarray, " m"]
"""One number for each constraint."""

Shift = float | Float[np.ndarray, " groups"]
"""What is added to the diagonal entries of the variables: one number, or one for each group."""

Solver = Callable[[Variables], Variables]
"""Returns the solution of a linear system with a factorised matrix."""


class Program(Protocol):
    """A problem with constraints values(z) ≤ margins.

    `price` contains the prices of violations of the constraints, infinite for those that must hold; None if all must.
    """

    price: Any

    @property
    def full(self) -> PerConstraint:
        """The margins without any reduction."""
        ...

    def evaluate(self, z: Variables) -> tuple[float, PerConstraint]:
        """Return the objective and the values of the constraints."""
        ...

    def linearise(self, z: Variables, multipliers: PerConstraint, stiffness: PerConstraint) -> Linear:
        """Return values and derivatives; the matrix is ∇²(f + Σ multiplier·g) + Σ stiffness·∇g ∇gᵀ."""
        ...

    def refreshed(self, z: Variables, previous: PerConstraint) -> PerConstraint:
        """Return margins that account for what the constraints do not see at `z`, such as values between nodes."""
        ...


class Linear(Protocol):
    """The values and derivatives of a program at one point.

    `gradient` is the gradient of the `objective`, and `residual` the gradient of the Lagrangian.
    """

    values: PerConstraint
    objective: float
    gradient: Variables
    residual: Variables
    matrix: Any

    @property
    def program(self) -> Program:
        """The program."""
        ...

    def pulled(self, weights: PerConstraint) -> Variables:
        """Return the gradient of a weighted sum of the constraints."""
        ...

    def pushed(self, dz: Variables) -> PerConstraint:
        """Return the changes of the linearised constraints for a change of the variables."""
        ...

    def solver(self, shift: Shift = 0.0, indefinite: bool = False) -> Solver | None:
        """Return a function that solves systems with the matrix, or None if the matrix is not positive definite.

        `shift`, one number or one for each group, is added to the diagonal entries of free variables. With
        `indefinite`, the result is None only for a singular matrix.
        """
        ...

    def indefinite_group(self, shift: Shift) -> int | None:
        """Return the group where the factorisation of the shifted matrix fails; None if it is positive definite."""
        ...

    def completed(self, dz: Variables) -> Variables:
        """Return a solution with the variables that repeat others."""
        ...
