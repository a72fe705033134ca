"""The objectives by their names."""

from collections.abc import Callable
from typing import Any

from typing_extensions import TypeAliasType

from qtraj.design.tuning import choices
from qtraj.design.tuning.objectives.custom import Custom
from qtraj.design.tuning.objectives.objective import AbstractObjective

OBJECTIVES: dict[str, AbstractObjective] = choices.instances("objectives", choices.OBJECTIVES)

Objective = TypeAliasType("Objective", str | AbstractObjective | Callable[..., Any])


def objective_of(given: Objective) -> AbstractObjective:
    """The objective of this name, the objective itself, or that of a function of a path.

    **Raises:** ValueError for an unknown name.
    """
    if isinstance(given, AbstractObjective):
        return given
    if callable(given):
        return Custom(given)
    if given not in OBJECTIVES:
        raise ValueError(
            f"objective must be one of {', '.join(map(repr, OBJECTIVES))} or a callable of a path, but {given!r} was "
            "given"
        )
    return OBJECTIVES[given]
