"""Tables and sentences as loggers, receivers and data frames write them."""

from datetime import datetime, timedelta

import numpy as np
import pandas as pd
import pytest

import qtraj as qt
from qtraj.io.track.track_file import read_recording

TIMES = np.arange(0.0, 20.0, 0.5)
POSITIONS = np.stack([8 * TIMES, 30 * np.sin(TIMES / 9), 0.2 * TIMES], axis=1)
VELOCITIES = np.stack([8 + 0 * TIMES, 30 / 9 * np.cos(TIMES / 9), 0.2 + 0 * TIMES], axis=1)
EAST, NORTH, UP = POSITIONS.T
NED = np.stack([NORTH, EAST, -UP], axis=1)
LATITUDES, LONGITUDES = 48 + NORTH / 111_200, 11 + EAST / 74_600
DATES = [
    (datetime(2026, 5, 6, 9) + timedelta(seconds=t)).isoformat(sep=" ", timespec="milliseconds") for t in TIMES.tolist()
]

PRINTED = 1e-5
"""Rounding of the printed decimals."""

DEGREE = 1e-2
"""Relative error of the lengths of a degree."""


def write(tmp_path, lines, columns, delimiter=","):
    rows = zip(*columns, strict=True)
    file = tmp_path / "log.txt"
    texts = [delimiter.join(cell if isinstance(cell, str) else f"{cell:.9f}" for cell in row) for row in rows]
    file.write_text("\n".join([*lines, *texts]) + "\n")
    return file


def test_dates_and_times_of_day_between_spaces_under_one_name(tmp_path):
    """RTKLIB writes one name for two cells."""
    header = "%  GPST            latitude(deg) longitude(deg)  height(m)   Q  ns"
    rest = [LATITUDES, LONGITUDES, 500 + UP, ["1"] * len(TIMES), ["12"] * len(TIMES)]
    file = write(tmp_path, ["% program : RTKPOST", header], [[d.replace("-", "/") for d in DATES], *rest], "   ")
    recording = read_recording(file)
    np.testing.assert_allclose(recording.track.times, TIMES, atol=PRINTED)
    np.testing.assert_allclose(recording.track.positions[:, 2] - recording.track.positions[0, 2], UP, atol=5e-3)
    assert "left out: Q, ns" in recording.facts[3]
    plain = qt.read_track(write(tmp_path, ["time x y z"], [DATES, *POSITIONS.T], " "))
    np.testing.assert_allclose(plain.times, TIMES, atol=PRINTED)
    np.testing.assert_allclose(plain.positions, POSITIONS, atol=PRINTED)


@pytest.mark.parametrize("index", [DATES, TIMES])
@pytest.mark.parametrize("name", ["", "Unnamed: 0"])
def test_the_index_that_pandas_writes_without_a_name(tmp_path, index, name):
    file = write(tmp_path, [f"{name},x,y,z"], [index, *POSITIONS.T])
    np.testing.assert_allclose(qt.read_track(file).times, TIMES, atol=PRINTED)


def test_an_index_that_counts_rows_is_no_time(tmp_path):
    file = write(tmp_path, [",x,y,z"], [[str(k) for k in range(len(TIMES))], *POSITIONS.T])
    with pytest.raises(ValueError, match=r"no columns for the time were found.*rate="):
        qt.read_track(file)
    np.testing.assert_allclose(qt.read_track(file, rate=2).times, TIMES)


def test_an_index_of_numbers_without_a_name():
    frame = pd.DataFrame(POSITIONS, columns=["x", "y", "z"])
    np.testing.assert_array_equal(qt.read_track(frame.set_index(pd.Index(TIMES))).times, TIMES)
    with pytest.raises(ValueError, match="no columns for the time"):
        qt.read_track(frame)
    other = frame.assign(t=TIMES).set_index(pd.Index(TIMES + 7))
    np.testing.assert_array_equal(qt.read_track(other).times, TIMES)


