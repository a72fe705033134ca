"""Starts of the search that pass an obstacle which moves at another time: after it, or before it."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float

from qtraj.design.tuning_route.problem import RouteProblem

LATER, EARLIER = 1.5, -0.6
"""The largest shifts of the time at which the route reaches the obstacle, as fractions of the time until then."""

TRIALS = np.linspace(0.0, 1.0, 41)[1:]


def starts(
    problem: RouteProblem, inside: Bool[np.ndarray, " n"], clear: Callable[[np.ndarray], bool]
) -> list[Float[np.ndarray, "joints 10"]]:
    """Return variables with the smallest shifts in time for which `clear` is true; none for a side without one.

    `inside` marks the segments on which the body enters the obstacle.
    """
    found = []
    for most in (LATER, EARLIER):
        trials = (_delayed(problem, inside, most * part) for part in TRIALS)
        found += [z for z in (next((z for z in trials if clear(z)), None),) if z is not None]
    return found


def _delayed(problem: RouteProblem, inside: Bool[np.ndarray, " n"], part: float) -> Float[np.ndarray, "joints 10"]:
    """Return variables with which the route follows the same curve, and reaches the obstacle later by a part.

    The delay grows linearly until the first joint near the obstacle. After the last one, it remains if the route may
    end at another time, and otherwise shrinks.
    """
    times = np.append(np.asarray(problem.starts), problem.starts[-1] + problem.durations[-1])
    first, last = np.flatnonzero(inside)[[0, -1]] + [0, 1]
    first = max(first, 1)
    way = np.array([times[0], times[first], times[max(last, first)], times[-1]])
    size = part * (times[first] - times[0])
    after = size if problem.free[-1, 9] else 0.0
    delay = np.interp(times, way, [0.0, size, size, after])
    pace = np.diff(times) / np.maximum(np.diff(times + delay), 1e-3 * np.diff(times))
    rate = 0.5 * (np.append(pace, pace[-1]) + np.append(pace[0], pace))
    h = problem.durations
    z = np.zeros(problem.free.shape)
    z[:, 9] = delay
    for k, power in ((1, 1), (2, 2)):
        states = np.concatenate([problem.ends[k].T / h[:, None] ** k, problem.ends[k + 3].T[-1:] / h[-1] ** k])
        change = (rate**power - 1)[:, None] * states
        z[:, 3 * k : 3 * k + 3] = np.einsum("jac,jc->ja", problem.axes, change)
    return np.where(problem.free, z / problem.scale, 0.0)
