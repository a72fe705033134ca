"""Search methods by name: "sqp", "lbfgs", "adam", or an optax optimiser."""

from functools import lru_cache
from typing import Any

from qtraj.design.tuning.choices import either
from qtraj.design.tuning.first_order import FirstOrder
from qtraj.design.tuning.search import AbstractSearch
from qtraj.design.tuning.sqp import SequentialQuadratic

METHODS = ("sqp", "lbfgs", "adam")

MEMORY = 12
"""Number of past steps that "lbfgs" stores."""

LEARNING_RATE = 0.01
"""Default learning rate of "adam", in units of the reference speed."""

Method = Any
"""One of `METHODS`, or an `optax.GradientTransformation` (with or without extra arguments)."""


def get_method(method: Method, max_steps: int, inner_steps: int) -> AbstractSearch:
    """Return the search for a method.

    **Raises:** ValueError if the method is unknown, or if a step count is not a positive integer.
    """
    for name, steps in (("max_steps", max_steps), ("inner_steps", inner_steps)):
        if isinstance(steps, bool) or int(steps) != steps or steps < 1:
            raise ValueError(f"{name} must be an integer, 1 or more, but {steps} was given")
    sqp = SequentialQuadratic(int(max_steps))
    if isinstance(method, str) and method == "sqp":
        return sqp
    return FirstOrder(optimiser_of(method), int(inner_steps), sqp)


def optimiser_of(method: Method, default: str = METHODS[0]) -> Any:
    """Return the optax optimiser for a method; raise a ValueError for another one than `default`, which is none."""
    if isinstance(method, str) and method == "lbfgs":
        return _lbfgs()
    if isinstance(method, str) and method == "adam":
        return adam(LEARNING_RATE)
    if isinstance(method, str) or not all(callable(getattr(method, name, None)) for name in ("init", "update")):
        raise ValueError(
            f"method must be {either((default, *METHODS[1:]))}, or an optax optimiser such as optax.adam(1e-2), "
            f"but {method!r} was given"
        )
    import optax  # imported here, so that `import qtraj` does not import optax

    return optax.with_extra_args_support(method)


@lru_cache(maxsize=8)
def adam(learning_rate: float, /) -> Any:
    """Return `optax.adam`; equal learning rates give the same object, so that the compiled search is reused."""
    import optax

    return optax.with_extra_args_support(optax.adam(learning_rate))


@lru_cache(maxsize=1)
def _lbfgs() -> Any:
    import optax

    return optax.with_extra_args_support(optax.lbfgs(memory_size=MEMORY))
