"""Sign proofs: never against the truth, and open only within rounding of zero."""

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
"""Of values near one: what lies so near to zero may be left open."""

TOUCH = 0.3712345


@jax.jit
def judged(c, error=0.0):
    """Whether polynomials are positive on [−1, 1], from ascending coefficients (paths, k)."""
    c = jnp.asarray(c)
    p = cell_polynomial(c.T[None, :, None, :], jnp.full((1, c.shape[0]), error, c.dtype))
    return prove_positive(lambda *cell: p.on(*cell)[0], jnp.full(c.shape[0], 2.0))


def exact(c, s):
    return mpmath.fsum(mpmath.mpf(float(x)) * s**k for k, x in enumerate(c))


def exact_least(c):
    """The minimum on [−1, 1] in 50 digits: the stationary points, bracketed on a grid and refined."""
    with mpmath.workdps(50):
        slope = [k * mpmath.mpf(float(x)) for k, x in enumerate(c)][1:]
        bend = lambda s: mpmath.fsum(x * s**k for k, x in enumerate(slope))  # noqa: E731
        grid = [mpmath.mpf(k) / 200 - 1 for k in range(401)]
        signs = [bend(s) for s in grid]
        pairs = zip(itertools.pairwise(grid), itertools.pairwise(signs), strict=True)
        stationary = [mpmath.findroot(bend, ab, solver="anderson") for ab, (x, y) in pairs if x < 0 <= y]
        return min(exact(c, s) for s in [mpmath.mpf(-1), mpmath.mpf(1), *stationary])


def touching(margin):
    """(s − TOUCH)² (2 − s) + margin: a double root moved off zero."""
    cubic = np.polynomial.polynomial.polymul([TOUCH**2, -2 * TOUCH, 1.0], [2.0, -1.0])
    return cubic + margin * np.eye(4)[0]


@pytest.mark.parametrize(
    ("margin", "code"), [(1e-8, POSITIVE), (1e-12, POSITIVE), (0.0, UNDECIDED), (-1e-12, NEGATIVE), (-1e-3, NEGATIVE)]
)
def test_a_touch_is_told_from_a_crossing_down_to_rounding(margin, code):
    answer = jax.tree.map(lambda x: x[0], judged(touching(margin)[None]))
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
        c[0] += shift - float(exact_least(c))
    answers = judged(coefficients)
    for c, low, high, code, at in zip(coefficients, answers.low, answers.high, answers.code, answers.at, strict=True):
        truth = exact_least(c)
        if code != NEGATIVE:  # a search ends with the first value below zero
            assert float(low) <= truth
        assert truth <= float(high)
        assert code == (POSITIVE if truth > ROUNDING else NEGATIVE if truth < -ROUNDING else code)
        if code == NEGATIVE:
            assert exact(c, mpmath.mpf(float(at))) < 0


def test_a_minimum_that_is_everywhere_is_left_open_and_not_searched_forever():
    constants = np.zeros((2, 7))
    constants[1, 0] = 1e-6
    assert judged(constants).code.tolist() == [UNDECIDED, POSITIVE]
    assert judged(constants[1:], 1e-5).code.tolist() == [UNDECIDED]  # its own error is larger


@pytest.mark.parametrize("pieces", [1, 4])
@pytest.mark.parametrize("bad", [jnp.nan, jnp.inf, -jnp.inf])
@pytest.mark.parametrize("at", [0.0, 0.375, 0.875])
def test_one_cell_that_overflowed_is_not_forgotten(bad, at, pieces):
    """All the others are positive: the question must stay open."""

    def build(centre, half):
        there = (centre - half <= at) & (at < centre + half)
        ones = jnp.ones_like(centre)
        value = jnp.where(there, bad, ones)
        size = jnp.abs(value)
        return ChebyshevModel(jnp.stack([value] * NODES), size, 0.0 * ones, jnp.stack([size] * 3))

    assert prove_positive(build, jnp.full(1, 2.0 / pieces)).code.tolist() == [UNDECIDED]


@pytest.mark.parametrize("degree", [0, 1])
def test_low_degrees(degree):
    c = jnp.zeros((10, 1, 1)).at[: degree + 1, 0, 0].set(jnp.asarray([3.0, 2.0])[: degree + 1])
    found = enclose_minimum(c, jnp.zeros((1, 1)))
    assert found.low <= 3.0 - 2.0 * degree <= found.high


def test_paths_do_not_feel_their_neighbours():
    rng = np.random.default_rng(3)
    many = rng.normal(size=(16, 8))
    many[::3, 0] += 6.0
    together = judged(many)
    for k, row in enumerate(many):
        alone = judged(row[None])
        assert [float(x[0]) for x in jax.tree.leaves(alone)] == [float(x[k]) for x in jax.tree.leaves(together)]
