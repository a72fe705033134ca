"""Bernstein forms against exact rational arithmetic: every coefficient lies within the bound that is stated for it."""

import itertools
import math
from fractions import Fraction

import jax.numpy as jnp
import numpy as np
import pytest

from qtraj.algebra.bernstein import Bernstein, constant, cross, dot, from_ascending, powers, stacked

TIGHT = 1e-12
"""A bound this much larger than the coefficients would prove nothing."""

DEGREES = [(0, 3), (3, 3), (6, 12), (18, 18)]


def form(seed, degree, *many):
    return Bernstein(jnp.asarray(np.random.default_rng(seed).normal(size=(*many, degree + 1))), jnp.asarray(0.0))


def exact(p):
    return [Fraction(float(c)) for c in p.coefficients]


def exact_product(p, q):
    m, n = len(p) - 1, len(q) - 1
    total = [Fraction(0)] * (m + n + 1)
    for i, a in enumerate(p):
        for j, b in enumerate(q):
            total[i + j] += Fraction(math.comb(m, i) * math.comb(n, j), math.comb(m + n, i + j)) * a * b
    return total


def exact_value(p, u):
    n = len(p) - 1
    return sum(c * math.comb(n, k) * u**k * (1 - u) ** (n - k) for k, c in enumerate(p))


def assert_enclosed(p, truth):
    """The exact coefficients lie within the bound, and the bound is worth having."""
    worst = max(abs(Fraction(float(c)) - t) for c, t in zip(p.coefficients, truth, strict=True))
    assert worst <= Fraction(float(p.error))
    assert float(p.error) <= TIGHT * max(float(max(map(abs, truth))), 1.0)


@pytest.mark.parametrize(("m", "n"), DEGREES)
def test_products_and_sums_stay_within_their_bounds(m, n):
    p, q = form(1, m), form(2, n)
    product = exact_product(exact(p), exact(q))
    assert_enclosed(p * q, product)
    one = [Fraction(1)]
    degree = max(m, n)
    lifted = [exact_product(exact(x), one * (degree - x.degree + 1)) for x in (p, q)]
    assert_enclosed(p + q, [a + b for a, b in zip(*lifted, strict=True)])
    assert_enclosed(p - q, [a - b for a, b in zip(*lifted, strict=True)])
    assert_enclosed(p.scaled(0.1), [Fraction(0.1) * a for a in exact(p)])


def test_an_inherited_error_is_passed_on():
    """Operands anywhere within their own errors: the product must still enclose the exact one."""
    rng = np.random.default_rng(3)
    p, q = form(4, 5), form(5, 4)
    loose = [Bernstein(x.coefficients, jnp.asarray(1e-3)) for x in (p, q)]
    moved = [[c + Fraction(1e-3 * rng.choice([-1.0, 1.0])) for c in exact(x)] for x in (p, q)]
    found = loose[0] * loose[1]
    for c, t in zip(found.coefficients, exact_product(*moved), strict=True):
        assert abs(Fraction(float(c)) - t) <= Fraction(float(found.error))
    assert float(found.error) < 0.05


@pytest.mark.parametrize("degree", [0, 1, 5, 18])
@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (0.25, 0.5), (1 - 2.0**-20, 1.0)])
def test_a_part_of_the_interval_takes_the_same_values(degree, low, high):
    p = form(6, degree)
    part = p.on(low, high)
    for u in (Fraction(0), Fraction(1, 3), Fraction(1)):
        there = exact_value(exact(p), Fraction(low) + u * (Fraction(high) - Fraction(low)))
        assert abs(exact_value(exact(part), u) - there) <= Fraction(float(part.error))
    assert float(part.error) <= TIGHT * float(p.size)


@pytest.mark.parametrize("degree", [0, 1, 6, 36])
@pytest.mark.parametrize("u", [0.0, 0.3, 1.0])
def test_values_and_slopes_stay_within_their_bounds(degree, u):
    p = form(7, degree)
    value, error = p.at(u)
    assert abs(Fraction(float(value)) - exact_value(exact(p), Fraction(u))) <= Fraction(float(error))
    assert float(error) <= TIGHT * float(p.size) * 10
    c = exact(p)
    assert_enclosed(p.derivative(), [degree * (b - a) for a, b in itertools.pairwise(c)] or [Fraction(0)])


def test_from_powers():
    a = np.array([0.3, -2.0, 5.0, 1.0 / 3.0])
    p = from_ascending(jnp.asarray(a))
    for u in (Fraction(0), Fraction(2, 7), Fraction(1)):
        truth = sum(Fraction(float(c)) * u**k for k, c in enumerate(a))
        assert abs(exact_value(exact(p), u) - truth) <= Fraction(float(p.error))
    assert float(p.error) < TIGHT


def test_powers_by_doubling():
    np.testing.assert_allclose(powers(jnp.asarray(0.7), 37), 0.7 ** np.arange(38), rtol=1e-14)
    assert powers(jnp.asarray(0.7), 0).shape == (1,)


def test_vectors_of_polynomials():
    """Dot and cross products take the values of those of the vectors, whatever the degrees of the components."""
    a, b = stacked(form(8, 2), form(9, 3), form(10, 0)), stacked(form(11, 4), form(12, 4), form(13, 1))
    u = 0.4
    x, y = (np.asarray(v.at(u)[0]) for v in (a, b))
    np.testing.assert_allclose(dot(a, b).at(u)[0], x @ y, atol=1e-13)
    np.testing.assert_allclose(cross(a, b).at(u)[0], np.cross(x, y), atol=1e-13)


def test_a_constant_times_a_polynomial_keeps_the_degree():
    p = form(14, 3) * constant(jnp.asarray(2.0))
    assert p.degree == 3
    np.testing.assert_allclose(p.coefficients, 2 * form(14, 3).coefficients)
