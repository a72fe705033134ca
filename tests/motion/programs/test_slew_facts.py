"""Facts about slews as text, with angles in degrees."""

import dataclasses

import numpy as np
import pytest

import qtraj as qt
from qtraj.motion.programs.slew_facts import (
    MOTION_HEADERS,
    end_rates_text,
    end_texts,
    slew_fact_rows,
    slew_limit_rows,
    vector_text,
)

QUARTER = qt.EulerTurn([1.0, 0.0, 0.0, 0.0], [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)], qt.TimeOptimal(0.2, 0.1))


def test_a_slew_and_its_limits():
    verdict = qt.judge_slew(QUARTER)
    rows = dict(slew_fact_rows(verdict, 0))
    assert rows["angle"] == "90.0000°"
    assert rows["axis, body"] == "(0.000000, 0.000000, 1.000000)"
    assert "from" not in rows  # the slew starts at t = 0
    name, peak, limit, margin, _, unit, status = slew_limit_rows(verdict)[0]
    assert (name, peak, limit, margin, unit, status) == ("rate", "11.4592", "11.4592", "0", "°/s", "active")


def test_vectors_as_text():
    assert vector_text([0.0, -0.0, 1 / 3]) == "(0.000000, 0.000000, 0.333333)"
    assert vector_text([np.nan, 0.0, 1.0]) == "-"


def test_the_end_is_explained_if_its_sign_is_not_as_requested():
    slow = qt.EulerTurn(QUARTER.start_q, QUARTER.end_q, qt.Quintic(60.0))
    [fastest] = end_texts(qt.judge_slew(slow, {"max_rate": 0.2}))
    assert fastest.startswith("The fastest slew within the limits takes ")
    opposite = qt.judge_slew(QUARTER, end=[-np.sqrt(0.5), 0.0, 0.0, -np.sqrt(0.5)])
    assert "the specified quaternion with the opposite sign" in end_texts(opposite)[0]


def slew_about_z(degrees, law):
    half = np.radians(degrees) / 2
    return qt.EulerTurn([1.0, 0.0, 0.0, 0.0], [np.cos(half), 0.0, 0.0, np.sin(half)], law)


@pytest.mark.parametrize(
    ("rate", "beyond"),
    [(10.0, 45.0), (-10.0, 50.0), (3.0, 0.0), (4.0, 3.0), (0.0, 0.0)],  # v²/2a beyond the start, or minus the angle
)
def test_a_start_rate_that_overshoots_is_said(rate, beyond):
    law = qt.TimeOptimal(None, np.radians(1.0), start_rate=np.radians(rate))
    verdict = qt.judge_slew(slew_about_z(5.0, law))
    np.testing.assert_allclose(np.degrees(verdict.overshoots), [beyond], atol=1e-9)
    said = f"The slew of 5° goes {beyond:g}° beyond its ends and returns" in verdict.result
    assert said == (beyond > 0)
    np.testing.assert_array_equal(verdict.record().variables["overshoot"].values, verdict.overshoots)


J = (5.0, 4.0, 3.0)


@pytest.mark.parametrize(
    ("law", "limits", "torque", "text"),
    [
        (qt.TimeOptimal(None, np.radians(1.0), duration=600.0), None, 0.01, "With max_acceleration = 0.00333333, the"),
        (qt.TimeOptimal(0.2, 0.2, duration=100.0), {"max_acceleration": 0.05}, None, "With max_acceleration = 0.05, "),
        (qt.SCurve(None, 0.5, 0.5, duration=5.0), None, 0.01, "Increase the duration to "),
        (qt.Quintic(duration=5.0), {"max_rate": 0.01}, 0.01, "Increase the duration to "),
        (qt.TimeOptimal(None, 0.5, start_rate=0.01), None, 0.01, "Without start_rate and end_rate, the slew takes "),
        (
            qt.SCurve(None, 0.5, 0.5, start_acceleration=0.01),
            None,
            0.01,
            "Without rates and accelerations at its ends, the slew takes ",
        ),
        (qt.Quintic(max_rate=0.1), {"max_rate": 0.01}, None, "With these limits in its profile, the slew takes "),
    ],
)
def test_advice_holds(law, limits, torque, text):
    inertia = None if torque is None else J
    slew = slew_about_z(5.0, law)
    verdict = qt.judge_slew(slew, limits, inertia, torque)
    assert not verdict.met
    assert text in verdict.advice
    assert "raise the limits" not in verdict.result
    number = float(verdict.advice.split(text.rstrip("0123456789., the"))[-1].strip(" =").split()[0].rstrip(","))
    if text.startswith("With max_acceleration"):
        law = dataclasses.replace(law, max_acceleration=number)
    elif text.startswith("Increase"):
        law = dataclasses.replace(law, duration=number)
        if isinstance(law, qt.SCurve):  # the profile of a fixed duration is accelerated less
            law = qt.within_torque(slew_about_z(5.0, law), J, torque).law
    else:
        return
    assert qt.judge_slew(slew_about_z(5.0, law), limits, inertia, torque).met


def test_there_is_no_advice_that_does_not_help():
    """A longer duration alone does not reduce the acceleration of the profile."""
    slew = slew_about_z(60.0, qt.TimeOptimal(0.1, 0.1, duration=14.0))
    verdict = qt.judge_slew(slew, {"max_acceleration": 0.02})
    assert not verdict.met
    assert verdict.advice == ""


def test_rates_at_the_ends_are_a_discontinuity():
    assert end_rates_text(QUARTER.law) == end_rates_text(qt.Quintic(2.0)) == ""
    text = end_rates_text(qt.TimeOptimal(0.2, 0.1, end_rate=np.radians(3.0)))
    assert text.startswith("The slew ends at 3°/s, but the program is at rest before and after the slew")
    text = end_rates_text(qt.SCurve(0.2, 0.1, 0.1, start_acceleration=-np.radians(2.0)))
    assert text.startswith("The slew starts at -2°/s², but")
    assert text.endswith("so the commanded acceleration is discontinuous.")


def test_an_overshoot_of_an_s_curve_is_said():
    law = qt.SCurve(None, 9.0, 1.0, start_rate=0.5, end_rate=-0.5)  # from rest beyond the end back to it in 1 s
    verdict = qt.judge_slew(slew_about_z(10.0, law))
    np.testing.assert_allclose(verdict.overshoots, [1 / 2 - 1 / 6], rtol=1e-12)
    assert "because its limits do not allow faster changes of the rates" in verdict.result


def test_limits_that_forbid_an_end_rate_have_no_minimum_duration():
    law = qt.SCurve(0.2, 0.1, 0.1, 20.0, end_rate=0.1)
    verdict = qt.judge_slew(slew_about_z(60.0, law), {"max_rate": 0.05})
    assert np.isnan(verdict.least_duration)
    assert not verdict.met


def test_the_headers_name_columns_of_the_history():
    assert set(MOTION_HEADERS) <= set(qt.slew_history(QUARTER, [0.0, 1.0]).record().everything())
