"""Exact polynomials, claims with roots, and their decisions in integers and in bounded floats."""

from fractions import Fraction

import mpmath
import numpy as np
import pytest

from qtraj.algebra import bounded, subdivision
from qtraj.algebra.bounded import BoundedPolynomial
from qtraj.algebra.exact import ExactPolynomial
from qtraj.algebra.surd import Claim, Surd

DIGITS = 60
"""Digits in which claims with roots are evaluated for comparison."""


def value(p, u):
    return sum(Fraction(x) * u**k for k, x in enumerate(p.numbers)) * Fraction(2) ** p.exponent


def random_polynomial(rng, degree, scale=1.0):
    return ExactPolynomial.from_floats(scale * rng.normal(size=degree + 1) * 10.0 ** rng.integers(-3, 4, degree + 1))


def test_the_arithmetic_is_exact():
    rng = np.random.default_rng(1)
    u = Fraction(3, 7)
    for _ in range(50):
        p, q = random_polynomial(rng, 4), random_polynomial(rng, 3)
        assert value(p + q, u) == value(p, u) + value(q, u)
        assert value(p - q, u) == value(p, u) - value(q, u)
        assert value(p * q, u) == value(p, u) * value(q, u)
        assert value(2.5 - 3 * p, u) == Fraction(2.5) - 3 * value(p, u)
        assert value(p.substituted(0.3), u) == value(p, Fraction(0.3) * u)
        assert value(p.reflected(), u) == value(p, 1 - u)
        h = Fraction(1, 10**9)
        slope = (value(p, u + h) - value(p, u - h)) / (2 * h)
        assert float(value(p.derivative(), u)) == pytest.approx(float(slope), rel=1e-9, abs=1e-9)
        assert [Fraction(x) for x in ExactPolynomial.from_floats(p.floats()).floats()] == [*map(Fraction, p.floats())]


@pytest.mark.parametrize("bad", [np.inf, np.nan])
def test_coefficients_must_be_finite(bad):
    with pytest.raises((OverflowError, ValueError)):
        ExactPolynomial.from_floats([1.0, bad])


def test_integers_have_no_common_factor_two_and_keep_the_sign():
    p = ExactPolynomial([12, -18, 0, 0], -3)
    assert p.integers() == [6, -9]
    assert ExactPolynomial([0, 0]).integers() == [0]


def with_minimum(root, minimum):
    """(u − root)² + minimum, exactly."""
    return ExactPolynomial.from_floats([-root, 1.0]) * ExactPolynomial.from_floats([-root, 1.0]) + minimum


@pytest.mark.parametrize("root", [0.0, 0.25, 0.3, 0.731, 1.0])
@pytest.mark.parametrize("minimum", [1e-3, 1e-12, 1e-30])
def test_the_sign_of_a_minimum_is_decided(root, minimum):
    assert subdivision.decide(Claim(with_minimum(root, minimum))).proved
    below = subdivision.decide(Claim(with_minimum(root, -minimum)))
    assert below.refuted
    assert abs(below.at - root) <= minimum**0.5


def test_a_contact_is_proved_at_a_dyadic_point_and_undecided_elsewhere():
    assert subdivision.decide(Claim(with_minimum(0.25, 0.0))).proved
    strict = subdivision.decide(Claim(with_minimum(0.25, 0.0)), strict=True)
    assert strict.refuted
    assert strict.at == 0.25
    factor = ExactPolynomial([-1, 0, 8])
    touching = subdivision.decide(Claim(factor * factor))  # at the square root of 1/8
    assert (touching.proved, touching.refuted) == (False, False)
    assert touching.at == pytest.approx(8**-0.5, abs=1e-12)
    assert subdivision.decide(Claim(ExactPolynomial([0]))).proved


def surd(rng, kinds):
    """A random sum a + b√S + c√H + d√(SH) with positive S and H; `kinds` selects the terms that are not zero."""
    squares = []
    for _ in range(2):
        p = random_polynomial(rng, 2)
        squares.append(p * p + float(rng.uniform(0.01, 1.0)))
    terms = [random_polynomial(rng, 2) if kind else 0 for kind in kinds]
    return Surd(terms, tuple(squares))


def evaluated(number, u):
    def at(p):
        exact = Fraction(0) if isinstance(p, int) else value(p, u)
        return mpmath.mpf(exact.numerator) / exact.denominator

    with mpmath.workdps(DIGITS):
        S, H = (mpmath.sqrt(at(p)) for p in number.squares)
        a, b, c, d = map(at, number.terms)
        return a + b * S + c * H + d * S * H


