"""Limits and obstacles against dense samples with 50 digits, fewer than `benchmarks.limits_against_sampling` checks."""

import mpmath
import numpy as np
import pytest
from benchmarks import limits_against_sampling as limits, obstacles_against_sampling as obstacles
from benchmarks.exact_motion import FLOATS, FORMULAS, Distances, Forms
from benchmarks.extremes import Span, largest

import qtraj as qt
from qtraj.path.quantity import quantity
from qtraj.path.sides import upper_side


@pytest.mark.parametrize("kind", limits.PATHS)
def test_formulas_are_those_of_evaluate(kind):
    """Two independent computations of the same motion, so that a wrong formula would not remain unnoticed."""
    path = limits.random_path(np.random.default_rng(4), kind)
    k = min(1, len(path.pieces) - 1)
    x = 0.3 * path.pieces[k].length
    u = sum(piece.length for piece in path.pieces[:k]) + x
    t = float(path.path.timing.times_of(np.array([u]))[0]) if kind == "timing" else u
    outputs = {name: quantity(upper_side(quantity(name))).variable for name in FORMULAS}
    table = qt.evaluate(path.path, [t], tuple(outputs.values()), vehicle=limits.CAR)
    forms = Forms(path.pieces[k].motion(np.array([x])), FLOATS)
    for name, formula in FORMULAS.items():
        np.testing.assert_allclose(formula(forms), table.values[outputs[name]], rtol=1e-9, atol=1e-11, err_msg=name)
    on = path.path.path if kind == "timing" else path.path
    assert Distances(path.pieces).length == pytest.approx(float(on.length()), rel=1e-9)


def test_the_largest_value_may_be_at_a_kink_between_samples():
    """The samples next to the kink are lower than the largest sample, which is at the smooth maximum."""

    def value(k, x, arithmetic):
        smooth, kink = -10 * (x - 0.75) ** 2, 1e-3 - 10 * abs(x - 300.5 / 1500)
        return np.maximum(smooth, kink) if arithmetic is FLOATS else max(smooth, kink)

    assert value(0, np.linspace(0.0, 1.0, 1501), FLOATS).argmax() > 750
    with mpmath.workdps(50):
        assert float(largest([Span(0, 0.0, 1.0)], value)) == pytest.approx(1e-3, abs=1e-12)


@pytest.mark.parametrize("kind", limits.KINDS)
@pytest.mark.parametrize("on", limits.PATHS)
def test_limits_beside_the_extremes_are_decided(kind, on):
    """Each case has limits that must be proved, others that must be violated, and some next to them."""
    rng = np.random.default_rng([limits.PATHS.index(on), limits.KINDS.index(kind), 3])
    checked, seen = 0, set()
    with mpmath.workdps(50):
        path = limits.random_path(rng, on)
        while checked < (1 if kind == "zones" else 2):
            make = limits.zones_case(rng, path) if kind == "zones" else limits.plain_case(rng, kind, path)
            if make is None:
                continue
            wrong, counts = limits.wrong_statuses(rng, make)
            assert not wrong
            seen |= set(counts)
            checked += 1
    assert {"proved", "broken"} <= seen


def test_a_wrong_status_would_be_noticed(monkeypatch):
    rng, certify = np.random.default_rng(0), qt.certify
    swapped = {"proved": "broken", "broken": "proved"}

    class Swapped:
        def __init__(self, found):
            self.status = {name: swapped[x] for name, x in found.status.items()}

    with mpmath.workdps(50):
        case = limits.plain_case(rng, "two sides", limits.random_path(rng, "helix"))
        assert case is not None
        monkeypatch.setattr(qt, "certify", lambda *x: Swapped(certify(*x)))
        assert len(limits.wrong_statuses(rng, case)[0]) >= 2 * len(case.sides)


def test_obstacles_beside_the_exact_distance_are_decided():
    assert obstacles.check(3, 4)[0] == []


@pytest.mark.slow
def test_many_limits_and_obstacles():
    assert limits.check_limits(1, 200)[0] == []
    assert obstacles.check(1, 60)[0] == []
