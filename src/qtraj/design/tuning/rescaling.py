"""Search with a user's objective in units that follow from its derivatives, never from its value.

At its start, each search takes the largest component of the gradient, or half the largest component of the Hessian if
this is larger, as the unit of the objective, and measures the objective relative to its value there. So the search
depends neither on a constant that is added to the objective nor on a factor. If the unit at the final point differs
from the unit at the start by more than the factor `MAX_CHANGE`, the tolerances of the search were wrong there. The
search then continues from this point with the new unit.
"""

import dataclasses
from collections.abc import Callable

import jax
import numpy as np
from jaxtyping import Float

from qtraj.design.tuning.objectives import custom
from qtraj.design.tuning.problem import Problem
from qtraj.design.tuning.search import TIE, Ends
from qtraj.design.tuning.searches import Searches

MAX_CHANGE = 10.0
"""Largest ratio of the units at the start and at the final point of a search, in both directions."""

MAX_CONTINUED = 12
"""Maximum number of times that a search is continued with another unit."""

ROUNDING = 10 * np.finfo(float).eps
"""Relative error of the values of a user's objective."""

BLOCK = 256
"""Number of searches whose objective is evaluated together, so that large batches need no further compilation."""

Run = Callable[[Searches, np.ndarray], Ends]


def measured(searches: Searches, z: Float[np.ndarray, "n batch"]) -> Searches:
    """Return the searches with the units and the values of the user's objective at the variables `z`."""
    with np.errstate(all="ignore"):
        problem, value = searches.problem, values(searches.problem, z)
        alone = dataclasses.replace(problem, scale=np.ones_like(problem.scale))
        gradient, hessian = _joined(custom.derivatives, alone, z)
        free = searches.high > searches.low
        slope = np.where(free, np.abs(gradient), 0.0).max(axis=0)
        curvature = np.where(free[:, None] & free, np.abs(hessian), 0.0).max(axis=(0, 1))
        unit = np.fmax(slope, 0.5 * curvature)
        good = np.isfinite(value) & np.isfinite(unit) & (unit > 0)
    scale, offset = np.where(good, unit, problem.scale), np.where(good, value, problem.offset)
    return dataclasses.replace(searches, problem=dataclasses.replace(problem, scale=scale, offset=offset))


def run(search: Run, searches: Searches, z: Float[np.ndarray, "n batch"], max_steps: int) -> Ends:
    """Return the final points of a batch of searches for a user's objective, each from its own `z`.

    `search` runs the searches that it is given. A search that took `max_steps` steps is not continued. The costs of the
    result are values of the user's objective.
    """
    own = measured(searches, np.clip(z, searches.low, searches.high))
    ends = search(own, z)
    index = np.arange(searches.count)
    for _ in range(MAX_CONTINUED):
        index = index[ends.steps[index] < max_steps]
        if index.size == 0:
            break
        new = measured(own.take(index), ends.z[:, index])
        ratio = new.problem.scale / own.problem.scale[index]
        changed = np.flatnonzero(~((ratio <= MAX_CHANGE) & (ratio >= 1 / MAX_CHANGE)))
        index = index[changed]
        if index.size == 0:
            break
        own.problem.scale[index] = new.problem.scale[changed]
        again = search(new.take(changed), ends.z[:, index])
        ends.put(index, again._replace(steps=ends.steps[index] + again.steps))
    cost = values(searches.problem, ends.z)
    return ends._replace(cost=cost, unit=own.problem.scale + ROUNDING / TIE * np.abs(cost))


def values(problem: Problem, z: Float[np.ndarray, "n batch"]) -> Float[np.ndarray, " batch"]:
    """Return the values of the user's objective for a batch of problems."""
    return _joined(lambda *block: (custom.values(*block),), problem, z)[0]


def _joined(function: Callable[..., tuple], problem: Problem, z: np.ndarray) -> list[np.ndarray]:
    """Call a function of a problem and variables for parts of a batch, and join the results, with the batch last."""
    slices = [slice(k, k + BLOCK) for k in range(0, z.shape[1], BLOCK)]
    parts = [function(jax.tree.map(lambda x, part=part: x[part], problem), z[:, part]) for part in slices]
    return [np.concatenate(x, axis=-1) for x in zip(*parts, strict=True)]
