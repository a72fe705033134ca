"""Names of columns that other programs write."""

import numpy as np
import pytest

from qtraj.io.track.track_file import read_recording

COUNT = 20
TIMES = 0.25 * np.arange(COUNT)
POSITIONS = np.stack([8 * TIMES, 3 * np.sin(TIMES), 0.1 * TIMES], axis=1)
HALF = 0.1 * TIMES
ATTITUDES = np.stack([np.cos(HALF), 0 * HALF, 0 * HALF, np.sin(HALF)], axis=1)
STAMPS = [str(1_600_000_000_000_000_000 + 250_000_000 * k) for k in range(COUNT)]


def read(tmp_path, header, *columns, delimiter=",", **options):
    cells = []
    for column in columns:
        values = np.reshape(column, (COUNT, -1)).T.tolist() if not isinstance(column, list) else [column]
        cells += [[x if isinstance(x, str) else repr(x) for x in part] for part in values]
    file = tmp_path / "a.txt"
    file.write_text("\n".join([header, *map(delimiter.join, zip(*cells, strict=True))]) + "\n")
    return read_recording(file, **options)


def check(recording, columns=3, attitude=False):
    times, positions = np.asarray(recording.track.times), np.asarray(recording.track.positions)
    np.testing.assert_allclose(times - times[0], TIMES, atol=1e-9)
    np.testing.assert_allclose(positions[:, :columns], POSITIONS[:, :columns], atol=1e-9)
    assert (recording.track.attitudes is not None) == attitude
    if attitude:
        np.testing.assert_allclose(recording.track.attitudes, ATTITUDES, atol=1e-12)
    return recording


@pytest.mark.parametrize(
    "names",
    [
        "position.x,position.y,position.z",
        "field.pose.pose.position.x,field.pose.pose.position.y,field.pose.pose.position.z",
        "/odom/pose/pose/position/x,/odom/pose/pose/position/y,/odom/pose/pose/position/z",
        "RigidBody.Position.X,RigidBody.Position.Y,RigidBody.Position.Z",
        "utm_easting,utm_northing,altitude",
        "Local X [m],Local Y [m],Local Z [m]",
        "POS X,POS Y,POS Z",
        "gt_tx,gt_ty,gt_tz",
    ],
)
def test_names_of_positions(tmp_path, names):
    check(read(tmp_path, f"time,{names}", TIMES, POSITIONS))


def test_prefixes_are_not_mixed(tmp_path):
    header = "time,global_x,local_y,local_x,global_y,local_z,global_z"
    x, y, z = POSITIONS.T
    recording = check(read(tmp_path, header, TIMES, x, y + 5, x + 5, y, z + 5, z))
    assert recording.facts[1].startswith("position: global_x, global_y, global_z")


@pytest.mark.parametrize(
    ("header", "order"),
    [
        ("q_RS_w,q_RS_x,q_RS_y,q_RS_z", [0, 1, 2, 3]),
        ("orientation.x,orientation.y,orientation.z,orientation.w", [1, 2, 3, 0]),
        ("Rotation X,Rotation Y,Rotation Z,Rotation W", [1, 2, 3, 0]),
    ],
)
def test_names_of_quaternions(tmp_path, header, order):
    check(read(tmp_path, f"t,x,y,z,{header}", TIMES, POSITIONS, ATTITUDES[:, order]), attitude=True)


@pytest.mark.parametrize("names", ["q0,q1,q2,q3", "q[0],q[1],q[2],q[3]", "att_1,att_2,att_3,att_4"])
def test_numbered_quaternions_need_their_order(tmp_path, names):
    header = f"t,x,y,z,{names}"
    without = check(read(tmp_path, header, TIMES, POSITIONS, ATTITUDES))
    assert "pass quaternion='wxyz'" in without.notes[0]
    check(read(tmp_path, header, TIMES, POSITIONS, ATTITUDES, quaternion="wxyz"), attitude=True)
    last = ATTITUDES[:, [1, 2, 3, 0]]
    check(read(tmp_path, header, TIMES, POSITIONS, last, quaternion="xyzw"), attitude=True)
    columns = {"attitude": names.split(",")}
    check(read(tmp_path, header, TIMES, POSITIONS, last, quaternion="xyzw", columns=columns), attitude=True)


