"""Track files: recognised formats, and the message for each fault of a file."""

import importlib.resources
import re
import time

import numpy as np
import pytest

from qtraj.foundation import document
from qtraj.io.dataset_file import save_dataset
from qtraj.io.track.track_file import read_track

SECONDS_FOR_1E5_ROWS = 10.0
"""It takes 0.75 s on an idle core; the bound only detects quadratic run time."""

ROWS = [[0.0, 1.0, 2.0, 3.0], [0.1, 1.5, 2.5, 3.5], [0.2, 2.0, 3.0, 4.0], [0.35, 2.5, 3.25, 4.0], [0.4, 3.0, 3.5, 4.0]]
TEXT = "\n".join(",".join(map(str, row)) for row in ROWS) + "\n"


def written(tmp_path, text, name="track.csv", encoding="utf-8"):
    file = tmp_path / name
    file.write_bytes(text.encode(encoding))
    return file


def check(track):
    np.testing.assert_array_equal(track.times, [row[0] for row in ROWS])
    np.testing.assert_array_equal(track.positions, [row[1:] for row in ROWS])


def test_the_bundled_recording():
    resource = importlib.resources.files("qtraj.io") / "data" / "boreas_right_angle.csv"
    with importlib.resources.as_file(resource) as file:
        track = read_track(file)
        head = file.read_text(encoding="utf-8")
    assert track.times.shape == (77,)
    np.testing.assert_array_equal(track.positions[0], [623329.9495, 4848831.9929, 152.3024])
    np.testing.assert_array_equal(track.velocities[0], [1.938244, -7.282, -0.090955])
    assert track.attitudes is None
    assert "Boreas dataset" in head
    assert "CC BY 4.0" in head


@pytest.mark.parametrize(
    "header",
    ["time,x,y,z", "t,easting,northing,altitude", "timestamp,position_x,position_y,position_z", "Time [s],X (m),Y,Z"],
)
def test_common_column_names(tmp_path, header):
    check(read_track(written(tmp_path, header + "\n" + TEXT)))


@pytest.mark.parametrize(
    "change",
    [
        lambda s: "\ufeff" + s,
        lambda s: s.replace("\n", "\r\n"),
        lambda s: "# recorded by us\n\n" + s.replace("\n0.2", "\n  # a stop\n0.2"),
        lambda s: s.replace(",", ";"),
        lambda s: s.replace(",", "\t"),
        lambda s: s.replace(",", ", "),
        lambda s: s.rstrip("\n"),
        lambda s: s.replace("0.1,", '"0.1",'),
    ],
    ids=["bom", "crlf", "comments", "semicolons", "tabs", "spaces", "no end of line", "quotes"],
)
def test_dialects(tmp_path, change):
    check(read_track(written(tmp_path, change("time,x,y,z\n" + TEXT))))


@pytest.mark.filterwarnings("ignore:the recorded velocities")
def test_named_columns_velocities_and_attitudes(tmp_path):
    rng = np.random.default_rng(3)
    table = np.column_stack([np.arange(6) * 0.1, rng.normal(size=(6, 11))])
    names = "clock,a,b,c,vx,vy,vz,i,j,k,s,spare"
    text = names + "\n" + "\n".join(",".join(map(repr, row)) for row in table.tolist())
    file = written(tmp_path, text)
    columns = {"time": "clock", "position": ["c", "a", "b"], "attitude": ["s", "i", "j", "k"]}
    track = read_track(file, columns)
    np.testing.assert_array_equal(track.positions, table[:, [3, 1, 2]])
    np.testing.assert_array_equal(track.velocities, table[:, 4:7])
    np.testing.assert_array_equal(track.attitudes, table[:, [10, 7, 8, 9]])
    without = read_track(file, {**columns, "velocity": None})
    assert without.velocities is None


@pytest.mark.parametrize(
    ("names", "columns", "places"),
    [
        ("wx,wy,wz", None, [4, 5, 6]),
        ("angvel_z [rad/s],angvel_y,Angvel_x", None, [6, 5, 4]),
        ("wx,b,wz", None, [6]),
        ("p,q,r", {"rate": ["p", "q", "r"]}, [4, 5, 6]),
        ("p,q,r", {"rate": "r"}, [6]),
        ("wx,wy,wz", {"rate": None}, None),
        ("wx,wy,spare", None, None),
    ],
)
def test_angular_rates(tmp_path, names, columns, places):
    table = np.column_stack([np.arange(6) * 0.1, np.random.default_rng(4).normal(size=(6, 6))])
    text = f"t,x,y,z,{names}\n" + "\n".join(",".join(map(repr, row)) for row in table.tolist())
    track = read_track(written(tmp_path, text), columns)
    if places is None:
        assert track.rates is None
        return
    np.testing.assert_array_equal(track.rates, table[:, places])
    np.testing.assert_array_equal(track.window(0.1, 0.4).rates, table[1:5, places])
    save_dataset(track, tmp_path / "written.csv")
    np.testing.assert_array_equal(read_track(tmp_path / "written.csv").rates, track.rates)
    document.save(track, tmp_path / "track.json")
    np.testing.assert_array_equal(document.load(tmp_path / "track.json").rates, track.rates)