@pytest.mark.parametrize(
    ("header", "columns"),
    [
        ("TimeUS,PN,PE,PD", [*NED.T]),
        ("ts_us,p_1,p_2,p_3", [*POSITIONS.T]),
        ("utime,pos_x,pos_y,pos_z", [*POSITIONS.T]),
        ("time_us,Rechtswert,Hochwert,Höhe", [*POSITIONS.T]),
    ],
)
def test_names_of_other_programs(tmp_path, header, columns):
    file = write(tmp_path, [header], [[f"{1e6 * t:.0f}" for t in TIMES], *columns])
    recording = read_recording(file)
    np.testing.assert_allclose(recording.track.times, TIMES, atol=PRINTED)
    np.testing.assert_allclose(recording.track.positions, POSITIONS, atol=PRINTED)
    assert "µs" in recording.facts[0]


@pytest.mark.parametrize(("name", "seconds"), [("time_min", 60), ("time_h", 3600), ("Zeit [s]", 1)])
def test_units_of_times(tmp_path, name, seconds):
    file = write(tmp_path, [f"{name},x,y,z"], [TIMES / seconds, *POSITIONS.T])
    np.testing.assert_allclose(qt.read_track(file).times, TIMES, atol=3600 * 1e-9)


def test_geographic_positions_with_velocities_of_an_inertial_system(tmp_path):
    north, east, down = VELOCITIES[:, 1], VELOCITIES[:, 0], -VELOCITIES[:, 2]
    header = "Time,PosLat,PosLon,PosAlt,VelNorth,VelEast,VelDown"
    columns = [TIMES, LATITUDES, LONGITUDES, 500 + UP, north, east, down]
    track = qt.read_track(write(tmp_path, [header, "(s),(deg),(deg),(m),(m/s),(m/s),(m/s)"], columns))
    np.testing.assert_allclose(track.velocities, VELOCITIES, atol=DEGREE)
    np.testing.assert_allclose(track.positions, POSITIONS, atol=DEGREE * POSITIONS.max())


def test_columns_that_are_named_are_geographic_by_their_unit(tmp_path):
    file = write(tmp_path, ["Time,INS_Lat,INS_Long,INS_Height"], [TIMES, LATITUDES, LONGITUDES, 500 + UP])
    named = {"position": ["INS_Lat", "INS_Long", "INS_Height"]}
    track = qt.read_track(file, columns=named, units={"position": "deg"})
    np.testing.assert_allclose(track.positions, POSITIONS, atol=DEGREE * POSITIONS.max())
    with pytest.raises(ValueError, match=r"geographic coordinates.* --units position=deg"):
        qt.read_track(file, columns=named)


def test_semicircles(tmp_path):
    scale = 2**31 / 180
    cells = [[f"{x * scale:.0f}" for x in column] for column in (LATITUDES, LONGITUDES)]
    file = write(tmp_path, ["timestamp,position_lat,position_long"], [DATES, *cells])
    with pytest.raises(ValueError, match="in semicircles, as in files of Garmin"):
        qt.read_track(file)
    track = qt.read_track(file, units={"position": "semicircles"})
    np.testing.assert_allclose(track.positions[:, :2], POSITIONS[:, :2], atol=DEGREE * POSITIONS.max())


def test_texts_are_no_heights(tmp_path):
    texts = [["CAR"] * len(TIMES), ["MIA"] * len(TIMES)]
    recording = read_recording(write(tmp_path, ["t,x,y,class,city"], [TIMES, EAST, NORTH, *texts]))
    assert "height 0 m" in recording.facts[1]
    with pytest.raises(ValueError, match="position are incomplete"):
        qt.read_track(write(tmp_path, ["t,x,y,q"], [TIMES, EAST, NORTH, UP]))


@pytest.mark.parametrize(("before", "after"), [("2026-05-06 09:00:00.123 ", ""), ("NMEA,", ",1778058000123")])
def test_sentences_between_the_times_of_a_logger(tmp_path, before, after):
    sentences = []
    for k in range(8):
        body = f"GPGGA,09000{k}.00,4800.{10 + k:02d}00000,N,01100.0000000,E,1,08,0.9,500.0,M,47.0,M,,"
        check = 0
        for letter in body:
            check ^= ord(letter)
        sentences.append(f"{before}${body}*{check:02X}{after}")
    file = tmp_path / "log.txt"
    file.write_text("\n".join(sentences) + "\n")
    track = qt.read_track(file)
    np.testing.assert_allclose(track.times - track.times[0], np.arange(8))
    np.testing.assert_allclose(track.positions[-1, 1], 7 * 0.01 / 60 * 111_200, rtol=DEGREE)


