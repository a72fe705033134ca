"""Objectives by name."""

from collections.abc import Callable
from typing import Any

from typing_extensions import TypeAliasType

from qtraj.design.tuning import choices
from qtraj.design.tuning.objectives.custom import Custom
from qtraj.design.tuning.objectives.nearest_to import NearestTo
from qtraj.design.tuning.objectives.objective import AbstractObjective
from qtraj.path.hodograph import AbstractHodograph

OBJECTIVES: dict[str, AbstractObjective] = choices.instances("objectives", choices.OBJECTIVES)

Objective = TypeAliasType("Objective", str | AbstractObjective | Callable[..., Any])


def get_objective(objective: Objective, nearest_to: AbstractHodograph | None = None) -> AbstractObjective:
    """Return the objective for a name or for a function of a path, or the argument if it is an objective.

    With a path `nearest_to`, the name must be "nearest", and the objective is the distance from this path.

    **Raises:** ValueError for an unknown name, for another objective with `nearest_to`, or if this is not one path.
    """
    if nearest_to is not None:
        if not (isinstance(objective, str) and objective == "nearest"):
            raise ValueError(
                f"nearest_to belongs to objective='nearest', but the objective is {objective!r}: remove one of the two"
            )
        return NearestTo(nearest_to)
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
