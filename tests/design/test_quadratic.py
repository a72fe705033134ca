"""Elastic quadratic programs: the conditions of Karush, Kuhn and Tucker, which prove a convex optimum."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize as scipy_minimize

from qtraj.design.tuning.quadratic import Program, inverse, minimise

VARIABLES, SLOTS, ROWS, BATCH = 5, 2, 11, 64
KEPT = 1e-8  # of numbers near one

inverses = jax.jit(jax.vmap(inverse))
solve = jax.jit(jax.vmap(minimise))


def programs(seed, curvature=1.0, penalty=2.0, alike=False, unused=0):
    """Random programs; `curvature` scales the Hessian, `alike` makes the rows of both slots the same.

    `unused` slots follow whose rows would matter if they were looked at.
    """
    rng = np.random.default_rng(seed)
    roots = rng.normal(size=(BATCH, VARIABLES, VARIABLES))
    shape = (BATCH, SLOTS + unused, ROWS)
    rows, bounds = rng.normal(size=(*shape, VARIABLES)), rng.normal(size=shape)
    if alike:
        rows[:, 1], bounds[:, 1] = rows[:, 0], bounds[:, 0]
    bounds[:, SLOTS:] = -10.0
    hessian = curvature * (roots @ roots.transpose(0, 2, 1) + 0.1 * np.eye(VARIABLES))
    return Program(
        hessian=hessian,
        inverse=np.asarray(inverses(hessian)[0]),
        slope=rng.normal(size=(BATCH, VARIABLES)),
        rows=rows,
        bounds=bounds,
        slots=np.full(BATCH, SLOTS),
        low=-rng.uniform(0.0, 1.0, (BATCH, VARIABLES)),
        high=rng.uniform(0.0, 1.0, (BATCH, VARIABLES)),
        penalty=np.full(BATCH, penalty),
        stiffness=np.full(BATCH, min(1e-4, curvature)),
        least=-rng.uniform(0.0, 1.0, BATCH),
    )


def solved(given):
    """d, t, the multipliers of the rows that are looked at, and whether each is solved."""
    found = jax.tree.map(np.asarray, solve(jax.tree.map(jnp.asarray, given)))
    multipliers = np.zeros((BATCH, given.bounds.shape[1] * ROWS + 2 * VARIABLES + 1))
    places = np.where(found.active.used, found.active.row, 0)
    np.put_along_axis(multipliers, found.active.row, 0.0, axis=1)
    for k in range(BATCH):
        np.add.at(multipliers[k], places[k], np.where(found.active.used[k], found.active.multiplier[k], 0.0))
    return found.d, found.t, multipliers[:, : SLOTS * ROWS], found.solved


def one(given, k):
    """One program, its rows in a single table."""
    own = jax.tree.map(lambda x: x[k], given)
    rows, bounds = own.rows[:SLOTS].reshape(-1, VARIABLES), own.bounds[:SLOTS].ravel()
    return own._replace(rows=rows, bounds=bounds)


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
        {"curvature": 1e-6},  # nearly linear, as with a small trust radius
        {"curvature": 1e4},
        {"alike": True},  # rows that depend on each other
        {"alike": True, "curvature": 1e-6, "penalty": 50.0},
        {"unused": 3},
    ],
)
def test_the_solution_meets_the_conditions_of_optimality(kind):
    given = programs(seed=3, **kind)
    d, t, multipliers, good = solved(given)
    assert np.all(good)
    scale = max(1.0, kind.get("penalty", 1.0), kind.get("curvature", 1.0))
    for k in range(BATCH):
        assert imbalance(one(given, k), d[k], t[k], multipliers[k]) < KEPT * scale, k
    assert np.any(t > given.least + KEPT)  # some limits cannot all be met, some can


def test_the_optimum_is_that_of_scipy():
    given = programs(seed=7)
    d, t, _, good = solved(given)
    assert np.all(good)
    for k in range(0, BATCH, 8):
        own = one(given, k)

        def value(x, own=own):
            return (
                0.5 * x[:-1] @ own.hessian @ x[:-1]
                + own.slope @ x[:-1]
                + own.penalty * x[-1]
                + (0.5 * own.stiffness * x[-1] ** 2)
            )

        room = {"type": "ineq", "fun": lambda x, own=own: own.bounds - own.rows @ x[:-1] + x[-1]}
        box = [*zip(own.low, own.high, strict=True), (own.least, None)]
        start = np.append(np.zeros(VARIABLES), 20.0)
        rival = scipy_minimize(value, start, method="SLSQP", bounds=box, constraints=[room], options={"ftol": 1e-14})
        assert value(np.append(d[k], t[k])) <= rival.fun + 1e-8 * (1 + abs(rival.fun))


def test_the_inverse_is_one_and_its_least_pivot_tells_definite_matrices():
    rng = np.random.default_rng(2)
    roots = rng.normal(size=(BATCH, VARIABLES, VARIABLES))
    matrices = roots + roots.transpose(0, 2, 1) + 6.0 * np.eye(VARIABLES)
    found, pivots = inverses(matrices)
    definite = np.linalg.eigvalsh(matrices).min(axis=1) > 0
    assert 0 < definite.sum() < BATCH
    np.testing.assert_array_equal(np.asarray(pivots) > 0, definite)
    np.testing.assert_allclose(found @ matrices, np.broadcast_to(np.eye(VARIABLES), matrices.shape), atol=1e-9)
