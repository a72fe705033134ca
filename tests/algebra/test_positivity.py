"""Sign proofs: never against the truth, and open only within rounding of zero."""

import itertools

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

from qtraj.algebra.bernstein import Bernstein, from_ascending
from qtraj.algebra.cells import minimum
from qtraj.algebra.extrema import greatest, least
from qtraj.algebra.positivity import NEGATIVE, OPEN, POSITIVE, positive

ROUNDING = 1e-13
"""Of values near one: what lies so near to zero may be left open."""

TOUCH = 0.3712345


@jax.jit
def judged(p):
    return positive(lambda p, low, high: p.on(low, high), p)


def exact_least(p):
    """The minimum on [0, 1] in 50 digits: the stationary points of float64, refined."""
    n = len(p) - 1
    with mpmath.workdps(50):
        c = [mpmath.mpf(float(x)) for x in p]

        def value(u, c=c):
            n = len(c) - 1
            return mpmath.fsum(x * mpmath.binomial(n, k) * u**k * (1 - u) ** (n - k) for k, x in enumerate(c))

        slope = [n * (b - a) for a, b in itertools.pairwise(c)]
        grid = [mpmath.mpf(k) / 400 for k in range(401)]
        signs = [value(u, slope) for u in grid]
        turns = [(a, b) for a, b, x, y in zip(grid[:-1], grid[1:], signs[:-1], signs[1:], strict=True) if x < 0 <= y]
        stationary = [mpmath.findroot(lambda u: value(u, slope), ab, solver="anderson") for ab in turns]
        return min(value(u) for u in [mpmath.mpf(0), mpmath.mpf(1), *stationary])


def touching(margin):
    """(u − TOUCH)² (2 − u) + margin: a double root moved off zero."""
    square = from_ascending(jnp.asarray([TOUCH**2, -2 * TOUCH, 1.0]))
    return square * from_ascending(jnp.asarray([2.0, -1.0])) + from_ascending(jnp.asarray([margin]))


@pytest.mark.parametrize(
    ("margin", "code"), [(1e-8, POSITIVE), (1e-12, POSITIVE), (0.0, OPEN), (-1e-12, NEGATIVE), (-1e-3, NEGATIVE)]
)
def test_a_touch_is_told_from_a_crossing_down_to_rounding(margin, code):
    answer = judged(touching(margin))
    assert answer.code == code
    assert answer.low <= margin + ROUNDING
    assert answer.at == pytest.approx(TOUCH, abs=1e-3)
    if margin >= 0:
        assert answer.low <= answer.high
        assert answer.high - answer.low < 1e-3 if margin == 0 else answer.high - answer.low <= ROUNDING


@pytest.mark.parametrize("degree", [2, 5, *(pytest.param(d, marks=pytest.mark.slow) for d in (9, 18))])
def test_no_answer_contradicts_the_exact_minimum(degree):
    rng = np.random.default_rng(degree)
    shifts = rng.choice([0.0, 1e-6, -1e-6, 0.3, -0.3], size=12)
    coefficients = rng.normal(size=(12, degree + 1))
    floors = [float(exact_least(c)) for c in coefficients]
    lifted = coefficients - np.array(floors)[:, None] + shifts[:, None]
    answers = jax.vmap(lambda c: judged(Bernstein(c, jnp.asarray(0.0))))(jnp.asarray(lifted))
    for c, low, high, code, at in zip(lifted, answers.low, answers.high, answers.code, answers.at, strict=True):
        truth = exact_least(c)
        assert float(low) <= truth
        assert truth <= float(high)
        assert code == (POSITIVE if truth > ROUNDING else NEGATIVE if truth < -ROUNDING else code)
        if code == NEGATIVE:
            assert Bernstein(jnp.asarray(c), jnp.asarray(0.0)).at(at)[0] < 0


def test_a_minimum_that_is_everywhere_is_left_open_and_not_searched_forever():
    assert judged(Bernstein(jnp.zeros(7), jnp.asarray(0.0))).code == OPEN
    assert judged(Bernstein(jnp.full(7, 1e-6), jnp.asarray(0.0))).code == POSITIVE
    assert judged(Bernstein(jnp.full(7, 1e-6), jnp.asarray(1e-5))).code == OPEN  # its own error is larger


def test_what_is_not_finite_is_left_open():
    assert judged(Bernstein(jnp.full(4, jnp.nan), jnp.asarray(0.0))).code == OPEN


@pytest.mark.parametrize("bad", [jnp.nan, jnp.inf, -jnp.inf])
@pytest.mark.parametrize("cell", [0.0, 0.375, 0.875])
def test_one_cell_that_overflowed_is_not_forgotten(bad, cell):
    """All the others are positive: the question must stay open."""

    def build(bad, low, high):
        there = (low <= cell) & (cell < high)
        return Bernstein(jnp.ones(4), jnp.where(there, jnp.abs(bad), 0.0)) * Bernstein(
            jnp.ones(1).at[0].set(jnp.where(there, bad, 1.0)), jnp.asarray(0.0)
        )

    assert positive(build, jnp.asarray(bad)).code == OPEN


@pytest.mark.parametrize("degree", [0, 1])
def test_low_degrees(degree):
    found = minimum(Bernstein(jnp.asarray([3.0, 2.0])[: degree + 1], jnp.asarray(0.0)))
    assert found.low <= 3.0 - degree <= found.high


def test_single_precision_knows_less():
    p = jax.tree.map(lambda x: x.astype(jnp.float32), touching(1e-8))
    loose = Bernstein(p.coefficients, p.error + jnp.asarray(1e-7, jnp.float32))
    assert judged(loose).code == OPEN
    lifted = jax.tree.map(lambda x: x.astype(jnp.float32), touching(1e-3))
    assert judged(lifted).code == POSITIVE


@pytest.mark.parametrize("degree", [0, 1, 2, 5, *(pytest.param(d, marks=pytest.mark.slow) for d in (9, 18))])
def test_extrema_are_enclosed_to_rounding(degree):
    rng = np.random.default_rng(degree)
    coefficients = rng.normal(size=(6, degree + 1)) * 10.0 ** rng.integers(-8, 8, (6, 1))
    both = jax.jit(
        jax.vmap(lambda c: (least(Bernstein(c, jnp.asarray(0.0))), greatest(Bernstein(c, jnp.asarray(0.0)))))
    )
    low, high = both(jnp.asarray(coefficients))
    for k, c in enumerate(coefficients):
        size = np.max(np.abs(c))
        smallest, largest = exact_least(c), -exact_least(-c)
        assert float(low.low[k]) <= smallest <= float(low.high[k])
        assert float(high.low[k]) <= largest <= float(high.high[k])
        assert float(low.high[k] - low.low[k]) < ROUNDING * size
        assert float(high.high[k] - high.low[k]) < ROUNDING * size
        value = float(Bernstein(jnp.asarray(c), jnp.asarray(0.0)).at(low.at[k])[0])
        assert value == pytest.approx(float(smallest), abs=ROUNDING * size)


def test_a_least_value_taken_everywhere_and_one_that_is_not_finite():
    flat = jax.jit(least)(Bernstein(jnp.full(7, 3.0), jnp.asarray(0.0)))
    assert flat.low <= 3.0 <= flat.high
    assert flat.high - flat.low < 1e-12
    unknown = jax.jit(least)(Bernstein(jnp.full(4, jnp.nan), jnp.asarray(0.0)))
    assert unknown.low == -jnp.inf
    assert unknown.high == jnp.inf
