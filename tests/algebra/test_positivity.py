"""Sign proofs never contradict the exact minimum, and are undecided only within rounding of zero."""

import itertools

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

from qtraj.algebra.cell_polynomial import cell_polynomial
from qtraj.algebra.cells import enclose_minimum
from qtraj.algebra.chebyshev_model import NODES, ChebyshevModel
from qtraj.algebra.positivity import NEGATIVE, POSITIVE, UNDECIDED, prove_positive

ROUNDING = 1e-13
"""Functions of size one whose minimum is this close to zero may be undecided."""

TOUCH = 0.3712345


@jax.jit
def prove(c, error=0.0):
    """Prove that polynomials with ascending coefficients (paths, k) are positive on [−1, 1]."""
    c = jnp.asarray(c)
    p = cell_polynomial(c.T[None, :, None, :], jnp.full((1, c.shape[0]), error, c.dtype))
    return prove_positive(lambda *cell: p.on(*cell)[0], jnp.full(c.shape[0], 2.0))


def exact(c, s):
    return mpmath.fsum(mpmath.mpf(float(x)) * s**k for k, x in enumerate(c))


def exact_minimum(c):
    """The minimum on [−1, 1] in 50 digits: the stationary points, bracketed on a grid and refined."""
    with mpmath.workdps(50):
        slope = [k * mpmath.mpf(float(x)) for k, x in enumerate(c)][1:]
        derivative = lambda s: mpmath.fsum(x * s**k for k, x in enumerate(slope))  # noqa: E731
        grid = [mpmath.mpf(k) / 200 - 1 for k in range(401)]
        signs = [derivative(s) for s in grid]
        pairs = zip(itertools.pairwise(grid), itertools.pairwise(signs), strict=True)
        stationary = [mpmath.findroot(derivative, ab, solver="anderson") for ab, (x, y) in pairs if x < 0 <= y]
        return min(exact(c, s) for s in [mpmath.mpf(-1), mpmath.mpf(1), *stationary])


def touching(margin):
    """(s − TOUCH)² (2 − s) + margin: a double root moved off zero."""
    cubic = np.polynomial.polynomial.polymul([TOUCH**2, -2 * TOUCH, 1.0], [2.0, -1.0])
    return cubic + margin * np.eye(4)[0]


@pytest.mark.parametrize(
    ("margin", "code"), [(1e-8, POSITIVE), (1e-12, POSITIVE), (0.0, UNDECIDED), (-1e-12, NEGATIVE), (-1e-3, NEGATIVE)]
)
def test_a_double_root_is_distinguished_from_a_crossing_down_to_rounding(margin, code):
    answer = jax.tree.map(lambda x: x[0], prove(touching(margin)[None]))
    assert answer.code == code
    assert answer.low <= margin + ROUNDING
    assert answer.at == pytest.approx(TOUCH, abs=1e-3)
    if margin >= 0:
        assert answer.low <= answer.high
        assert answer.high - answer.low <= 3 * ROUNDING


@pytest.mark.parametrize("degree", [2, 5, *(pytest.param(d, marks=pytest.mark.slow) for d in (9, 18, 30))])
def test_no_answer_contradicts_the_exact_minimum(degree):
    rng = np.random.default_rng(degree)
    shifts = rng.choice([0.0, 1e-6, -1e-6, 0.3, -0.3], size=12)
    coefficients = rng.normal(size=(12, degree + 1))
    for c, shift in zip(coefficients, shifts, strict=True):
        c[0] += shift - float(exact_minimum(c))
    answers = prove(coefficients)
    for c, low, high, code, at in zip(coefficients, answers.low, answers.high, answers.code, answers.at, strict=True):
        truth = exact_minimum(c)
        if code != NEGATIVE:  # the search stops at the first value below zero
            assert float(low) <= truth
        assert truth <= float(high)
        assert code == (POSITIVE if truth > ROUNDING else NEGATIVE if truth < -ROUNDING else code)
        if code == NEGATIVE:
            assert exact(c, mpmath.mpf(float(at))) < 0


def test_a_constant_zero_is_undecided_after_finite_work():
    constants = np.zeros((2, 7))
    constants[1, 0] = 1e-6
    assert prove(constants).code.tolist() == [UNDECIDED, POSITIVE]
    assert prove(constants[1:], 1e-5).code.tolist() == [UNDECIDED]  # its own error is larger


@pytest.mark.parametrize("pieces", [1, 4])
@pytest.mark.parametrize("bad", [jnp.nan, jnp.inf, -jnp.inf])
@pytest.mark.parametrize("at", [0.0, 0.375, 0.875])
def test_an_overflow_in_one_cell_leaves_the_answer_undecided(bad, at, pieces):
    """Even though the function is positive in all other cells."""

    def build(centre, half):
        inside = (centre - half <= at) & (at < centre + half)
        ones = jnp.ones_like(centre)
        value = jnp.where(inside, bad, ones)
        size = jnp.abs(value)
        return ChebyshevModel(jnp.stack([value] * NODES), size, 0.0 * ones, jnp.stack([size] * 3))

    assert prove_positive(build, jnp.full(1, 2.0 / pieces)).code.tolist() == [UNDECIDED]


@pytest.mark.parametrize("degree", [0, 1])
def test_low_degrees(degree):
    c = jnp.zeros((10, 1, 1)).at[: degree + 1, 0, 0].set(jnp.asarray([3.0, 2.0])[: degree + 1])
    bounds = enclose_minimum(c, jnp.zeros((1, 1)))
    assert bounds.low <= 3.0 - 2.0 * degree <= bounds.high


def test_the_answer_for_a_path_does_not_depend_on_the_others():
    rng = np.random.default_rng(3)
    many = rng.normal(size=(16, 8))
    many[::3, 0] += 6.0
    together = prove(many)
    for k, row in enumerate(many):
        alone = prove(row[None])
        assert [float(x[0]) for x in jax.tree.leaves(alone)] == [float(x[k]) for x in jax.tree.leaves(together)]