@pytest.mark.parametrize("kinds", [(1, 1, 0, 0), (0, 1, 0, 0), (1, 0, 1, 0), (0, 0, 1, 1), (1, 1, 1, 0), (1, 1, 1, 1)])
def test_signs_of_sums_of_roots_agree_with_many_digits(kinds):
    """The claim is shifted so that its minimum on a grid is a little above or below zero."""
    rng = np.random.default_rng(sum(k << i for i, k in enumerate(kinds)))
    instants = [Fraction(k, 64) for k in range(65)]
    decided = 0
    for _ in range(12):
        number = surd(rng, kinds)
        lowest = min(evaluated(number, u) for u in instants)
        for margin in (1e-2, -1e-2):
            shifted = number + ExactPolynomial.of(float(-lowest) + margin * max(1.0, abs(float(lowest))))
            found = subdivision.decide(Claim(shifted))
            if found.proved:
                assert min(evaluated(shifted, u) for u in instants) >= 0
                assert margin > 0
            if found.refuted:
                assert evaluated(shifted, Fraction(found.at)) < 0
            decided += found.proved or found.refuted
    assert decided == 24


def as_floats(polynomials):
    """Bounded polynomials with the coefficients of exact ones, which are floats."""
    return BoundedPolynomial(np.array([p.floats() for p in polynomials]).T)


def require_within_bounds(found, exact):
    """Check that the errors of the coefficients of bounded polynomials are within their bounds."""
    bounds = bounded.SLACK * bounded.UNIT * found.k * found.m
    for k, true in enumerate(exact):
        errors = [
            abs(Fraction(x) * Fraction(2) ** true.exponent - Fraction(y))
            for x, y in zip(true.numbers, found.c[:, k].tolist(), strict=True)
        ]
        assert all(error <= Fraction(bound) for error, bound in zip(errors, bounds[:, k].tolist(), strict=True))


def test_the_bounds_of_floats_contain_the_exact_coefficients():
    rng = np.random.default_rng(2)
    for _ in range(20):
        exact = [[random_polynomial(rng, 3) for _ in range(5)] for _ in range(3)]
        a, b, c = map(as_floats, exact)
        result = (a * b - c) * (a + 2 * c) - b.derivative() * 3
        require_within_bounds(
            result, [(p * q - r) * (p + 2 * r) - q.derivative() * 3 for p, q, r in zip(*exact, strict=True)]
        )


def test_bounds_of_compositions_and_of_their_powers():
    rng = np.random.default_rng(8)
    roots = rng.uniform(3.4, 3.6, 5)  # near the values of `inner`, so the terms cancel
    outer = [ExactPolynomial.from_floats([c**4, -4 * c**3, 6 * c**2, -4 * c, 1.0]) for c in roots]
    inner = [ExactPolynomial.from_floats([3.0, x]) for x in rng.uniform(0.0, 0.1, 5)]
    found, true = (
        as_floats(outer).composed(as_floats(inner)),
        [p.composed(q) for p, q in zip(outer, inner, strict=True)],
    )
    require_within_bounds(found, true)
    near = found.consolidated()
    require_within_bounds(near, true)
    sixth, plain, power = near, found, true
    for _ in range(5):
        sixth, plain, power = sixth * near, plain * found, [p * q for p, q in zip(power, true, strict=True)]
    require_within_bounds(sixth, power)
    assert np.all(sixth.k * sixth.m[0] < 1e-6 * plain.k * plain.m[0])


@pytest.mark.parametrize("strict", [False, True])
def test_decisions_in_floats_never_contradict_integers(strict):
    rng = np.random.default_rng(3)
    exact, count = [], 400
    for _ in range(count):
        p = random_polynomial(rng, 3)
        exact.append(p * p + float(10.0 ** rng.uniform(-22, 2) * rng.choice([-1, 1])))
    coefficients = [[Fraction(x) * Fraction(2) ** p.exponent for x in p.numbers] for p in exact]
    floats = BoundedPolynomial(np.array([[float(x) for x in row] for row in coefficients]).T, k=1)
    found = bounded.decide(Claim(floats), count, strict)
    for k, p in enumerate(exact):
        decision = subdivision.decide(Claim(p), strict)
        assert not (found.proved[k] and decision.refuted)
        assert not (found.refuted[k] and decision.proved)
    assert np.count_nonzero(found.proved | found.refuted) > 0.5 * count


def test_overflow_is_not_decided():
    huge = BoundedPolynomial(np.full((3, 2), 1e200))
    with np.errstate(all="ignore"):
        found = bounded.decide(Claim(huge * huge), 2)
    assert not found.proved.any()
    assert not found.refuted.any()
