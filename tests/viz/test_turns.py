"""The turns of a drive, before and after a change."""

import numpy as np
import pytest

from qtraj.viz.report import page
from qtraj.viz.report.turns import turn_table, turns

from .drives import before_and_after, corners, dataset_of, drive


def paths(dataset):
    return {str(name): dataset.sel(path=name) for name in dataset["path"].values}


def test_turns_are_found_with_their_directions():
    [right, left] = turns(before_and_after().sel(path="before"))
    assert np.degrees([right.angle, left.angle]) == pytest.approx([-90.0, 60.0], abs=2.0)
    assert right.end < left.start


def test_their_radius_speed_and_acceleration_are_those_of_the_arcs():
    table = turn_table(paths(before_and_after()))
    assert [row[0] for row in table.rows] == ["1", "2"]
    assert [row[3].split()[1] for row in table.rows] == ["right", "left"]
    pairs = [[tuple(map(float, cell.split(" → "))) for cell in row[4:]] for row in table.rows]
    assert pairs[0] == [(12.0, 15.0), (8.0, 6.0), (pytest.approx(64 / 12, abs=0.01), 2.4)]
    assert pairs[1] == [(30.0, 30.0), (8.0, 6.0), (pytest.approx(64 / 30, abs=0.01), 1.2)]


def test_the_times_are_inside_the_turns_of_each_path():
    table = turn_table(paths(before_and_after()))
    (first, second), lengths = table.jumps, (12 * np.pi / 2, 15 * np.pi / 2)
    for path, speed, length in ((0, 8.0, lengths[0]), (1, 6.0, lengths[1])):
        assert speed * first[path] + 1e-6 >= 60.0
        assert speed * first[path] <= 60.0 + length
        assert 140.0 + length <= speed * second[path] + 1e-6
        assert speed * second[path] <= 140.0 + length + 10 * np.pi


def test_two_arcs_of_one_corner_are_one_turn_but_two_corners_are_two():
    quarter = 10 * np.pi / 4, np.pi / 4
    for gap, count in ((2.0, 1), (40.0, 2)):
        dataset = dataset_of({"path": drive([(50, 0), quarter, (gap, 0), quarter, (50, 0)], 5.0)})
        assert len(turns(dataset.isel(path=0))) == count


def test_a_gentle_bend_and_a_straight_line_are_no_turns():
    gentle = drive([(100, 0), (40, 0.2), (100, 0)], 5.0)
    assert turns(dataset_of({"path": gentle}).isel(path=0)) == []
    assert turns(dataset_of({"path": drive([(100, 0), (50, 0)], 5.0)}).isel(path=0)) == []


def test_the_scale_of_a_drive_does_not_matter():
    time, position, velocity, curvature = corners(12.0, 8.0)
    large = dataset_of({"path": (1e3 * time, 1e3 * position, velocity, 1e-3 * curvature)})
    assert [(t.start, t.end) for t in turns(large.isel(path=0))] == [
        (t.start, t.end) for t in turns(before_and_after().sel(path="before"))
    ]


def test_the_report_has_the_turns_and_the_lateral_distance():
    report = page.report_of(before_and_after())
    [table] = [table for table in report.tables if table.title == "Turns"]
    assert len(table.rows) == 2
    [panel] = [panel for panel in report.panels if panel.along]
    [line] = panel.series
    assert (panel.unit, line.body) == ("m", 1)
    corner = line.values[120:240]  # a wider right turn ends outside of the narrower one, on its left
    assert line.values[:100] == pytest.approx(0.0, abs=1e-9)
    assert corner[-1] == pytest.approx(3.0, abs=0.1)
    alone = page.report_of(before_and_after().sel(path=["before"]))
    assert not any(panel.along for panel in alone.panels)


def test_a_path_that_is_not_finite_has_no_turns():
    """A failed search may leave such a path; its report still is a page."""
    drives = before_and_after()
    drives["time"] = drives["time"].copy(data=np.where(drives["time"] > 20.0, np.nan, drives["time"]))
    assert turn_table(paths(drives)).rows == []
