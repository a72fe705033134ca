"""Facts about slews as text, with angles in degrees."""

import numpy as np

import qtraj as qt
from qtraj.motion.programs.slew_facts import slew_fact_rows, slew_limit_rows, vector_text

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
