"""Objectives by name."""

from collections.abc import Callable
from typing import Any

from typing_extensions import TypeAliasType

from qtraj.design.tuning import choices
from qtraj.design.tuning.objectives.custom import Custom
from qtraj.design.tuning.objectives.objective import AbstractObjective

OBJECTIVES: dict[str, AbstractObjective] = choices.instances("objectives", choices.OBJECTIVES)

Objective = TypeAliasType("Objective", str | AbstractObjective | Callable[..., Any])


def get_objective(objective: Objective) -> AbstractObjective:
    """Return the objective for a name or for a function of a path, or the argument if it is an objective.

    **Raises:** ValueError for an unknown name.
    """
    if isinstance(objective, AbstractObjective):
        return objective
    if callable(objective):
        return Custom(objective)
    if objective not in OBJECTIVES:
        raise ValueError(
            f"objective must be one of {', '.join(map(repr, OBJECTIVES))} or a callable of a path, "
            f"but {objective!r} was given"
        )
    return OBJECTIVES[objective]
