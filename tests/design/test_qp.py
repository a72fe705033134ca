"""Elastic quadratic programs: the solutions satisfy the KKT conditions, which prove a convex optimum."""

import numpy as np
import pytest

from qtraj.design.tuning.qp import QP, cholesky, inverse_factor, minimise, solve

VARIABLES, CONSTRAINTS, BATCH = 5, 12, 64
TOLERANCE = 1e-6  # of numbers near one


def random_qps(seed, curvature=1.0, penalty=2.0, duplicates=False):
    """Random QPs; `curvature` scales the Hessian, `duplicates` makes half of the constraints copies of the others."""
    rng = np.random.default_rng(seed)
    roots = rng.normal(size=(VARIABLES, VARIABLES, BATCH))
    normals, values = rng.normal(size=(CONSTRAINTS, VARIABLES, BATCH)), -rng.normal(size=(CONSTRAINTS, BATCH))
    if duplicates:
        half = CONSTRAINTS // 2
        normals[half:], values[half:] = normals[:half], values[:half]
    return QP(
        hessian=curvature * (np.einsum("ikb,jkb->ijb", roots, roots) + 0.1 * np.eye(VARIABLES)[:, :, None]),
        gradient=rng.normal(size=(VARIABLES, BATCH)),
        normals=normals,
        values=values,
        low=-rng.uniform(0.1, 1.0, (VARIABLES, BATCH)),
        high=rng.uniform(0.1, 1.0, (VARIABLES, BATCH)),
        penalty=np.full(BATCH, penalty),
        stiffness=np.full(BATCH, min(1e-4, curvature)),
        lowest=np.where(np.arange(BATCH) % 2 == 0, 0.0, -1.0),
        tolerance=np.full(BATCH, 1e-13 * penalty),
    )


CASES = [{}, {"curvature": 1e-3}, {"curvature": 1e3}, {"penalty": 1e3}, {"duplicates": True}]


@pytest.mark.parametrize("case", CASES)
def test_solutions_satisfy_the_kkt_conditions(case):
    qp = random_qps(0, **case)
    with np.errstate(all="ignore"):
        d, t, multipliers = minimise(qp)
    at = np.einsum("kib,ib->kb", qp.normals, d) + qp.values
    assert np.all(at <= t + TOLERANCE)
    assert np.all((d >= qp.low - TOLERANCE) & (d <= qp.high + TOLERANCE))
    assert np.all(t >= qp.lowest - TOLERANCE)
    assert np.all(multipliers >= 0)
    scale = qp.penalty * max(1.0, case.get("curvature", 1.0))
    assert np.all(multipliers * (t - at) <= TOLERANCE * scale)
    slope = np.einsum("ijb,jb->ib", qp.hessian, d) + qp.gradient + np.einsum("kb,kib->ib", multipliers, qp.normals)
    assert np.all(np.where(d > qp.low + 1e-5, slope, 0.0) <= 1e-4 * scale)
    assert np.all(np.where(d < qp.high - 1e-5, slope, 0.0) >= -1e-4 * scale)
    rest = qp.penalty + qp.stiffness * t - multipliers.sum(axis=0)
    assert np.all(rest >= -1e-4 * scale)
    assert np.all(np.where(t > qp.lowest + 1e-4, rest, 0.0) <= 1e-4 * scale)


def test_a_program_without_constraints_within_reach_has_the_step_of_newton():
    qp = random_qps(1, curvature=30.0)
    qp = qp._replace(values=np.full_like(qp.values, -1e3), gradient=0.1 * qp.gradient)
    qp = qp._replace(low=np.full_like(qp.low, -1e2), high=np.full_like(qp.high, 1e2))
    d, t, multipliers = minimise(qp)
    expected = -solve(inverse_factor(qp.hessian), qp.gradient)
    np.testing.assert_allclose(d, expected, atol=1e-8)
    np.testing.assert_allclose(t, qp.lowest, atol=1e-6)
    assert np.all(multipliers < 1e-10)


def test_the_pivots_tell_whether_a_matrix_is_positive_definite():
    matrices = np.stack([np.eye(3), np.diag([1.0, -2.0, 3.0]), np.ones((3, 3))], axis=-1)
    least = cholesky(matrices)[1]
    assert least[0] == 1.0
    assert least[1] < 0
    assert abs(least[2]) < 1e-12
