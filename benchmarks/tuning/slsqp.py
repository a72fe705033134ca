"""Solve tuning problems with SciPy's SLSQP and JAX's derivatives, compiled once for all problems."""

from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import minimize

from qtraj.design.tuning.problem import Problem
from qtraj.path.values import squared

INSTANTS = 129
ADDED = 8
"""Number of additional instants, at peaks of an earlier solution, to satisfy the limit between samples too."""

EXCHANGES = 3

REACH = 1.0
"""Bounds on the changes in the search for the smallest peak: velocities / reference speed, and log(duration)."""

OPTIONS = {"ftol": 1e-12, "maxiter": 300}


class Solved(NamedTuple):
    """Variables, cost, and the ratio of the largest curvature to its limit."""

    z: np.ndarray
    cost: float
    ratio: float


@jax.jit
def functions(problem: Problem, limit: Any, added: Any, z: Any) -> tuple[Any, Any, Any, Any]:
    """Return the cost, the constraint values at all instants, and the derivatives of both."""

    def both(z: Any) -> tuple[Any, Any]:
        path = problem.path(z)
        times = jnp.concatenate([jnp.linspace(0.0, 1.0, INSTANTS), added]) * path.duration
        values = jax.vmap(lambda t: squared(path, t, "curvature"))(times)
        return problem.cost(z), 0.5 * (1.0 - values / limit**2)

    (cost, margin), (slope, jacobian) = both(z), jax.jacfwd(both)(z)
    return cost, margin, slope, jacobian


@jax.jit
def refined_peak(problem: Problem, limit: Any, z: Any) -> tuple[Any, Any]:
    """Return the instants of the highest peaks among many samples, and the largest curvature relative to the limit."""
    path = problem.path(z)
    u = jnp.linspace(0.0, 1.0, 20001)
    values = jax.vmap(lambda u: squared(path, u * path.duration, "curvature"))(u)
    inner = values[1:-1]
    tops = jnp.where((inner >= values[:-2]) & (inner > values[2:]), inner, 0.0)
    return u[1 + jnp.argsort(-tops)[:ADDED]], jnp.sqrt(jnp.max(values)) / limit


def take(problems: Problem, k: int) -> Problem:
    """Return one problem of a batch."""
    return jax.tree.map(lambda x: x[k], problems)


def minimised(problem: Problem, limit: float, start: np.ndarray, added: np.ndarray | None = None) -> np.ndarray:
    """Run SLSQP once from one start, and return the final point."""
    added = np.zeros(ADDED) if added is None else added

    @lru_cache(maxsize=1)
    def at(z: tuple[float, ...]) -> tuple[np.ndarray, ...]:
        return jax.device_get(functions(problem, limit, added, np.asarray(z)))

    found = minimize(
        lambda z: float(at(tuple(z))[0]),
        start,
        jac=lambda z: at(tuple(z))[2],
        constraints={"type": "ineq", "fun": lambda z: at(tuple(z))[1], "jac": lambda z: at(tuple(z))[3]},
        method="SLSQP",
        options=OPTIONS,
    )
    return np.where(np.isfinite(found.x), found.x, start)


def solve(problem: Problem, limit: float, start: np.ndarray, added: np.ndarray | None = None) -> Solved:
    """Run SLSQP once, and return the checked result."""
    return outcome(problem, limit, minimised(problem, limit, start, added))


def outcome(problem: Problem, limit: float, z: np.ndarray) -> Solved:
    """Return the result for given variables, with the curvature checked at many instants."""
    cost = functions(problem, limit, np.zeros(ADDED), z)[0]
    return Solved(z, float(cost), float(refined_peak(problem, limit, z)[1]))


def exchanged(problem: Problem, limit: float, found: Solved) -> Solved:
    """Repeat the run with the peaks of its solution as additional instants, to satisfy the limit there too."""
    for _ in range(EXCHANGES):
        if found.ratio <= 1 + 1e-10:
            break
        found = solve(problem, limit, found.z, np.asarray(refined_peak(problem, limit, found.z)[0]))
    return found


def least_peaks(problems: Problem, nominal: np.ndarray) -> np.ndarray:
    """Return the smallest peak curvature that SLSQP finds for each problem, as a minimax in epigraph form."""
    return np.asarray([_least_peak(take(problems, k), float(limit)) for k, limit in enumerate(nominal)])


def _least_peak(problem: Problem, limit: float) -> float:
    none = np.zeros(ADDED)

    @lru_cache(maxsize=1)
    def at(z: tuple[float, ...]) -> tuple[np.ndarray, ...]:
        return jax.device_get(functions(problem, limit, none, np.asarray(z)))

    size = problem.size
    found = minimize(
        lambda x: x[size],
        np.append(np.zeros(size), 0.0),
        jac=lambda x: np.eye(size + 1)[size],
        constraints={
            "type": "ineq",
            "fun": lambda x: at(tuple(x[:size]))[1] + x[size],
            "jac": lambda x: np.column_stack([at(tuple(x[:size]))[3], np.ones(INSTANTS + ADDED)]),
        },
        bounds=[(-REACH, REACH)] * size + [(None, None)],
        method="SLSQP",
        options={"ftol": 1e-10, "maxiter": 100},
    )
    z = np.where(np.isfinite(found.x[:size]), found.x[:size], 0.0)
    return limit * float(refined_peak(problem, limit, z)[1])