@pytest.mark.parametrize("form", ["r{}{}", "R_{}{}", "rot{}{}", "m[{}][{}]"])
@pytest.mark.parametrize("first", [0, 1])
def test_rotation_matrices(tmp_path, form, first):
    c, s, zero, one = np.cos(2 * HALF), np.sin(2 * HALF), 0 * HALF, 1 + 0 * HALF
    matrix = np.stack([c, -s, zero, s, c, zero, zero, zero, one], axis=1)
    names = ",".join(form.format(i, j) for i in range(first, first + 3) for j in range(first, first + 3))
    recording = check(read(tmp_path, f"t,x,y,z,{names}", TIMES, POSITIONS, matrix), attitude=True)
    assert "as a matrix from body to world axes, row by row" in recording.facts[2]


@pytest.mark.parametrize(
    ("header", "columns"),
    [
        ("sec,nsec", [[s[:-9] for s in STAMPS], [str(int(s[-9:])) for s in STAMPS]]),
        ("header.stamp.secs,header.stamp.nsecs", [[s[:-9] for s in STAMPS], [str(int(s[-9:])) for s in STAMPS]]),
        ("%time", [STAMPS]),
        ("gps_week,tow", [["2200"] * COUNT, [str(345600 + t) for t in TIMES]]),
        ("iTOW", [[str(345600000 + round(1000 * t)) for t in TIMES]]),
        ("date,time", [["2026-05-06"] * COUNT, [f"09:00:{t:05.2f}" for t in TIMES]]),
        ("Date,Time", [["06.05.2026"] * COUNT, [f"9:00:{t:05.2f} AM" for t in TIMES]]),
        ("Elapsed Time (sec)", [[str(t) for t in TIMES]]),
        ("local_time", [[f"5/16/2026 9:00:{t:05.2f} PM" for t in TIMES]]),
    ],
)
def test_names_and_forms_of_times(tmp_path, header, columns):
    check(read(tmp_path, f"{header},x,y,z", *columns, POSITIONS))


def test_noon_and_midnight(tmp_path):
    clocks = [f"{(11, 12)[k >= 10]}:{59 if k < 10 else 0:02d}:{k % 10 * 6:02d} {'AP'[k >= 10]}M" for k in range(COUNT)]
    track = read(tmp_path, "time,x,y,z", clocks, POSITIONS).track
    np.testing.assert_allclose(track.times, 6.0 * np.arange(COUNT))


@pytest.mark.parametrize("more", ["", ",theta,v", ",yaw,vx,vy,battery", ",w_tr_right_m,w_tr_left_m"])
def test_horizontal_positions(tmp_path, more):
    extra = [0 * TIMES] * more.count(",")
    recording = read(tmp_path, f"t,x,y{more}", TIMES, POSITIONS[:, :2], *extra)
    check(recording, columns=2)
    assert "height 0 m" in recording.facts[1]
    np.testing.assert_array_equal(np.asarray(recording.track.positions)[:, 2], 0)


@pytest.mark.parametrize("more", ["foo", "h", "vx,vy,vz", "level"])
def test_columns_that_may_be_the_height(tmp_path, more):
    extra = [0 * TIMES] * (more.count(",") + 1)
    with pytest.raises(ValueError, match=r"found x, y, missing z\. .*If all heights are 0, name two columns"):
        read(tmp_path, f"t,x,y,{more}", TIMES, POSITIONS[:, :2], *extra)
    flat = {"position": ["x", "y"], "velocity": None}
    check(read(tmp_path, f"t,x,y,{more}", TIMES, POSITIONS[:, :2], *extra, columns=flat), columns=2)


def test_decimal_commas_between_commas_are_refused(tmp_path):
    cells = [[f"{x:.2f}".replace(".", ",") for x in column] for column in (TIMES, *POSITIONS.T)]
    with pytest.raises(ValueError, match=r"line 2: the row has 8 cells, but there are 4 columns.*another delimiter"):
        read(tmp_path, "t,x,y,z", *cells)


def test_several_vehicles_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"column 'vehicle_id' has 2 different values \(a, b\).*several vehicles"):
        read(tmp_path, "t,vehicle_id,x,y,z", TIMES, ["a", "b"] * (COUNT // 2), POSITIONS)
    check(read(tmp_path, "t,vehicle_id,x,y,z", TIMES, ["a"] * COUNT, POSITIONS))
