"""Elastic quadratic programs: the solutions satisfy the KKT conditions, which prove a convex optimum."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize as scipy_minimize

from qtraj.design.tuning.qp import QP, inverse, minimise

VARIABLES, SLOTS, PER_SLOT, BATCH = 5, 3, 11, 64
USED_SLOTS = 2  # the other slots are filled with invalid data
CONSTRAINTS = USED_SLOTS * PER_SLOT
TOLERANCE = 1e-8  # of numbers near one

LOOSE_TOLERANCE = 1e-5  # for Hessians with a large condition number

solve = jax.jit(lambda qps: minimise(qps, jnp.uint32(USED_SLOTS)))


def random_qps(seed, curvature=1.0, penalty=2.0, duplicates=False):
    """Random QPs; `curvature` scales the Hessian, `duplicates` makes half of the constraints copies of the others."""
    rng = np.random.default_rng(seed)
    roots = rng.normal(size=(BATCH, VARIABLES, VARIABLES))
    normals, bounds = rng.normal(size=(BATCH, SLOTS, PER_SLOT, VARIABLES)), rng.normal(size=(BATCH, SLOTS, PER_SLOT))
    if duplicates:
        normals[:, 1], bounds[:, 1] = normals[:, 0], bounds[:, 0]
    bounds[:, USED_SLOTS:] = -1e6
    hessian = curvature * (roots @ roots.transpose(0, 2, 1) + 0.1 * np.eye(VARIABLES))
    return QP(
        hessian=hessian,
        inverse=np.linalg.inv(hessian),
        gradient=rng.normal(size=(BATCH, VARIABLES)),
        normals=normals,
        bounds=bounds,
        low=-rng.uniform(0.0, 1.0, (BATCH, VARIABLES)),
        high=rng.uniform(0.0, 1.0, (BATCH, VARIABLES)),
        penalty=np.full(BATCH, penalty),
        stiffness=np.full(BATCH, min(1e-4, curvature)),
        min_violation=-rng.uniform(0.0, 1.0, BATCH),
    )


def constraints(qp):
    """The constraints of the slots in use, and their bounds."""
    return qp.normals[:USED_SLOTS].reshape(CONSTRAINTS, VARIABLES), qp.bounds[:USED_SLOTS].reshape(CONSTRAINTS)


def solve_batch(qps):
    """d, t, the multipliers of the constraints, and whether each QP is solved."""
    solution = jax.tree.map(np.asarray, solve(jax.tree.map(jnp.asarray, qps)))
    multipliers = np.zeros((BATCH, CONSTRAINTS))
    element, place = np.nonzero(solution.active.used & (solution.active.constraint < CONSTRAINTS))
    multipliers[element, solution.active.constraint[element, place]] = solution.active.multiplier[element, place]
    return solution.d, solution.t, multipliers, solution.solved


def kkt_residual(qp, d, t, multipliers, tolerance=TOLERANCE):
    """The largest violation of the KKT conditions, by their definition."""
    normals, bounds = constraints(qp)
    slack = bounds - normals @ d + t
    gradient = qp.hessian @ d + qp.gradient + multipliers @ normals
    gradient_t = qp.penalty + qp.stiffness * t - multipliers.sum()
    at_low, at_high = d <= qp.low + tolerance, d >= qp.high - tolerance
    stationarity = np.where(
        at_low, np.maximum(-gradient, 0.0), np.where(at_high, np.maximum(gradient, 0.0), np.abs(gradient))
    )
    stationarity = np.where(at_low & at_high, 0.0, stationarity)
    return max(
        np.max(-slack, initial=0.0),
        np.max(qp.low - d, initial=0.0),
        np.max(d - qp.high, initial=0.0),
        qp.min_violation - t,
        np.max(-multipliers),
        np.max(np.abs(multipliers * slack)),
        np.max(stationarity),
        -gradient_t if t <= qp.min_violation + tolerance else abs(gradient_t),
    )


@pytest.mark.parametrize(
    "kind",
    [
        {},
        {"penalty": 1e3},
        {"curvature": 1e-6},  # nearly linear, as with a small trust radius
        {"curvature": 1e4},
        {"duplicates": True},  # linearly dependent constraints
        {"duplicates": True, "curvature": 1e-6, "penalty": 50.0},
    ],
)
def test_the_solution_satisfies_the_kkt_conditions(kind):
    qps = random_qps(seed=3, **kind)
    d, t, multipliers, is_solved = solve_batch(qps)
    assert np.all(is_solved)
    scale = max(1.0, kind.get("penalty", 1.0), kind.get("curvature", 1.0))
    for k in range(BATCH):
        one = jax.tree.map(lambda x, k=k: x[k], qps)
        assert kkt_residual(one, d[k], t[k], multipliers[k]) < TOLERANCE * scale, k
    assert np.any(t > qps.min_violation + TOLERANCE)  # some of the QPs are infeasible


@pytest.mark.parametrize("condition", [1e6, 1e8, 1e10, 1e14])
def test_an_ill_conditioned_qp_is_solved_or_reported(condition):
    """Hessians with random axes and a large condition number."""
    qps = random_qps(seed=7)
    axes = np.linalg.qr(np.random.default_rng(8).normal(size=(BATCH, VARIABLES, VARIABLES)))[0]
    curvatures = np.geomspace(1.0, 1 / condition, VARIABLES)
    qps = qps._replace(
        hessian=(axes * curvatures) @ axes.transpose(0, 2, 1), inverse=(axes / curvatures) @ axes.transpose(0, 2, 1)
    )
    d, t, multipliers, is_solved = solve_batch(qps)
    assert np.mean(is_solved) > 0.9 or condition > 1e6
    for k in np.flatnonzero(is_solved):
        one = jax.tree.map(lambda x, k=k: x[k], qps)
        assert kkt_residual(one, d[k], t[k], multipliers[k], LOOSE_TOLERANCE) < LOOSE_TOLERANCE, k


def test_a_fixed_variable_does_not_move():
    qps = random_qps(seed=4)
    qps.low[:, 2] = qps.high[:, 2] = 0.0
    d = solve(jax.tree.map(jnp.asarray, qps)).d
    np.testing.assert_allclose(d[:, 2], 0.0, atol=TOLERANCE)


def test_scipy_finds_no_lower_value():
    qps = random_qps(seed=5)
    solution = jax.tree.map(np.asarray, solve(jax.tree.map(jnp.asarray, qps)))
    d, t, qps = solution.d[0], solution.t[0], jax.tree.map(lambda x: x[0], qps)
    normals, limits = constraints(qps)

    def value(x):
        d, t = x[:-1], x[-1]
        return 0.5 * d @ qps.hessian @ d + qps.gradient @ d + 0.5 * qps.stiffness * t**2 + qps.penalty * t

    solution = scipy_minimize(
        value,
        np.append(np.zeros(VARIABLES), 5.0),
        bounds=[*zip(qps.low, qps.high, strict=True), (qps.min_violation, None)],
        constraints={"type": "ineq", "fun": lambda x: limits - normals @ x[:-1] + x[-1]},
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 500},
    )
    assert value(np.append(d, t)) == pytest.approx(solution.fun, abs=1e-7)


def test_the_smallest_pivot_is_positive_for_positive_definite_matrices_only():
    rng = np.random.default_rng(6)
    root = rng.normal(size=(6, 6))
    matrix = root @ root.T
    solution, pivot = inverse(jnp.asarray(matrix))
    np.testing.assert_allclose(solution @ matrix, np.eye(6), atol=1e-10)
    assert pivot > 0
    lowest = np.linalg.eigvalsh(matrix)[0]
    assert inverse(jnp.asarray(matrix - 1.01 * lowest * np.eye(6)))[1] < 0