def test_a_wrong_number_of_angular_rates(tmp_path):
    file = written(tmp_path, "t,x,y,z,wz [deg/s]\n" + "".join(f"{k},0,0,0,1\n" for k in range(5)))
    np.testing.assert_allclose(read_track(file).rates, np.full((5, 1), np.pi / 180), rtol=1e-15)
    with pytest.raises(ValueError, match=r"columns\['rate'\] must name 3 columns, or the column of the yaw rate"):
        read_track(file, {"rate": ["x", "y"]})


@pytest.mark.parametrize("name", ["track.tum", "track.txt", "track.csv"])
def test_tum_attitudes_become_scalar_first(tmp_path, name):
    text = "# timestamp tx ty tz qx qy qz qw\n" + "\n".join(f"{k}.5 {k} 2 3  0.1 0.2 0.3 0.9" for k in range(5))
    track = read_track(written(tmp_path, text, name))
    np.testing.assert_array_equal(track.times, np.arange(5) + 0.5)
    np.testing.assert_array_equal(track.positions[2], [2.0, 2.0, 3.0])
    np.testing.assert_array_equal(track.attitudes, np.tile([0.9, 0.1, 0.2, 0.3], (5, 1)))
    assert track.velocities is None


def test_a_csv_file_may_be_called_txt(tmp_path):
    check(read_track(written(tmp_path, "time,x,y,z\n" + TEXT, "track.txt")))


def test_an_incomplete_part_can_be_left_out(tmp_path):
    text = "time,x,y,z,vx\n" + "\n".join(",".join(map(str, [*row, 1.0])) for row in ROWS)
    track = read_track(written(tmp_path, text), {"velocity": None})
    check(track)
    assert track.velocities is None


HEAD = "# first\ntime,x,y,z\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (HEAD + TEXT.replace("2.5,3.5", "fast,3.5"), r"line 4: column 'y' must have finite numbers.*'fast'"),
        (HEAD + TEXT.replace("2.5,3.5", "nan,3.5"), r"line 4: column 'y' must have finite numbers.*'nan'"),
        (HEAD + TEXT.replace("2.5,3.5", "2.5,-inf"), r"line 4: column 'z' must have finite numbers.*'-inf'"),
        (HEAD + TEXT.replace("2.5,3.5", "2.5,"), r"line 4: the cell of column 'z' is missing"),
        (HEAD + TEXT.replace("2.5,3.5", "2.5"), r"line 4: the cell of column 'z' is missing"),
        (
            HEAD + TEXT.replace("0.2,", "0.1,"),
            r"line 5: times must increase strictly, but in column 'time' 0.1.* follows",
        ),
        (HEAD + TEXT.replace("0.2,", "0.05,"), r"line 5: times must increase strictly"),
        (
            "time,x,y,h\n" + TEXT,
            r"position are incomplete: found x, y, missing z\. The columns are time, x, y, h; "
            r'.*position = \["x", "y", "\.\.\."\] under \[track\.columns\]',
        ),
        ("time,x,y,altitud [m]\n" + TEXT, r'columns=\{"position": \["x", "y", "altitud \[m\]"\]\}'),
        ("time,a,b,c\n" + TEXT, r"no columns for the position.*The columns are time, a, b, c; .*columns="),
        ("when,x,y,z\n" + TEXT, r"no columns for the time"),
        (
            "time,x,y,z,vx,vy\n",
            r"velocity are incomplete: found vx, vy, missing vz\. .*velocity = \[\"vx\", \"vy\", \"\.\.\.\"\] under "
            r'\[track\.columns\].*To omit the velocity, write velocity = \[\] in the scenario, or \{"velocity": None\}',
        ),
        ("time,x,y,z,vel_up [m/s]\n", r"velocity are incomplete: found vel_up \[m/s\], missing vel_east, vel_north\. "),
        ("t [m],x,y,z\n" + TEXT, r"the column 't \[m\]' is in m, but the time must be in s: convert it first"),
        ("t,x [deg],y,z\n" + TEXT, r"the column 'x \[deg\]' is in deg, but the position must be in m"),
        (
            "time,x (km),y (km),z\n" + TEXT,
            r"the column 'x \(km\)' is in km, but the column 'z' of the position has no unit: pass units=",
        ),
        ("time,x,y,z,vx [km/h],vy,vz\n", r"'vx \[km/h\]' is in km/h, but the column 'vy' of the velocity has no unit"),
        ("time,x (map) [km],y,z\n" + TEXT, r"is in km, but the column 'y' of the position has no unit"),
        ("time,x,y,z,qw [rad],qx,qy,qz\n", r"is in rad, but the attitude must be a quaternion"),
        ("time,x,y,z,qw,qx,qy\n", r"attitude are incomplete: found qw, qx, qy, missing qz"),
        (TEXT, r"line 1: expected a header row with column names"),
        ("", r"the file is empty"),
        ("# only a comment\n\n", r"all lines are comments.*: remove these marks"),
        (HEAD, r"at least 4 rows of numbers, but there are 0"),
        (HEAD + "0,1,2,3\n1,1,2,3\n2,1,2,3\n", r"at least 4 rows of numbers, but there are 3"),
        (HEAD + TEXT.replace("0.2,2.0", '0.2,"2.0'), r"line \d: .*"),
    ],
)
def test_faults_of_a_csv_file(tmp_path, text, words):
    file = written(tmp_path, text)
    with pytest.raises(ValueError, match=re.escape(str(file)) + ".*" + words):
        read_track(file)


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"position": ["x", "y", "w"]}, r"no column 'w': name other columns.*The columns are time, x, y, z"),
        ({"time": "clock"}, r"no column 'clock'"),
        ({"position": ["x"]}, r"must name 3 columns, or 2 columns without the height, but \['x'\] was given"),
        ({"speed": "x"}, r"the keys time, position, velocity, attitude, rate, but 'speed' was given"),
        ({"position": None}, r"no columns for the position"),
    ],
)
def test_faults_of_the_column_names(tmp_path, columns, words):
    with pytest.raises(ValueError, match=words):
        read_track(written(tmp_path, HEAD + TEXT), columns)


