"""Fix, bound and weight the variables of a tuning by name."""

from collections.abc import Collection, Mapping, Sequence
from difflib import get_close_matches
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from typing_extensions import TypeAliasType

from qtraj.design.tuning.motions.motion import COMPONENTS, ENDS, HEADINGS, VELOCITIES, AbstractMotion
from qtraj.design.tuning.objectives.objective import AbstractObjective
from qtraj.design.tuning.problem import DURATION, Problem, variable_names
from qtraj.foundation.arrays import as_float, concrete, is_traced
from qtraj.foundation.types import ArrayInput

MAX_CHANGE, MAX_LOG_DURATION = 10.0, 3.0
"""Default bounds on the magnitudes of velocity changes, in units of the reference speed, and of ln(T/T₀).

T is the duration, and T₀ the initial duration.
"""

LIKE = 0.7
"""Minimum similarity, from 0 to 1, of a suggested name."""

BOUND_TOLERANCE = 1e-6
"""A variable within this distance of a default bound counts as at the bound."""

Bounds = TypeAliasType("Bounds", Mapping[str, tuple[ArrayInput | None, ArrayInput | None]])


def require_names(motion: AbstractMotion, objective: AbstractObjective, fixed: Sequence[str], bounds: Bounds) -> None:
    """Raise a ValueError if a name is unknown, if bounds contradict each other, or if all variables are fixed."""
    names = variable_names(motion, objective)
    for name in (*fixed, *bounds):
        if name in HEADINGS and name not in bounds:
            continue
        if name not in names:
            hint = (
                " (in uniform motion V_phi = rho·turn/duration: bound the duration instead)"
                if name in VELOCITIES
                else _similar(name, names)
            )
            raise ValueError(
                f"{name!r} is not a variable of this problem{hint}: its variables are {', '.join(names)}; fixed also "
                f"accepts {', '.join(HEADINGS)}"
            )
        if name in fixed and name in bounds:
            raise ValueError(f"{name} is both fixed and bounded: remove one of the two")
    for name in (dependent_velocity(x) for x in fixed if x in HEADINGS):
        if name in fixed or name in bounds:
            raise ValueError(f"a fixed heading determines {name}: remove one of the two from fixed or bounds")
    if set(names) <= {dependent_velocity(x) if x in HEADINGS else x for x in fixed}:
        raise ValueError("every variable is fixed: remove at least one name from fixed")
    for name, (low, high) in bounds.items():
        _require_order(name, low, high)


def _similar(name: str, names: Sequence[str]) -> str:
    """Return a question about the variable or heading with a similar name, if there is one."""
    near = get_close_matches(name, [*names, *HEADINGS], n=1, cutoff=LIKE)
    return f" (did you mean {near[0]!r}?)" if near else ""


def bounds_text(bounds: Mapping[str, tuple[float | None, float | None]]) -> str:
    """Describe the lower and upper bounds of variables by their names; empty if there are none."""
    texts = []
    for name, (low, high) in bounds.items():
        unit = "s" if name == DURATION else "m/s"
        if low is not None and high is not None:
            texts.append(f"{name} from {low:.6g} to {high:.6g} {unit}")
        else:
            texts.append(f"{name} {'at most' if low is None else 'at least'} {high if low is None else low:.6g} {unit}")
    return ", ".join(texts)


def dependent_velocity(heading: str) -> str:
    """Return the name of the variable that a fixed heading determines."""
    return heading.replace("heading", "V_rho")


def change_weights(
    weights: Mapping[str, float], objective: AbstractObjective, motion: AbstractMotion
) -> Float[np.ndarray, " 7"]:
    """Return the weights of the squared changes, in the order of `Problem.weights`; the default is 1.

    **Raises:** ValueError if weights are given for an objective other than "nearest", if a name is unknown, or if a
    weight is negative or not finite.
    """
    names = VELOCITIES if motion.is_uniform else (*VELOCITIES, DURATION)
    if weights and objective.name != "nearest":
        raise ValueError(f"weights apply to objective='nearest', but the objective is {objective.name!r}: remove them")
    for name, weight in weights.items():
        if name not in names:
            raise ValueError(
                f"{name!r} cannot be weighted: the objective 'nearest' contains only the changes of {', '.join(names)}"
            )
        if not (np.ndim(weight) == 0 and np.isfinite(weight) and weight >= 0):
            raise ValueError(f"the weight of {name} must be finite and 0 or more, but {weight!r} was given")
    return np.asarray([float(weights.get(name, 1.0)) for name in (*VELOCITIES, DURATION)])


