"""Elastic quadratic programs: the conditions of Karush, Kuhn and Tucker, which prove a convex optimum."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize as scipy_minimize

from qtraj.design.tuning.quadratic import Program, least_pivot, minimise

VARIABLES, ROWS, LANES = 5, 22, 64
KEPT = 1e-8  # of numbers near one

SPOILT = 1e-5  # what the largest difference of scales may do to a solution that calls itself one

solve = jax.jit(jax.vmap(minimise))


def programs(seed, curvature=1.0, penalty=2.0, alike=False):
    """Random programs; `curvature` scales the Hessian, `alike` makes half of the rows copies of the others."""
    rng = np.random.default_rng(seed)
    roots = rng.normal(size=(LANES, VARIABLES, VARIABLES))
    rows, bounds = rng.normal(size=(LANES, ROWS, VARIABLES)), rng.normal(size=(LANES, ROWS))
    if alike:
        rows[:, ROWS // 2 :], bounds[:, ROWS // 2 :] = rows[:, : ROWS // 2], bounds[:, : ROWS // 2]
    return Program(
        hessian=curvature * (roots @ roots.transpose(0, 2, 1) + 0.1 * np.eye(VARIABLES)),
        slope=rng.normal(size=(LANES, VARIABLES)),
        rows=rows,
        bounds=bounds,
        low=-rng.uniform(0.0, 1.0, (LANES, VARIABLES)),
        high=rng.uniform(0.0, 1.0, (LANES, VARIABLES)),
        penalty=np.full(LANES, penalty),
        stiffness=np.full(LANES, min(1e-4, curvature)),
        least=-rng.uniform(0.0, 1.0, LANES),
    )


def imbalance(program, d, t, multipliers, near=KEPT):
    """The largest violation of the conditions, by their definition."""
    left = program.bounds - program.rows @ d + t
    slope = program.hessian @ d + program.slope + multipliers @ program.rows
    of_t = program.penalty + program.stiffness * t - multipliers.sum()
    at_low, at_high = d <= program.low + near, d >= program.high - near
    pushed = np.where(at_low, np.maximum(-slope, 0.0), np.where(at_high, np.maximum(slope, 0.0), np.abs(slope)))
    pushed = np.where(at_low & at_high, 0.0, pushed)
    return max(
        np.max(-left, initial=0.0),
        np.max(program.low - d, initial=0.0),
        np.max(d - program.high, initial=0.0),
        program.least - t,
        np.max(-multipliers),
        np.max(np.abs(multipliers * left)),
        np.max(pushed),
        -of_t if t <= program.least + near else abs(of_t),
    )


@pytest.mark.parametrize(
    "kind",
    [
        {},
        {"penalty": 1e3},
        {"curvature": 1e-6},  # nearly linear, as with little trust
        {"curvature": 1e4},
        {"alike": True},  # rows that depend on each other
        {"alike": True, "curvature": 1e-6, "penalty": 50.0},
    ],
)
def test_the_solution_meets_the_conditions_of_optimality(kind):
    given = programs(seed=3, **kind)
    d, t, multipliers, solved, _ = jax.tree.map(np.asarray, solve(jax.tree.map(jnp.asarray, given)))
    assert np.all(solved)
    scale = max(1.0, kind.get("penalty", 1.0), kind.get("curvature", 1.0))
    for k in range(LANES):
        one = jax.tree.map(lambda x, k=k: x[k], given)
        assert imbalance(one, d[k], t[k], multipliers[k]) < KEPT * scale, k
    assert np.any(t > given.least + KEPT)  # some limits cannot all be met, some can


@pytest.mark.parametrize("condition", [1e6, 1e8, 1e10, 1e14])
def test_a_program_is_solved_or_says_that_it_is_not(condition):
    """Correlated variables: Hessians with random axes whose curvatures lie far apart."""
    given = programs(seed=7)
    turns = np.linalg.qr(np.random.default_rng(8).normal(size=(LANES, VARIABLES, VARIABLES)))[0]
    bends = np.geomspace(1.0, 1 / condition, VARIABLES)
    given = given._replace(hessian=(turns * bends) @ turns.transpose(0, 2, 1))
    d, t, multipliers, solved, _ = jax.tree.map(np.asarray, solve(jax.tree.map(jnp.asarray, given)))
    assert np.mean(solved) > 0.9 or condition > 1e6
    for k in np.flatnonzero(solved):
        one = jax.tree.map(lambda x, k=k: x[k], given)
        assert imbalance(one, d[k], t[k], multipliers[k], SPOILT) < SPOILT, k


def test_a_held_variable_does_not_move():
    given = programs(seed=4)
    given.low[:, 2] = given.high[:, 2] = 0.0
    d = solve(jax.tree.map(jnp.asarray, given)).d
    np.testing.assert_allclose(d[:, 2], 0.0, atol=KEPT)


def test_scipy_finds_no_lower_value():
    given = jax.tree.map(lambda x: x[0], programs(seed=5))
    d, t, *_ = jax.tree.map(np.asarray, minimise(jax.tree.map(jnp.asarray, given)))

    def value(x):
        d, t = x[:-1], x[-1]
        return 0.5 * d @ given.hessian @ d + given.slope @ d + 0.5 * given.stiffness * t**2 + given.penalty * t

    found = scipy_minimize(
        value,
        np.append(np.zeros(VARIABLES), 5.0),
        bounds=[*zip(given.low, given.high, strict=True), (given.least, None)],
        constraints={"type": "ineq", "fun": lambda x: given.bounds - given.rows @ x[:-1] + x[-1]},
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 500},
    )
    assert value(np.append(d, t)) == pytest.approx(found.fun, abs=1e-7)


def test_pivots_tell_what_is_positive_definite():
    rng = np.random.default_rng(6)
    root = rng.normal(size=(6, 6))
    whole = root @ root.T
    assert least_pivot(jnp.asarray(whole)) > 0
    lowest = np.linalg.eigvalsh(whole)[0]
    assert least_pivot(jnp.asarray(whole - 1.01 * lowest * np.eye(6))) < 0
