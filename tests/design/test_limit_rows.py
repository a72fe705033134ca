"""Findings on limits as rows of text."""

import numpy as np

import qtraj as qt
from qtraj.design.fitting.route_facts import fit_rows
from qtraj.design.proof.limit_rows import limit_change_rows, limit_rows, route_limit_rows, violation_texts
from qtraj.design.tuning.box import bounds_text

BEFORE = qt.Certificate(["curvature", "slope"], [2, 0], [1.0, 2.0], [0.12, 0.04], [0.1, 0.05])
AFTER = qt.Certificate(["curvature", "slope"], [0, 0], [1.5, 2.0], [0.1, 0.04], [0.1, 0.05])


def test_the_rows_name_the_limit_its_unit_and_its_status():
    rows = limit_rows(BEFORE.findings(), {"curvature": "12.5 %"})
    assert rows[0] == ("curvature [1/m]", "0.12", "0.1", "1", "12.5 %", "broken")
    assert rows[1][4:] == ("-", "proved")


def test_each_limit_has_a_row_before_and_a_row_after():
    curvature, slope = limit_change_rows(BEFORE, AFTER)
    assert curvature[0] == ("curvature", "before", "0.12", "0.1", "-0.02", "1", "broken")
    assert curvature[1] == ("[1/m]", "after", "0.1", "0.1", "active", "1.5", "proved")
    assert [row[4] for row in slope] == ["+0.01", "+0.01"]


def test_a_route_has_the_number_of_segments_and_the_intervals_of_violation():
    whole = qt.Certificate(["speed"], [2], [1.5], [6.0], [5.0])
    segments = qt.Certificate(["speed"], [[0], [2], [2]], [[0.5], [1.5], [2.5]], [[4.0], [6.0], [5.5]], [[5.0]] * 3)
    certificate = qt.RouteCertificate(whole, segments, [0.0, 1.0, 2.0], [[1.25, 3.0]], [0])
    assert route_limit_rows(certificate) == [("speed [m/s]", "6", "5", "1.5", "2", "broken")]
    assert violation_texts(certificate) == ["the limit on speed is violated at t [s] = 1.25-3.00"]


def test_bounds_are_described_with_their_units():
    bounds = {"duration": (4.0, 8.0), "end.V_h": (None, 0.5), "start.V_h": (-1.0, None)}
    assert bounds_text(bounds) == "duration from 4 to 8 s, end.V_h at most 0.5 m/s, start.V_h at least -1 m/s"
    assert bounds_text({}) == ""


def test_a_fit_has_a_warning_or_a_note_unless_it_is_good():
    path = qt.SpiralHelix([10.0, 0.5], [0.0, 0.4], [0.0, 1.0], 3.0)
    notes = {}
    for code in (qt.ResultCode.successful, qt.ResultCode.held_by_bounds, qt.ResultCode.loose_fit):
        fitted = qt.Fitted(
            path, qt.Residual(0.1, 0.1, 0.1, 0.3, 1.2, 21, None, None, 9.0, 11.0), np.int32(code), 7, [5.0, 50.0]
        )
        title, rows, notes[code] = fit_rows(fitted)
        assert title == "Fitted spiral-helix against the recording"
        assert dict(rows)["samples"] == "21 in 3.0 s"
    assert [text.partition(":")[0] for text in notes.values()] == ["", "Note", "Warning"]
