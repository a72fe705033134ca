"""Values that are computed in blocks of nodes or cells equal those that are computed at once."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from qtraj.design.timing import constraints, rounds
from qtraj.design.timing.constraints import Parts
from qtraj.design.timing.spline import ORDERS, Within, power_form
from qtraj.path import pieces

ROUNDING = 1e-12
"""Relative tolerance of values that differ only by rounding errors."""

LIMITS = {
    "speed": 3.0,
    "lateral_acceleration": 2.0,
    "longitudinal_acceleration": 1.5,
    "vertical_acceleration_max": 1.0,
    "yaw_acceleration": 0.4,
    "acceleration": 2.5,
    "jerk": 4.0,
}


@pytest.mark.parametrize("terms", [1, 2, 4, 6])
def test_derivatives_of_segments_in_blocks(terms):
    """They equal those of `values`, whose zero terms are not omitted."""
    rng = np.random.default_rng(terms)
    c = np.zeros((20, 6, 3))
    c[:, :terms] = rng.normal(size=(20, terms, 3))
    i, s = rng.integers(0, 20, (pieces.BLOCK_SIZE, 1)), rng.random((pieces.BLOCK_SIZE, 3))
    found = pieces.derivatives(c, i, s, 3)
    expected = pieces.values(c[i[:, 0], None], s, 3)[1:]
    np.testing.assert_allclose(found, np.moveaxis(np.stack(expected), -1, 1), rtol=ROUNDING, atol=100 * ROUNDING)


@pytest.mark.parametrize("stops", [False, True])
def test_constraints_in_blocks(stops, monkeypatch):
    """A node at rest counts relative to all blocks."""
    count = constraints.BLOCK_SIZE + 1000
    r = np.random.default_rng(0).normal(size=(3, 3, count))
    r[..., : constraints.BLOCK_SIZE] *= 1e-9  # at rest relative to the others
    if stops:
        r[0, :, [0, -1]] = 0.0
    before_stop = np.arange(count) > 5
    found = constraints.parts(r, np.ones(()), LIMITS, None, before_stop)
    monkeypatch.setattr(constraints, "BLOCK_SIZE", count)
    expected = constraints.parts(r, np.ones(()), LIMITS, None, before_stop)
    for name, x, y in zip(Parts._fields, found, expected, strict=True):
        assert (x is None) == (y is None)
        if x is not None:
            np.testing.assert_allclose(x, y, rtol=ROUNDING, atol=ROUNDING, err_msg=name)


def test_splines_within_unequal_cells():
    """Values and derivatives of a spline equal those of SciPy."""
    rng = np.random.default_rng(1)
    knots, coefficients = np.cumsum(rng.uniform(0.1, 2.0, 12)), rng.normal(size=14)
    found = Within(power_form(knots), np.diff(knots)).values(coefficients, 5, ORDERS)
    spline = BSpline(np.concatenate([knots[:1].repeat(3), knots, knots[-1:].repeat(3)]), coefficients, 3)
    places = knots[:-1] + np.linspace(0.0, 1.0, 5)[:, None] * np.diff(knots)
    for order in range(ORDERS):
        np.testing.assert_allclose(found[order, 1:-1], spline(places[1:-1], order), rtol=1e-9, atol=1e-9)


def test_limits_between_nodes_in_blocks(monkeypatch):
    """The largest values in cells do not depend on the blocks of cells."""
    cells, rng = 3 * rounds.COLUMNS // 2, np.random.default_rng(2)
    within = Within(power_form(np.arange(cells + 1.0)), np.ones(cells))
    r = rng.normal(size=(3, 3, rounds.CHECKED * cells))
    found = constraints.parts(r, np.ones(()), LIMITS)
    between = Parts(*(None if x is None else x.reshape(*x.shape[:-1], rounds.CHECKED, cells) for x in found))
    coefficients = rng.uniform(0.5, 1.5, cells + 3)
    found = rounds.between_nodes(between, within, coefficients)
    monkeypatch.setattr(rounds, "COLUMNS", cells)
    np.testing.assert_allclose(found, rounds.between_nodes(between, within, coefficients), rtol=ROUNDING)
