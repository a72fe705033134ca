"""The abstract objective, a scalar to minimise."""

import abc
from typing import Any, ClassVar

import equinox as eqx


class AbstractObjective(eqx.Module):
    """A scalar to minimise; each objective has its own unit.

    `fixes_duration` is true if the duration is not a variable. `needs_time_limit` is true if the problem needs a limit
    that bounds the speed. `is_formula` is true if `value` also takes jets, which give its derivatives; JAX computes the
    derivatives of all other objectives. The variables `z` are a sequence of numbers, arrays or jets, and the fields of
    the problem have the same batch axes.
    """

    name: ClassVar[str]
    fixes_duration: ClassVar[bool] = False
    needs_time_limit: ClassVar[bool] = False
    is_formula: ClassVar[bool] = True

    @abc.abstractmethod
    def value(self, problem: Any, z: Any) -> Any:
        """Return the value of the objective for the variables `z` of a `Problem`."""

    @abc.abstractmethod
    def scale(self, problem: Any) -> Any:
        """Return a typical magnitude of the objective; the search divides the objective by this value."""
