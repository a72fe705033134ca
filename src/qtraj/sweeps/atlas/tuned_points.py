"""Tunings as a function of two parameters, for an atlas."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import jax
import numpy as np
from jaxtyping import Float
from typing_extensions import TypeAliasType

from qtraj.design.limits import Limits
from qtraj.design.proof.certificate import Certificate
from qtraj.design.tuning.outcome import CONVERGED, INFEASIBLE, NOT_CONVERGED, Tuned
from qtraj.design.tuning.tune import tune
from qtraj.path.quantity import quantity
from qtraj.sweeps.atlas.classified import (
    CLASSES,
    FAILED,
    FEASIBLE,
    FIRST_LIMIT,
    INFEASIBLE as NO_SOLUTION,
    SAMPLED,
    STATUS,
    UNDECIDED,
    PointFunction,
)

STACKED = ("start", "end", "limits", "duration", "turn", "placement")
"""Arguments of `tune` that may differ between points."""

EQUAL = 1e-3
"""Relative violations that differ by less than this, or by this part of the largest one, count as equal."""

SAMPLES = 65
"""Number of instants at which margins are sampled if a quantity is undefined somewhere on the path."""

ACTIVE = 1e-6
"""A satisfied limit is met at a point if its relative margin is at most this."""

Problem = TypeAliasType("Problem", Callable[[float, float], Any])
"""A function of two numbers that returns start, end and limits, or a mapping of arguments of `tune`."""


def tuned_points(problem: Problem, **options: Any) -> PointFunction:
    """Return a function for `atlas` that tunes the problem at each point, all points of a call as one batch.

    Args:
        problem: A function of two numbers, the values of the parameters. It returns the tuple (start, end, limits), or
            a dict with these and any of "duration", "turn" and "placement", as for `tune`. The limits of all points
            must limit the same quantities.
        **options: The other arguments of `tune`, the same at all points, such as `motion="hermite"`, `fixed` or
            `starts`.

    Returns:
        A function of two arrays (n,). It returns the classes "feasible" (converged and proved), "sampled" (converged,
        but not all limits are proved), "infeasible" (no path was found that satisfies the limits; a local search cannot
        prove that none exists), "undecided" (not converged) and "failed" (ill-posed). `first_limit` names the limits
        with the largest relative violation, or the active limits, joined by " + ". The values are "duration" [s] and
        "objective", NaN unless converged, and the relative margin of each limit, such as "margin_curvature", negative
        where violated.

    Raises:
        ValueError: By the function, if the problem returns something else, or if `tune` refuses it.

    Example:
        >>> def corner(speed, radius):
        ...     start = qt.BoundaryState([radius, 0, 0], [0, speed, 0])
        ...     end = qt.BoundaryState([0, radius, 0], [-speed, 0, 0])
        ...     return start, end, qt.Limits(lateral_acceleration=1.5)
        >>> found = tuned_points(corner, fixed=["duration"])(np.array([3.0, 9.0]), np.array([20.0, 20.0]))
        >>> found["status"]
        array(['feasible', 'infeasible'], dtype='<U10')
    """

    def tuned(x: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"]) -> dict[str, np.ndarray]:
        problems = [_arguments(problem, float(a), float(b)) for a, b in zip(x, y, strict=True)]
        stacked = {name: _stacked(name, [each[name] for each in problems]) for name in problems[0]}
        for name in ("start", "end"):  # at least one argument has a batch axis
            stacked[name] = jax.tree.map(lambda a: np.broadcast_to(a, (len(problems), 3)), stacked[name])
        found = tune(**stacked, **options)
        margins = _relative_margins(found.certificate)
        for k in np.flatnonzero(np.isnan(margins).any(axis=1) & np.isfinite(np.asarray(found.path.duration))):
            margins[k] = _sampled_margins(found, int(k), problems[k]["limits"])
        return _findings(found, margins)

    return tuned


def _arguments(problem: Problem, x: float, y: float) -> dict[str, Any]:
    """Return the arguments of `tune` at one point.

    **Raises:** ValueError if the problem returns something else.
    """
    found = problem(x, y)
    if isinstance(found, tuple) and len(found) == 3:
        found = dict(zip(STACKED, found, strict=False))
    if not isinstance(found, Mapping) or not found.keys() >= set(STACKED[:3]) or found.keys() - set(STACKED):
        raise ValueError(
            "the problem of an atlas must return (start, end, limits), or a dict with these and any of duration, turn "
            f"and placement, but it returned {sorted(found) if isinstance(found, Mapping) else found!r}"
        )
    return {name: found[name] for name in STACKED if found.get(name) is not None}


def _stacked(name: str, each: list[Any]) -> Any:
    """Return one tree with a batch axis in front of the leaves that differ.

    **Raises:** ValueError for trees of different structure.
    """
    leaves, structures = zip(*(jax.tree.flatten(tree) for tree in each), strict=True)
    if any(structure != structures[0] for structure in structures):
        raise ValueError(f"the {name} must have the same form at all points of an atlas: for limits, the same names")
    columns = [[np.asarray(x, float) for x in column] for column in zip(*leaves, strict=True)]
    same = [all(np.array_equal(x, column[0], equal_nan=True) for x in column) for column in columns]
    stacked = [column[0] if equal else np.stack(column) for column, equal in zip(columns, same, strict=True)]
    return jax.tree.unflatten(structures[0], stacked)


def _findings(found: Tuned, margins: Float[np.ndarray, "n k"]) -> dict[str, np.ndarray]:
    """Return class, limits and values of a batch of tunings."""
    certificate, code = found.certificate, np.asarray(found.code)
    duration = np.asarray(found.path.duration, float)
    proved = np.asarray(certificate.holds)
    status = np.full(len(code), FAILED)
    for value, own in ((INFEASIBLE, NO_SOLUTION), (NOT_CONVERGED, UNDECIDED)):
        status[code == value] = own
    converged = (code == CONVERGED) & np.isfinite(duration)
    status[converged] = np.where(proved[converged], FEASIBLE, SAMPLED)
    values = {"duration": duration, "objective": np.asarray(found.objective, float)}
    return {
        STATUS: np.asarray(CLASSES)[status],
        FIRST_LIMIT: np.array([_first(row, certificate.names) for row in margins]),
        **{name: np.where(converged, x, np.nan) for name, x in values.items()},
        **{f"margin_{name}": margins[:, k] for k, name in enumerate(certificate.names)},
    }


def _relative_margins(certificate: Certificate) -> Float[np.ndarray, "n k"]:
    """Return the distances from the limits, divided by the limits; negative where violated."""
    sides = np.array([quantity(name).side for name in certificate.names])
    values, limits = np.asarray(certificate.values), np.asarray(certificate.limits)
    size = np.where(limits == 0, 1.0, np.abs(limits))
    return sides * (limits - values) / size


def _sampled_margins(found: Tuned, k: int, limits: Limits) -> Float[np.ndarray, " k"]:
    """Return the smallest relative margins at instants where a quantity is defined.

    The path with the smallest violation may stop or reverse, and then curvature and accelerations are undefined there.
    """
    names = found.certificate.names
    bounds = np.asarray(found.certificate.limits)[k]
    path = jax.tree.map(lambda x: x[k], found.path)
    with np.errstate(all="ignore"):
        margins = limits.margins(path, np.linspace(0.0, float(path.duration), SAMPLES))
        sampled = [np.asarray(margins.get(name, np.nan), float) for name in names]
    values = [np.min(x, where=~np.isnan(x), initial=np.inf) for x in sampled]
    return np.array(values) / np.where(bounds == 0, 1.0, np.abs(bounds))


def _first(margins: Float[np.ndarray, " k"], names: tuple[str, ...]) -> str:
    """Name the limits with the largest violation, or, if all are satisfied, those that are active."""
    least = np.nanmin(margins, initial=np.inf)
    bound = least + EQUAL * max(1.0, -least) if least < -ACTIVE else ACTIVE
    return " + ".join(name for name, x in zip(names, margins.tolist(), strict=True) if x <= bound)
