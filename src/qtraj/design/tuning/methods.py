"""The methods of tuning by what names them: "sqp", "lbfgs", or an optimiser of optax."""

from functools import lru_cache
from typing import Any

from qtraj.design.tuning.augmented import AugmentedLagrangian
from qtraj.design.tuning.search import AbstractSearch
from qtraj.design.tuning.sqp import SequentialQuadratic

METHODS = ("sqp", "lbfgs")

MEMORY = 12
"""Steps that "lbfgs" remembers."""

Method = Any
"""One of `METHODS`, or an `optax.GradientTransformation`, with extra arguments or without."""


def method_of(given: Method | None, smooth: bool, max_steps: int, inner_steps: int) -> AbstractSearch:
    """The search that a method means; without one "sqp", or "lbfgs" for an objective that may not be smooth.

    **Raises:** ValueError for what is no method, and for steps that are no positive whole numbers.
    """
    for name, steps in (("max_steps", max_steps), ("inner_steps", inner_steps)):
        if isinstance(steps, bool) or int(steps) != steps or steps < 1:
            raise ValueError(f"{name} must be a whole number, 1 or more, but {steps} was given")
    if given is None:
        given = "sqp" if smooth else "lbfgs"
    if isinstance(given, str) and given == "sqp":
        return SequentialQuadratic(max_steps)
    return AugmentedLagrangian(_optimiser(given), max_steps, inner_steps)


def _optimiser(given: Method) -> Any:
    if isinstance(given, str) and given == "lbfgs":
        return _lbfgs()
    if isinstance(given, str) or not all(callable(getattr(given, name, None)) for name in ("init", "update")):
        raise ValueError(
            f"method must be {' or '.join(map(repr, METHODS))}, or an optimiser of optax such as optax.adam(1e-2), "
            f"but {given!r} was given"
        )
    import optax  # here, so that importing qtraj does not wait for it

    return optax.with_extra_args_support(given)


@lru_cache(maxsize=1)
def _lbfgs() -> Any:
    import optax

    return optax.with_extra_args_support(optax.lbfgs(memory_size=MEMORY))
