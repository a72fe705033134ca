"""Tables of pandas, polars and xarray."""

import subprocess
import sys

import numpy as np
import pandas as pd
import polars as pl
import pytest
import xarray as xr

import qtraj as qt
from qtraj.io.track.track_file import read_recording

COUNT = 20
TIMES = 0.1 * np.arange(COUNT)
POSITIONS = np.stack([9 * TIMES, 3 * np.sin(TIMES), 0.1 * TIMES], axis=1)
VELOCITIES = np.stack([9 + 0 * TIMES, 3 * np.cos(TIMES), 0.1 + 0 * TIMES], axis=1)
DATES = np.datetime64("2026-05-06T09:00:00", "ns") + (TIMES * 1e9).round().astype("m8[ns]")


def columns(time=TIMES):
    return {"t": time, **dict(zip("xyz", POSITIONS.T, strict=True))}


def check(track, velocities=False):
    np.testing.assert_allclose(track.times, TIMES, atol=1e-12)
    np.testing.assert_allclose(track.positions, POSITIONS, atol=1e-12)
    assert (track.velocities is None) != velocities


def test_frames():
    check(qt.read_track(pd.DataFrame(columns())))
    check(qt.read_track(pl.DataFrame(columns())))
    check(qt.read_track(pl.LazyFrame(columns())))
    named = pd.DataFrame(columns()).rename(columns={"t": "stamp", "x": "e"})
    check(qt.read_track(named, columns={"position": ["e", "y", "z"]}))


@pytest.mark.parametrize("zone", [None, "Europe/Vienna"])
def test_dates(zone):
    frame = pd.DataFrame(columns(pd.DatetimeIndex(DATES).tz_localize("UTC").tz_convert(zone) if zone else DATES))
    check(qt.read_track(frame))
    check(qt.read_track(frame.set_index("t")))
    check(qt.read_track(frame.set_index("t").rename_axis(None)))
    check(qt.read_track(pl.DataFrame(columns(DATES))))
    recording = read_recording(frame)
    assert "in seconds after 2026-05-06T09:00:00" in recording.facts[0]
    texts = frame.assign(t=[str(date) for date in DATES])
    check(qt.read_track(texts))


def test_integers_and_units_of_columns():
    stamps = 1_714_986_000_123_456_789 + (TIMES * 1e9).round().astype(int)
    check(qt.read_track(pd.DataFrame(columns(stamps))))
    check(qt.read_track(pd.DataFrame(columns()).rename(columns={"x": "x [m]"}).assign(note="a")))
    with pytest.warns(UserWarning, match=r"velocities are 3\.6 times .*units=\{\"velocity\": \"km/h\"\}"):
        qt.read_track(pd.DataFrame(columns() | dict(zip(("vx", "vy", "vz"), 3.6 * VELOCITIES.T, strict=True))))


def test_datasets_of_xarray():
    variables = {
        "position": (("time", "world"), POSITIONS, {"units": "m"}),
        "velocity": (("time", "world"), VELOCITIES, {"units": "m/s"}),
        "speed": (("time",), 0 * TIMES, {"units": "m/s"}),
    }
    plain = xr.Dataset(variables, coords={"time": TIMES})
    check(qt.read_track(plain), velocities=True)
    labelled = xr.Dataset(variables, coords={"time": TIMES, "world": ["x", "y", "z"]})
    check(qt.read_track(labelled), velocities=True)
    check(qt.read_track(xr.Dataset({n: ("time", v) for n, v in columns().items() if n != "t"}, {"time": DATES})))
    with pytest.raises(ValueError, match="no variables along a common first dimension"):
        qt.read_track(xr.Dataset({"a": 1.0}))


def test_the_dataset_of_a_track_is_read():
    track = qt.Track(TIMES, POSITIONS, VELOCITIES)
    check(qt.read_track(track.to_xarray()), velocities=True)


@pytest.mark.parametrize("make", [pd.DataFrame, pl.DataFrame])
def test_faults_name_row_and_column(make):
    missing = columns()
    missing["y"] = [*POSITIONS[:5, 1], None, *POSITIONS[6:, 1]]
    with pytest.raises(ValueError, match=r"the table, row 6: the cell of column 'y' is missing"):
        qt.read_track(make(missing))
    with pytest.raises(ValueError, match=r"the table, row 3: column 'z' must have finite numbers, but contains 'up'"):
        qt.read_track(make(columns() | {"z": ["0", "0", "up", *["1"] * (COUNT - 3)]}))
    with pytest.raises(ValueError, match=r"the table: no columns for the position.*The columns are t, a, b, c;"):
        qt.read_track(make(dict(zip("tabc", columns().values(), strict=True))))
    with pytest.raises(
        ValueError, match=r"the table, row 8: times must increase strictly.*segment=2 \(row 8 to row 20"
    ):
        qt.read_track(make(columns([*TIMES[:7], *TIMES[:13]])))
    with pytest.raises(ValueError, match="at least 4 rows"):
        qt.read_track(make({name: column[:0] for name, column in columns().items()}))


def test_no_library_of_tables_is_imported():
    code = (
        "import sys, qtraj as qt; qt.read_track('examples/drive.csv'); "
        "print([n for n in ('pandas', 'polars', 'xarray', 'gpxpy', 'pynmeagps') if n in sys.modules])"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == "[]"