@pytest.mark.parametrize(("delimiter", "quote"), [(" ", ""), (", ", '"'), (";", "")])
def test_seconds_and_nanoseconds(tmp_path, delimiter, quote):
    """Between spaces, and in quotes, NumPy cannot read the two columns at once."""
    seconds = [f"{quote}{1_700_000_000 + int(t)}{quote}" for t in TIMES]
    rest = [f"{quote}{int(t % 1 * 10**9)}{quote}" for t in TIMES]
    places = [[f"{quote}{x:.6f}{quote}" for x in column] for column in (EAST, NORTH)]
    texts = [f"{quote}ok{quote}"] * len(TIMES)
    header = delimiter.join(["# sec", "nanosec", "x", "y", "status"])
    track = qt.read_track(write(tmp_path, [header], [seconds, rest, *places, texts], delimiter))
    np.testing.assert_allclose(track.times, TIMES, atol=PRINTED)
    np.testing.assert_allclose(track.positions[:, :2], POSITIONS[:, :2], atol=PRINTED)


def test_a_comment_of_three_words_is_not_the_header(tmp_path):
    file = write(tmp_path, ["# made by logger", "# t x y"], [TIMES, EAST, NORTH], " ")
    np.testing.assert_allclose(qt.read_track(file).times, TIMES)


@pytest.mark.parametrize("header", ["year,month,day,hour,minute,second", "Year,Month,Day,Hour,Min,Sec"])
def test_the_parts_of_a_date_in_six_columns(tmp_path, header):
    """The seconds alone would jump back at each minute."""
    late = [datetime.fromisoformat(date) + timedelta(seconds=50) for date in DATES]
    parts = [[str(getattr(date, part)) for date in late] for part in ("year", "month", "day", "hour", "minute")]
    seconds = [f"{date.second + date.microsecond / 1e6:.3f}" for date in late]
    file = write(tmp_path, [f"{header},x,y"], [*parts, seconds, EAST, NORTH])
    recording = read_recording(file)
    np.testing.assert_allclose(recording.track.times, TIMES, atol=PRINTED)
    np.testing.assert_allclose(recording.track.positions[:, :2], POSITIONS[:, :2], atol=PRINTED)
    assert "date and time" in recording.facts[0]
    file.write_text(file.read_text().replace("2026,5,6,9,0,51.000", "2026,5,6,9,0,sixty"))
    with pytest.raises(ValueError, match=r"line 4: the columns .* must have year.*contain 2026, 5, 6, 9, 0, sixty"):
        qt.read_track(file)


@pytest.mark.parametrize(("unit", "factor"), [("sec", 1), ("min", 60)])
def test_durations_as_matlab_writes_them(tmp_path, unit, factor):
    file = write(tmp_path, ["Time,x,y,z"], [[f"{t / factor:.9f} {unit}" for t in TIMES], *POSITIONS.T])
    np.testing.assert_allclose(qt.read_track(file).times, TIMES, atol=PRINTED)


def test_a_row_of_units_in_brackets_some_of_which_are_unknown(tmp_path):
    weeks = ["2417"] * len(TIMES)
    header = ["GPSWeek,GPSTime,x,y,z", "(weeks),(ms),(cm),(cm),(cm)"]
    track = qt.read_track(write(tmp_path, header, [weeks, 1000 * TIMES, *(100 * POSITIONS.T)]))
    np.testing.assert_allclose(track.times, TIMES, atol=PRINTED)
    np.testing.assert_allclose(track.positions, POSITIONS, atol=PRINTED)


def test_positions_of_a_simulated_road(tmp_path):
    """The position along the road is no height."""
    header = "timestep_time;vehicle_id;vehicle_x;vehicle_y;vehicle_speed;vehicle_pos;road"
    rest = [["8.0"] * len(TIMES), EAST, ["e1_0"] * len(TIMES)]
    recording = read_recording(write(tmp_path, [header], [TIMES, ["car"] * len(TIMES), EAST, NORTH, *rest], ";"))
    assert "vehicle_x, vehicle_y, m, height 0 m" in recording.facts[1]
