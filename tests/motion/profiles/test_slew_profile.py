"""Motion profiles by name: the same as those of the classes, and the messages for mistakes."""

import jax
import numpy as np
import pytest

import qtraj as qt
from qtraj.motion.profiles.profile import is_fixed
from qtraj.motion.profiles.slew_profile import PROFILES

V, A, J, T = 0.3, 0.1, 0.2, 40.0


@pytest.mark.parametrize(
    ("kind", "arguments", "expected"),
    [
        ("time_optimal", {"max_acceleration": A}, qt.TimeOptimal(None, A)),
        ("time_optimal", {"max_rate": V, "max_acceleration": A, "duration": T}, qt.TimeOptimal(V, A, duration=T)),
        ("time_optimal", {"max_acceleration": A, "start_rate": 0.1, "end_rate": 0}, qt.TimeOptimal(None, A, 0.1, 0)),
        ("s_curve", {"max_rate": V, "max_acceleration": A, "max_jerk": J}, qt.SCurve(V, A, J)),
        ("s_curve", {"max_acceleration": A, "max_jerk": J, "duration": T}, qt.SCurve(None, A, J, T)),
        (
            "s_curve",
            {"max_acceleration": A, "max_jerk": J, "start_rate": 0.1, "end_acceleration": 0.05},
            qt.SCurve(None, A, J, start_rate=0.1, end_acceleration=0.05),
        ),
        ("cubic", {"max_acceleration": A}, qt.Cubic(max_acceleration=A)),
        ("quintic", {"duration": T, "max_rate": V, "max_jerk": J}, qt.Quintic(T, V, max_jerk=J)),
        ("septic", {"duration": T}, qt.Septic(T)),
    ],
)
def test_each_name_is_a_class(kind, arguments, expected):
    profile = qt.slew_profile(kind, **arguments)
    assert type(profile) is type(expected) is PROFILES[kind]
    for a, b in zip(jax.tree.leaves(profile), jax.tree.leaves(expected), strict=True):
        np.testing.assert_array_equal(a, b)
    assert is_fixed(profile) == bool({"duration", "start_rate", "end_rate"} & set(arguments))


@pytest.mark.parametrize(
    ("kind", "arguments", "message"),
    [
        ("linear", {}, r"one of 'time_optimal', .*'septic', but 'linear' was given"),
        ("time_optimal", {"duration": T}, "a slew of kind 'time_optimal' needs 'max_acceleration', which is missing"),
        ("s_curve", {"max_acceleration": A}, "a slew of kind 's_curve' needs 'max_jerk', which is missing"),
        ("time_optimal", {"max_acceleration": A, "max_jerk": J}, "discontinuous: use kind = 's_curve'"),
        ("cubic", {"max_jerk": J}, "discontinuous: use kind = 'quintic', 'septic' or 's_curve'"),
        (
            "quintic",
            {"duration": T, "end_rate": 0.1},
            "'end_rate' is valid only with kind = 'time_optimal' or 's_curve': a slew of kind 'quintic' starts",
        ),
        (
            "time_optimal",
            {"max_acceleration": A, "end_acceleration": 0.1},
            "'end_acceleration' is valid only with kind = 's_curve': .* 'time_optimal' has no acceleration at its ends",
        ),
        ("cubic", {}, "needs a duration or a limit: max_rate, max_acceleration$"),
        ("septic", {}, "needs a duration or a limit: max_rate, max_acceleration, max_jerk$"),
        ("quintic", {"max_rate": -1.0}, "max_rate must be positive"),
        (
            "time_optimal",
            {"max_rate": V, "max_acceleration": A, "start_rate": -0.5},
            r"\|start_rate\| must not exceed max_rate, but start_rate = -0.5 and max_rate = 0.3 were given",
        ),
    ],
)
def test_mistakes_are_explained(kind, arguments, message):
    with pytest.raises(ValueError, match=message):
        qt.slew_profile(kind, **arguments)


def test_slews_within_limits_satisfy_them():
    """For random limits, the peaks of every profile are at most the limits, and at least one limit is reached."""
    rng = np.random.default_rng(5)
    for kind in PROFILES:
        for angle in rng.uniform(0.1, 3.0, size=5):
            limits = {"max_rate": rng.uniform(0.1, 1), "max_acceleration": rng.uniform(0.1, 1)}
            limits |= {"max_jerk": rng.uniform(0.1, 1)} if kind in ("s_curve", "quintic", "septic") else {}
            profile = qt.slew_profile(kind, **limits).profile(angle)
            ratios = [profile.peak(order)[1] / bound for order, bound in enumerate(limits.values(), start=1)]
            assert max(ratios) == pytest.approx(1.0, rel=1e-9)
