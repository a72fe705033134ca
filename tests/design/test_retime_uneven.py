"""Retiming of a route whose parameter slows down, with a limit on the jerk and free speeds at the ends."""

import functools

import numpy as np
import pytest

import qtraj as qt


def _wave(slowing, count=60):
    """Return points on a wave; the parameter slows to exp(−2·`slowing`) in the middle, and its jerk jumps at joints."""
    t = np.linspace(0.0, 1.0, count)
    fine = np.linspace(0.0, 1.0, 4001)
    pace = np.exp(slowing * np.cos(2 * np.pi * fine))
    whole = np.concatenate([[0.0], np.cumsum(0.5 * (pace[1:] + pace[:-1]) * np.diff(fine))])
    scale = 60.0 / whole[-1]
    s, s1 = scale * np.interp(t, fine, whole), scale * np.exp(slowing * np.cos(2 * np.pi * t))
    s2 = -slowing * 2 * np.pi * np.sin(2 * np.pi * t) * s1
    k, zero = 0.15, 0 * s
    shape = np.stack([s, 3 * np.sin(k * s), zero], axis=1)
    first = np.stack([zero + 1, 3 * k * np.cos(k * s), zero], axis=1)
    second = np.stack([zero, -3 * k**2 * np.sin(k * s), zero], axis=1)
    velocity = first * s1[:, None]
    return qt.Route(20.0 * t, shape, velocity / 20, (second * s1[:, None] ** 2 + first * s2[:, None]) / 400)


LIMITS = qt.Limits(speed=4.0, lateral_acceleration=1.5, longitudinal_acceleration=0.9, jerk=0.6)


@functools.cache
def even(tolerance):
    """The timing of the wave with an even parameter."""
    return qt.retime(_wave(0.0), LIMITS, tolerance=tolerance)


@pytest.mark.parametrize("slowing", [1.5, 2.5])
def test_slow_parameters_do_not_cost_time_with_a_jerk_limit(slowing):
    """The fastest timing of the shape does not depend on its parameter; a jump of r''' counts where it is."""
    slow = qt.retime(_wave(slowing), LIMITS)
    assert even(1e-3).code == slow.code == 0, (even(1e-3), slow)
    assert slow.gap <= 1e-3
    assert float(slow.duration) == pytest.approx(float(even(1e-3).duration), rel=5e-3)


def test_a_result_far_from_the_minimum_is_not_called_converged(monkeypatch):
    """Without refinement, the gap exceeds the tolerance, and code and text say so."""
    monkeypatch.setattr("qtraj.design.timing.adaptive.ATTEMPTS", 0)
    timed = qt.retime(_wave(2.5), LIMITS)
    assert timed.gap > 0.01
    assert timed.code == qt.ResultCode.not_converged
    assert "may be up to" in timed.explain(())


@pytest.mark.parametrize(("slowing", "tolerance"), [(1.5, 1e-2), (1.5, 1e-3), (2.5, 1e-3), (3.5, 1e-3)])
def test_the_gap_is_not_smaller_than_the_distance_to_the_minimum(slowing, tolerance):
    """With the slowest parameter, smaller cells gain ever more time, so the search ends and says that it failed."""
    least = float(even(1e-4).duration)
    timed = qt.retime(_wave(slowing), LIMITS, tolerance=tolerance)
    assert timed.certificate.holds
    assert float(timed.duration) * (1 - float(timed.gap)) <= least * (1 + 1e-4)
    assert (timed.code == qt.ResultCode.not_converged) == (slowing > 3)