def test_angles_on_the_globe_are_not_positions(tmp_path):
    file = written(tmp_path, HEAD.replace("x,y", "gps_lon,Lat") + TEXT)
    with pytest.raises(
        ValueError, match=r"'gps_lon' seems to contain geographic coordinates.*convert latitude and longitude"
    ):
        read_track(file, {"position": ["gps_lon", "Lat", "z"]})


TUM = "\n".join(f"{k} {k} 2 3 0 0 0 1" for k in range(5))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            TUM.replace("3 3 2 3 0 0 0 1", "3 3 2 3 0 0 0"),
            r"line 4: the row has 7 cells, but there are 8 columns \(timestamp, tx",
        ),
        (TUM.replace("3 3 2 3", "3 3 up 3"), r"line 4: column 'ty' must have finite numbers.*'up'"),
        (TUM.replace("3 3 2", "2 3 2"), r"line 4: times must increase strictly, but in column 'timestamp'"),
        (TUM.replace("3 0 0 0 1", "3 0 0 0 0"), r"must be nonzero quaternions, but sample 0"),
    ],
)
def test_faults_of_a_tum_file(tmp_path, text, words):
    file = written(tmp_path, text, "track.tum")
    with pytest.raises(ValueError, match=re.escape(str(file)) + ".*" + words):
        read_track(file)
    with pytest.raises(ValueError, match="no header row"):
        read_track(file, {"time": "t"})


def test_a_missing_file_and_a_binary_one(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nowhere\.csv: there is no such file"):
        read_track(tmp_path / "nowhere.csv")
    with pytest.raises(ValueError, match="not a UTF-8 text file"):
        read_track(written(tmp_path, "time,x,y,z\n\u00e9", encoding="latin-1"))


@pytest.mark.filterwarnings("ignore:the recorded velocities")
def test_a_hundred_thousand_rows(tmp_path):
    table = np.column_stack([np.arange(100_000) * 0.01, np.random.default_rng(0).normal(size=(100_000, 6))])
    text = "time,x,y,z,vx,vy,vz\n" + "\n".join(",".join(f"{v:.4f}" for v in row) for row in table.tolist())
    file = written(tmp_path, text)
    start = time.perf_counter()
    track = read_track(file)
    assert time.perf_counter() - start < SECONDS_FOR_1E5_ROWS
    np.testing.assert_allclose(track.positions, table[:, 1:4], atol=0.51e-4)
