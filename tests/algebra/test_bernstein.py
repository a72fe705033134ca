"""Bernstein forms: the error bounds contain the exact result, computed with fractions."""

from fractions import Fraction
from math import comb

import numpy as np
import pytest

from qtraj.algebra import bernstein

PATHS = 5
RNG = np.random.default_rng(11)


def polynomial(degree, scale=1.0):
    """Power coefficients (3, degree + 1, PATHS) of vectors, with very different magnitudes."""
    return scale * RNG.normal(size=(3, degree + 1, PATHS)) * 10.0 ** RNG.integers(-3, 4, size=(1, 1, PATHS))


def exact(c):
    return [Fraction(float(x)) for x in c]


def times(p, q):
    result = [Fraction(0)] * (len(p) + len(q) - 1)
    for i, a in enumerate(p):
        for j, b in enumerate(q):
            result[i + j] += a * b
    return result


def plus(p, q, factor=1):
    size = max(len(p), len(q))
    p, q = (x + [Fraction(0)] * (size - len(x)) for x in (p, q))
    return [a + factor * b for a, b in zip(p, q, strict=True)]


def dot(p, q):
    total = [Fraction(0)]
    for a, b in zip(p, q, strict=True):
        total = plus(total, times(a, b))
    return total


def cross(p, q):
    return [plus(times(p[j], q[k]), times(p[k], q[j]), -1) for j, k in ((1, 2), (2, 0), (0, 1))]


def coefficients(p, degree):
    """Exact Bernstein coefficients of a degree, from power coefficients."""
    p = p + [Fraction(0)] * (degree + 1 - len(p))
    return [sum(Fraction(comb(j, k), comb(degree, k)) * p[k] for k in range(j + 1)) for j in range(degree + 1)]


def test_sums_and_products_have_valid_bounds():
    """|r'×r''|², κ²(r'·r')³ − |r'×r''|² and others, as in the proofs."""
    v, a = polynomial(4), polynomial(3)
    p, q = bernstein.from_powers(v, 0), bernstein.from_powers(a, 0)
    c, s = p.cross(q), p @ p
    factor = np.full(PATHS, 0.7)
    found = {
        "square": c @ c,
        "component": c[2] * c[2],
        "level": p[:2] @ p[:2],
        "slack": (s * (s * s)).multiple(factor, np.zeros(PATHS)) - c @ c,
        "sum": s + 3 * (p @ q) - s.one(),
    }
    for path in range(PATHS):
        x, y = ([exact(w[k, :, path]) for k in range(3)] for w in (v, a))
        xy, xx = cross(x, y), dot(x, x)
        expected = {
            "square": dot(xy, xy),
            "component": times(xy[2], xy[2]),
            "level": dot(x[:2], x[:2]),
            "slack": plus([Fraction(0.7) * k for k in times(xx, times(xx, xx))], dot(xy, xy), -1),
            "sum": plus(plus(xx, dot(x, y), 3), [Fraction(1)], -1),
        }
        for name, polynomials in found.items():
            form = polynomials.form
            values = form.values[:, path]
            truth = coefficients(expected[name], len(values) - 1)
            errors = [abs(Fraction(float(b)) - t) for b, t in zip(values, truth, strict=True)]
            assert max(errors) <= Fraction(float(form.error[path])), name
            assert np.max(np.abs(values)) <= form.size[path]
            assert form.error[path] < 1e-11 * form.size[path] + 1e-9 * float(max(map(abs, truth)))


def test_lower_bounds_and_positivity():
    """(t − ½)² + d on [0, 1] has the Bernstein coefficients ¼ + d, −¼ + d and ¼ + d."""
    d = np.array([0.2, 0.3, -0.1, 1e-3])
    c = np.stack([0.25 + d, np.full(4, -1.0), np.ones(4)])
    form = bernstein.from_powers(c, 4).form
    np.testing.assert_allclose(form.lower, d - 0.25, atol=1e-14)
    assert form.positive.tolist() == [False, True, False, False]
    assert np.all(form.lower <= d - 0.25)


@pytest.mark.parametrize(("scale", "degree"), [(1e200, 4), (np.nan, 4), (1.0, 30)])
def test_without_a_bound_nothing_is_proved(scale, degree):
    """Overflow, NaN, and degrees whose binomial coefficients are not exact."""
    p = bernstein.from_powers(np.abs(polynomial(degree, scale)), 0)
    with np.errstate(all="ignore"):
        assert not ((p @ p) * (p @ p)).form.positive.any()
        assert not ((p @ p) * (p @ p) + p.one()).form.positive.any()
