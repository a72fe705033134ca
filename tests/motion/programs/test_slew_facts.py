"""Facts about slews as text, with angles in degrees."""

import numpy as np

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


def test_rates_at_the_ends_are_a_discontinuity():
    assert end_rates_text(QUARTER.law) == end_rates_text(qt.Quintic(2.0)) == ""
    text = end_rates_text(qt.TimeOptimal(0.2, 0.1, end_rate=np.radians(3.0)))
    assert text.startswith("The slew ends at 3°/s, but the program is at rest before and after the slew")


def test_the_headers_name_columns_of_the_history():
    assert set(MOTION_HEADERS) <= set(qt.slew_history(QUARTER, [0.0, 1.0]).record().everything())
