"""Flags of results inside and outside traces."""

import jax
import numpy as np
import pytest

import qtraj as qt

PATH = qt.SpiralHelix([20.0], [0.0, 0.3], [0.0, 0.5], 10.0)
START = qt.BoundaryState([20.0, 0.0, 0.0], [0.0, 5.0, 0.0])
END = qt.BoundaryState([0.0, 20.0, 3.0], [-5.0, 0.0, 0.0])

CALLS = {
    "tune": lambda c: qt.tune(START, END, qt.Limits(curvature=c)).converged,
    "retime": lambda c: qt.retime(PATH, qt.Limits(speed=c, acceleration=1.0)).converged,
    "certify": lambda c: qt.certify(PATH, qt.Limits(curvature=c)).holds,
    "certify, met": lambda c: qt.certify(PATH, qt.Limits(curvature=c)).met,
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_flags_are_available_in_jit(call):
    assert call(1.0) is True
    assert bool(jax.jit(call)(1.0)) is True


@pytest.mark.parametrize("name", ["certify", "certify, met"])
def test_flags_of_violated_limits(name):
    assert CALLS[name](0.04) is False
    assert bool(jax.jit(CALLS[name])(0.04)) is False


def test_flags_of_a_batch():
    good = jax.vmap(lambda c: qt.certify(PATH, qt.Limits(curvature=c)))(np.array([0.04, 1.0])).holds
    np.testing.assert_array_equal(good, [False, True])