def box(problem: Problem, fixed: Sequence[str], bounds: Bounds) -> tuple[Any, Any]:
    """Return the lower and upper bounds (*batch, n) of the variables z of one problem or a batch."""
    fixed_variables = {dependent_velocity(x) if x in HEADINGS else x for x in fixed}
    xp: Any = jnp if is_traced(problem, bounds) else np
    lows, highs = [], []
    for name in problem.names:
        reach = MAX_LOG_DURATION if name == DURATION else MAX_CHANGE
        if name in fixed_variables:
            reach = 0.0
        lower, upper = (None if x is None else _variable(problem, name, x, xp) for x in bounds.get(name, (None, None)))
        # The default bounds are ±reach. If the user's lower bound is positive, the default upper bound is the user's
        # bound plus `reach`, so that the interval is not empty. A negative upper bound is treated in the same way.
        low = lower if lower is not None else xp.minimum(-reach, (0.0 if upper is None else upper) - reach)
        high = upper if upper is not None else xp.maximum(reach, (0.0 if lower is None else lower) + reach)
        end, _, component = name.partition(".")
        if component == "V_phi" and f"{end}.heading" in fixed:
            # Outside the range in which the variable keeps its sign, the vehicle would drive backwards.
            zero = _variable(problem, name, 0.0, xp)
            low = xp.maximum(low, xp.where(zero < 0, zero, -np.inf))
            high = xp.minimum(high, xp.where(zero > 0, zero, np.inf))
        lows.append(xp.broadcast_to(low, problem.speed.shape))
        highs.append(xp.broadcast_to(high, problem.speed.shape))
    return xp.stack(lows, axis=-1), xp.stack(highs, axis=-1)


def default_bound_warning(names: Sequence[str], z: Float[np.ndarray, " n"], user_bounds: Collection[str]) -> str:
    """Return a message that names the variables at their default bounds, or an empty string without such variables."""
    max_values = [MAX_LOG_DURATION if name == DURATION else MAX_CHANGE for name in names]
    is_at_bound = np.abs(z) > np.asarray(max_values) - BOUND_TOLERANCE
    names_at_bound = [name for name, at in zip(names, is_at_bound, strict=True) if at and name not in user_bounds]
    if not names_at_bound:
        return ""
    advice = "To change these bounds, pass bounds= (in a scenario, the table [tune.bounds])."
    return f"Note: {', '.join(names_at_bound)} reached the default bounds of the search. {advice}"


def _variable(problem: Problem, name: str, value: Any, xp: Any) -> Any:
    """Return the value of the variable z that corresponds to a velocity [m/s] or a duration [s]."""
    value = xp.asarray(value, problem.speed.dtype)
    if name == DURATION:
        return xp.log(value / problem.duration)
    end, component = name.split(".")
    state = problem.start if end == ENDS[0] else problem.end
    return (value - state.velocity[..., COMPONENTS.index(component)]) / problem.speed


def _require_order(name: str, low: ArrayInput | None, high: ArrayInput | None) -> None:
    ends = [None if x is None else concrete(as_float(x)) for x in (low, high)]
    for value in ends:
        if value is not None and not np.all(np.isfinite(value)):
            raise ValueError(
                f"the bounds of {name} must be finite, or None for the default bound, but {value} was given"
            )
        if name == DURATION and value is not None and not np.all(value > 0):
            raise ValueError(f"the bounds of {name} must be positive [s], but {value} was given")
    if ends[0] is not None and ends[1] is not None and np.any(ends[0] >= ends[1]):
        raise ValueError(
            f"the bounds of {name} contradict each other: {ends[0]} is not below {ends[1]}. To keep the initial value, "
            f"add {name} to fixed"
        )
