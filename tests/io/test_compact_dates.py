"""Dates and times of day of digits alone, in one column or in two."""

import numpy as np
import pandas as pd
import pytest

from qtraj.io.track.track_file import read_track

CLOCKS = [90058 + k for k in (0, 1)] + [90100 + k for k in range(8)]  # over a full minute
SECONDS = np.arange(10.0)


def table(tmp_path, header, cells):
    file = tmp_path / "log.csv"
    rows = [f"{cell},{3 * t},{t * t},0" for cell, t in zip(cells, SECONDS, strict=True)]
    file.write_text("\n".join([f"{header},x,y,z", *rows]))
    return file


@pytest.mark.parametrize(
    "form",
    [
        *("20260506,{:d}", "20260506,{:06d}", "20260506,{:06d}.000", "20260506.0,{:d}.0"),
        *("2026-05-06,{:06d}", "2026/05/06,{:d}", "06.05.2026,{:06d}"),
    ],
)
@pytest.mark.parametrize("columns", [None, {"time": ["date", "time"]}])
def test_two_columns_are_combined(tmp_path, form, columns):
    track = read_track(table(tmp_path, "date,time", map(form.format, CLOCKS)), columns=columns)
    np.testing.assert_array_equal(track.times, SECONDS)


def test_a_time_of_day_with_colons_may_follow_a_date_of_digits(tmp_path):
    cells = [f"20260506,09:{c // 100 % 100:02d}:{c % 100:02d}" for c in CLOCKS]
    np.testing.assert_array_equal(read_track(table(tmp_path, "date,time", cells)).times, SECONDS)


def test_midnight(tmp_path):
    cells = [f"202605{6 + (k > 4):02d},{(235955 + k) if k < 5 else k - 5:06d}" for k in range(10)]
    np.testing.assert_array_equal(read_track(table(tmp_path, "date,time", cells)).times, SECONDS)


def test_fourteen_digits(tmp_path):
    file = table(tmp_path, "time", [f"202605060{c}" for c in CLOCKS])
    np.testing.assert_array_equal(read_track(file).times, SECONDS)


def test_columns_of_whole_numbers_in_a_data_frame():
    frame = pd.DataFrame({"date": 20260506, "time": CLOCKS, "x": 3 * SECONDS, "y": SECONDS**2, "z": 0.0})
    np.testing.assert_array_equal(read_track(frame).times, SECONDS)


def test_seconds_beside_a_date_stay_seconds(tmp_path):
    track = read_track(table(tmp_path, "date,time", [f"20260506,{t}" for t in SECONDS]))
    np.testing.assert_array_equal(track.times, SECONDS)


@pytest.mark.parametrize(
    ("header", "cells", "columns", "message"),
    [
        ("date,time", "060526,0900{:02d}", None, "line 2: the columns 'date' and 'time' must have dates such as"),
        ("date,time", "20260506,0900{:02d}", None, "'2026-05-06 09:00:60'"),
        ("a,b", "{:d},2000000000", {"time": ["a", "b"]}, "nanoseconds are less than 1000000000"),
    ],
)
def test_what_is_not_clear_is_refused(tmp_path, header, cells, columns, message):
    file = table(tmp_path, header, map(cells.format, range(52, 62)))
    with pytest.raises(ValueError, match=message):
        read_track(file, columns=columns)


def test_whole_seconds_and_nanoseconds(tmp_path):
    """Also for seconds that look like a date."""
    for header, start in (("sec,nsec", 20260506), ("a,b", 1_700_000_000)):
        file = table(tmp_path, header, [f"{start + k // 2},{500_000_000 * (k % 2)}" for k in range(10)])
        times = np.asarray(read_track(file, columns={"time": header.split(",")}).times)
        np.testing.assert_allclose(times - times[0], SECONDS / 2, atol=1e-9)
