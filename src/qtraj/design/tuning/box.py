"""Which variables are free, held or bounded, and how much each change weighs: by name."""

from collections.abc import Collection, Mapping, Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from typing_extensions import TypeAliasType

from qtraj.design.tuning.motions.motion import COMPONENTS, ENDS, HEADINGS, VELOCITIES, AbstractMotion
from qtraj.design.tuning.objectives.objective import AbstractObjective
from qtraj.design.tuning.problem import DURATION, Problem, Variables, variable_names
from qtraj.foundation.arrays import as_float, concrete
from qtraj.foundation.types import ArrayInput, Scalar

LARGEST_CHANGE, LARGEST_LOGARITHM = 10.0, 3.0
"""How far a velocity may move, in reference speeds, and the logarithm of the duration, where bounds do not say."""

AT_WALL = 1e-6

Bounds = TypeAliasType("Bounds", Mapping[str, tuple[ArrayInput | None, ArrayInput | None]])


def require_names(motion: AbstractMotion, objective: AbstractObjective, fixed: Sequence[str], bounds: Bounds) -> None:
    """Raise a ValueError for names that are no variables, bounds that contradict, or nothing left to move."""
    names = variable_names(motion, objective)
    for name in (*fixed, *bounds):
        if name in HEADINGS and name not in bounds:
            continue
        if name not in names:
            hint = " (uniform motion has V_phi = rho·turn/duration: bound the duration)" if name in VELOCITIES else ""
            raise ValueError(
                f"{name!r} is no variable of this problem{hint}: its variables are {', '.join(names)}; fixed also "
                f"takes {', '.join(HEADINGS)}"
            )
        if name in fixed and name in bounds:
            raise ValueError(f"{name} is both fixed and bounded: leave one out")
    for name in (held_by(x) for x in fixed if x in HEADINGS):
        if name in fixed or name in bounds:
            raise ValueError(f"a fixed heading leaves no choice of {name}: leave one out")
    if set(names) <= {held_by(x) if x in HEADINGS else x for x in fixed}:
        raise ValueError("every variable is fixed, so there is nothing to tune: leave one out of fixed")
    for name, (low, high) in bounds.items():
        _require_order(name, low, high)


def held_by(heading: str) -> str:
    """The variable that follows from the others where this heading is fixed."""
    return heading.replace("heading", "V_rho")


def weights_of(
    weights: Mapping[str, float], objective: AbstractObjective, motion: AbstractMotion
) -> Float[Array, " 7"]:
    """The weights of the squared changes, in the order of `Problem.weights`; 1 where nothing is said.

    **Raises:** ValueError for a name that weighs nothing, or a weight that is not a finite number of 0 or more.
    """
    names = VELOCITIES if motion.is_uniform else (*VELOCITIES, DURATION)
    if weights and objective.name != "nearest":
        raise ValueError(
            f"weights belong to objective='nearest', but the objective is {objective.name!r}: leave them out"
        )
    for name, weight in weights.items():
        if name not in names:
            raise ValueError(f"{name!r} cannot be weighed: the changes that 'nearest' sums are {', '.join(names)}")
        if not (np.ndim(weight) == 0 and np.isfinite(weight) and weight >= 0):
            raise ValueError(f"the weight of {name} must be a finite number of 0 or more, but {weight!r} was given")
    return as_float([float(weights.get(name, 1.0)) for name in (*VELOCITIES, DURATION)])


def box(problem: Problem, fixed: Sequence[str], bounds: Bounds) -> tuple[Variables, Variables]:
    """Lowest and highest values of the variables z of one problem."""
    held = {held_by(x) if x in HEADINGS else x for x in fixed}
    low: list[Scalar] = []
    high: list[Scalar] = []
    for name in problem.names:
        farthest = LARGEST_LOGARITHM if name == DURATION else LARGEST_CHANGE
        if name in held:
            farthest = 0.0
        below, above = (None if x is None else _variable(problem, name, x) for x in bounds.get(name, (None, None)))
        # What is not bounded reaches far, and from a bound that is itself far as far again.
        low.append(below if below is not None else jnp.minimum(-farthest, (0.0 if above is None else above) - farthest))
        high.append(above if above is not None else jnp.maximum(farthest, (0.0 if below is None else below) + farthest))
    forwards = [_forwards(problem, name, fixed) for name in problem.names]
    low = [below if way is None else jnp.maximum(below, way[0]) for below, way in zip(low, forwards, strict=True)]
    high = [above if way is None else jnp.minimum(above, way[1]) for above, way in zip(high, forwards, strict=True)]
    return _stacked(low, problem), _stacked(high, problem)


def _forwards(problem: Problem, name: str, fixed: Sequence[str]) -> tuple[Scalar, Scalar] | None:
    """Between which values V_φ keeps its sign, where the heading is fixed: else the vehicle would drive backwards."""
    end, _, component = name.partition(".")
    if component != "V_phi" or f"{end}.heading" not in fixed:
        return None
    zero = _variable(problem, name, 0.0)
    return jnp.where(zero < 0, zero, -jnp.inf), jnp.where(zero > 0, zero, jnp.inf)


def at_the_wall(names: Sequence[str], z: Float[np.ndarray, " n"], named: Collection[str]) -> str:
    """What to say where a variable that no bound names stands as far away as it may; nothing where none does."""
    walls = [LARGEST_LOGARITHM if name == DURATION else LARGEST_CHANGE for name in names]
    far = np.abs(z) > np.asarray(walls) - AT_WALL
    there = [name for name, at in zip(names, far, strict=True) if at and name not in named]
    if not there:
        return ""
    how = "Bounds by name (bounds=, or [tune.bounds] in a scenario) allow more, or less."
    return f"Mind: {', '.join(there)} went as far as the search goes. {how}"


def _stacked(values: list[Scalar], problem: Problem) -> Variables:
    return jnp.stack([jnp.asarray(x, problem.speed.dtype) for x in values])


def _variable(problem: Problem, name: str, value: ArrayInput) -> Scalar:
    """The variable z of a velocity [m/s] or a duration [s]."""
    value = as_float(value).astype(problem.speed.dtype)
    if name == DURATION:
        return jnp.log(value / problem.duration)
    end, component = name.split(".")
    state = problem.start if end == ENDS[0] else problem.end
    return (value - state.velocity[COMPONENTS.index(component)]) / problem.speed


def _require_order(name: str, low: ArrayInput | None, high: ArrayInput | None) -> None:
    ends = [None if x is None else concrete(as_float(x)) for x in (low, high)]
    for value in ends:
        if value is not None and not np.all(np.isfinite(value)):
            raise ValueError(f"the bounds of {name} must be finite, or None for none, but {value} was given")
        if name == DURATION and value is not None and not np.all(value > 0):
            raise ValueError(f"the bounds of {name} must be positive [s], but {value} was given")
    if ends[0] is not None and ends[1] is not None and np.any(ends[0] >= ends[1]):
        raise ValueError(
            f"the bounds of {name} contradict: {ends[0]} is not below {ends[1]}. To hold it, name it in fixed"
        )
