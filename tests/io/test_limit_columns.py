"""Limits in the columns of recordings: units, missing values, and messages."""

import numpy as np
import pytest

from qtraj.io.track.limit_columns import LimitColumn
from qtraj.io.track.track_file import read_recording

CELLS = ["50", "50", "", "30", "30", "nan"]


def write(tmp_path, header="limit", cells=CELLS, times=None):
    times = range(len(cells)) if times is None else times
    rows = [f"{t},{10 * t},0,0,{cell}" for t, cell in zip(times, cells, strict=True)]
    (tmp_path / "drive.csv").write_text("\n".join([f"t,x,y,z,{header}", *rows]))
    return tmp_path / "drive.csv"


@pytest.mark.parametrize(
    ("header", "column", "limit", "factor", "unit"),
    [
        ("limit", LimitColumn("limit"), "speed", 1.0, "m/s"),
        ("limit [km/h]", LimitColumn("limit"), "speed", 1 / 3.6, "km/h"),
        ("limit_kmh", LimitColumn("limit_kmh"), "speed", 1 / 3.6, "km/h"),
        ("Max Speed (mph)", LimitColumn("max_speed"), "speed", 0.44704, "mph"),
        ("limit_ms", LimitColumn("limit_ms"), "speed", 1.0, "m/s"),
        ("maxspeed", LimitColumn("maxspeed", "km/h"), "speed", 1 / 3.6, "km/h"),
        ("comfort [m/s^2]", LimitColumn("comfort"), "lateral_acceleration", 1.0, "m/s²"),
        ("turn [deg/s]", LimitColumn("turn"), "yaw_rate", np.pi / 180, "deg/s"),
        ("tilt [deg]", LimitColumn("tilt"), "tilt", np.pi / 180, "deg"),
    ],
)
def test_values_are_in_si_units(tmp_path, header, column, limit, factor, unit):
    recording = read_recording(write(tmp_path, header), limits={limit: column})
    found = recording.limits[limit]
    np.testing.assert_allclose(found.values, factor * np.array([50, 50, np.nan, 30, 30, np.nan]), rtol=1e-12)
    assert found.times.tolist() == [0, 1, 2, 3, 4, 5]
    assert f"limit on {limit}: {header}, {unit}" in recording.facts[2]
    assert recording.facts[3].endswith("left out: nothing")


def test_a_segment_has_its_own_limits(tmp_path):
    times = [0, 1, 2, 3, 0, 1, 2, 3]
    file = write(tmp_path, cells=["1", "2", "3", "4", "5", "6", "7", "8"], times=times)
    found = read_recording(file, segment=2, limits={"speed": LimitColumn("limit")}).limits["speed"]
    assert (found.times.tolist(), found.values.tolist()) == ([0, 1, 2, 3], [5, 6, 7, 8])


@pytest.mark.parametrize(
    ("header", "cells", "column", "limit", "text"),
    [
        ("limit", CELLS, LimitColumn("limits"), "speed", "no column 'limits' for the limit speed"),
        ("limit [km/h]", CELLS, LimitColumn("limit"), "curvature", "is in km/h, but the limit curvature must be in"),
        ("limit [g]", CELLS, LimitColumn("limit"), "acceleration", "is in g, but the limit acceleration"),
        ("limit", CELLS, LimitColumn("limit", "furlong"), "speed", "is in furlong"),
        ("limit", ["5", "5", "x", "5", "5"], LimitColumn("limit"), "speed", "line 4: .* contains 'x'"),
        ("limit", ["5", "5", "5", "0", "5"], LimitColumn("limit"), "speed", "line 5: .* positive"),
        ("limit", ["5", "5", "5", "inf", "5"], LimitColumn("limit"), "speed", "line 5: .* finite"),
    ],
)
def test_bad_columns_are_named(tmp_path, header, cells, column, limit, text):
    with pytest.raises(ValueError, match=text):
        read_recording(write(tmp_path, header, cells), limits={limit: column})
