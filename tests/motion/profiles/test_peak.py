"""Exact peaks of profiles, compared with dense sampling and closed forms."""

import jax
import numpy as np
import pytest

from qtraj.motion.profiles.profile import Profile
from qtraj.motion.profiles.s_curve import SCurve
from qtraj.motion.profiles.smooth_step import Quintic, Septic
from qtraj.motion.profiles.time_optimal import TimeOptimal

DENSE = 20_001
ROUND_OFF = 1e-12
FLAT = 1e-10  # relative: a smooth peak decreases by more than this in two steps of sampling


def two_bumps():
    """Cubic pieces with interior extrema of both signs, which no motion profile makes."""
    return Profile(
        total=0.0,
        duration=3.0,
        starts=[0.0, 1.0],
        widths=[1.0, 2.0],
        pieces=[[0.0, 1.0, -4.0, 3.0], [0.0, 2.0, -9.0, 7.0]],
        end_rate=0.0,
        feasible=True,
        proportional=False,
    )


PROFILES = {
    "septic": lambda: Septic(max_rate=0.2).profile(-1.3),
    "quintic": lambda: Quintic(duration=5.0).profile(2.0),
    "s-curve": lambda: SCurve(0.4, 0.3, 0.5).profile(-2.0),
    "there and back": lambda: TimeOptimal(1.0, 1.0, start_rate=-0.5, end_rate=0.2).profile(-0.3),
    "two bumps": two_bumps,
}


@pytest.mark.parametrize("name", PROFILES)
def test_peaks_are_those_of_dense_sampling(name):
    profile = PROFILES[name]()
    times, step = np.linspace(0.0, float(profile.duration), DENSE, retstep=True)
    times = times[:-1]  # at the duration itself the slew has ended
    values = np.abs(jax.jit(jax.vmap(lambda t: profile.derivatives(t, 3)))(times))
    for order in range(4):
        when, largest = profile.peak(order)
        missed = 2 * step * profile.peak(order + 1)[1]
        assert np.all(values[:, order] <= largest * (1 + ROUND_OFF))
        near = np.abs(times - when) <= 2 * step
        assert values[near, order].max() >= largest * (1 - ROUND_OFF) - missed
        if order > 0 and largest > 0:  # the angle is too flat near its end
            assert np.all(values[times < when - 2 * step, order] < largest * (1 - FLAT))  # the first maximum


def test_peaks_of_a_septic_are_its_closed_form():
    profile = Septic(duration=4.0).profile(2.0)
    for order, expected in enumerate(Septic.peaks, start=1):
        assert profile.peak(order)[1] == pytest.approx(2.0 * expected / 4.0**order, rel=ROUND_OFF)
    assert profile.peak(1)[0] == pytest.approx(2.0)
    assert profile.peak(2)[0] == pytest.approx(4.0 * (0.5 - np.sqrt(0.05)))  # the first of two


def test_a_zero_angle_has_no_peak():
    assert [TimeOptimal(1.0, 1.0).profile(0.0).peak(k) for k in range(3)] == [(0.0, 0.0)] * 3


def test_the_peak_is_refused_inside_a_trace():
    with pytest.raises(ValueError, match="outside jit"):
        jax.jit(lambda angle: Quintic(duration=1.0).profile(angle).peak(1)[1])(1.0)
