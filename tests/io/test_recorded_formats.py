"""Files of other programs: KITTI, EuRoC, AIS, autopilot logs, repeated rows and files without times."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from qtraj.io.track.recording import is_recording
from qtraj.io.track.track_file import read_recording, read_track
from qtraj.scenario.path_parts import TrackPart

COUNT = 12
TIMES = 0.1 * np.arange(COUNT)
POSITIONS = np.stack([9 * TIMES, 3 * np.sin(TIMES), 0.1 * TIMES], axis=1)
VELOCITIES = np.stack([9 + 0 * TIMES, 3 * np.cos(TIMES), 0.1 + 0 * TIMES], axis=1)
ROTATIONS = Rotation.from_euler("ZYX", np.stack([0.3 * TIMES, 0.1 * TIMES, 0.02 + 0 * TIMES], axis=1))
ATTITUDES = ROTATIONS.as_quat(scalar_first=True)
CAMERA = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0.0]])
"""Rotation from right, down, forward to x, y, z with z up."""
CAMERA_BODY = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0.0]])
"""Rotation from the camera's axes to forward, left, up."""

PRINTED = 1e-9
"""Rounding of the printed decimals."""

MATRIX_DIGITS = 1e-6
"""Rounding of matrices printed with six decimals."""


def write(tmp_path, header, columns, delimiter=",", name="data.dat"):
    rows = [[cell if isinstance(cell, str) else f"{cell:.12f}" for cell in row] for row in zip(*columns, strict=True)]
    file = tmp_path / name
    file.write_text("\n".join([*header, *map(delimiter.join, rows)]) + "\n", encoding="utf-8")
    return file


def columns(*arrays):
    return [column for array in arrays for column in np.reshape(array, (len(array), -1)).T.tolist()]


def same(quaternions, expected):
    np.testing.assert_allclose(np.abs(np.sum(np.asarray(quaternions) * expected, axis=1)), 1, atol=MATRIX_DIGITS)


def kitti(tmp_path):
    matrices = CAMERA.T @ ROTATIONS.as_matrix() @ CAMERA_BODY
    poses = np.concatenate([matrices, (POSITIONS @ CAMERA)[:, :, None]], axis=2).reshape(-1, 12)
    file = tmp_path / "00.txt"
    file.write_text("\n".join(" ".join(f"{x:.6e}" for x in row) for row in poses) + "\n")
    return file


def test_kitti_poses(tmp_path):
    file = kitti(tmp_path)
    recording = read_recording(file, rate=10)
    np.testing.assert_allclose(recording.track.times, TIMES, atol=PRINTED)
    np.testing.assert_allclose(recording.track.positions, POSITIONS, atol=1e-5)
    same(recording.track.attitudes, ATTITUDES)
    assert recording.facts[0] == "time: 10 samples per second, as given, s"
    assert "right, down, forward" in recording.facts[1]
    np.testing.assert_allclose(read_track(file, rate=10, axes="enu").positions, POSITIONS @ CAMERA, atol=1e-5)
    stamps = write(tmp_path, [], [[f"{t + 5:.6e}" for t in TIMES]], name="times.txt")
    np.testing.assert_allclose(read_track(file, times=stamps).times, TIMES + 5, atol=MATRIX_DIGITS)
    part = TrackPart(file=file.name, times=stamps.name, axes="camera")
    np.testing.assert_allclose(part.read(lambda name: tmp_path / name).track.positions, POSITIONS, atol=1e-5)


def test_faults_of_kitti_poses(tmp_path):
    file = kitti(tmp_path)
    with pytest.raises(ValueError, match=r"00\.txt: .*twelve numbers \(KITTI\), and no times.*rate=.*times="):
        read_track(file)
    with pytest.raises(ValueError, match=r"there are 12 rows, but .* contains 2 times"):
        read_track(file, times=write(tmp_path, [], [["0", "1"]], name="times.txt"))
    with pytest.raises(ValueError, match="both given"):
        read_track(file, rate=10, times="times.txt")
    with pytest.raises(ValueError, match="rate= must be a positive finite number"):
        read_track(file, rate=0)
    rows = file.read_text().splitlines()
    rows[3] = " ".join(["2", *rows[3].split()[1:]])
    file.write_text("\n".join(rows))
    with pytest.raises(ValueError, match="pose of row 4 does not contain a rotation matrix"):
        read_track(file, rate=10)


def test_poses_with_an_unknown_vertical_are_refused(tmp_path):
    poses = np.concatenate([ROTATIONS.as_matrix(), POSITIONS[:, :, None]], axis=2).reshape(-1, 12)
    file = write(tmp_path, [], columns(poses), " ")
    with pytest.raises(ValueError, match=r"the axes of the poses are not known.*axes='camera'.*axes='enu'"):
        read_track(file, rate=10)
    track = read_track(file, rate=10, axes="enu")
    same(track.attitudes, ATTITUDES)
    np.testing.assert_allclose(track.positions, POSITIONS, atol=PRINTED)


def test_euroc_ground_truth(tmp_path):
    header = (
        "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z [],"
        "v_RS_R_x [m s^-1],v_RS_R_y [m s^-1],v_RS_R_z [m s^-1],"
        "b_w_RS_S_x [rad s^-1],b_w_RS_S_y [rad s^-1],b_w_RS_S_z [rad s^-1]"
    )
    stamps = [str(1_403_636_580_838_555_648 + 100_000_000 * k) for k in range(COUNT)]
    file = write(tmp_path, [header], [stamps, *columns(POSITIONS, ATTITUDES, VELOCITIES, 0 * POSITIONS)])
    recording = read_recording(file)
    np.testing.assert_allclose(recording.track.times, TIMES, rtol=1e-15, atol=1e-16)
    np.testing.assert_allclose(recording.track.positions, POSITIONS, atol=PRINTED)
    np.testing.assert_allclose(recording.track.velocities, VELOCITIES, atol=PRINTED)
    np.testing.assert_allclose(recording.track.attitudes, ATTITUDES, atol=PRINTED)
    assert recording.track.rates is None
    assert recording.facts[3].startswith("rows: 12; left out: b_w_RS_S_x")


@pytest.mark.parametrize(("scale", "unit"), [(1, "s"), (10**3, "ms"), (10**6, "µs"), (10**9, "ns")])
def test_an_autopilot_log(tmp_path, scale, unit):
    """Whole numbers without a unit: the speeds tell the unit; the axes x, y, z are named by the user."""
    seconds = 500 + np.arange(COUNT)
    positions = np.stack([9.0 * seconds, 3 * np.sin(0.1 * seconds), 0.1 * seconds], axis=1)
    velocities = np.stack([9 + 0.0 * seconds, 0.3 * np.cos(0.1 * seconds), 0.1 + 0.0 * seconds], axis=1)
    stamps = [str(scale * second) for second in seconds]
    ned = [[0, 1, 0], [1, 0, 0], [0, 0, -1]]
    file = write(tmp_path, ["timestamp,x,y,z,vx,vy,vz"], [stamps, *columns(positions @ ned, velocities @ ned)])
    recording = read_recording(file, axes="ned")
    np.testing.assert_array_equal(recording.track.times, seconds)
    np.testing.assert_allclose(recording.track.velocities, velocities, atol=PRINTED)
    note = "" if scale == 1 else ", by the recorded speeds"
    assert recording.facts[0] == f"time: column 1 'timestamp', {unit}{note}"


def test_ais(tmp_path):
    stamps = [f"06/05/2026 09:00:{k:02d}" for k in range(COUNT)]
    places = [[55.0 + 1e-5 * k for k in range(COUNT)], [11.0] * COUNT]
    header = "# Timestamp,MMSI,Latitude,Longitude,SOG,COG,Heading"
    file = write(tmp_path, [header], [stamps, ["219000000"] * COUNT, *places, *columns(np.ones((COUNT, 3)))])
    recording = read_recording(file)
    np.testing.assert_array_equal(recording.track.times, np.arange(COUNT))
    np.testing.assert_allclose(recording.track.positions[-1, 1], 1e-5 * (COUNT - 1) * 111_325, rtol=1e-3)
    assert "day before the month" in recording.facts[0]
    assert "speed 'SOG' in kn and heading 'Heading'" in recording.facts[3]


def test_several_header_lines_are_a_recording(tmp_path):
    lines = ["robot,x", "frame,cog", "time,px,py,pz,qw,qx,qy,qz"]
    file = write(tmp_path, lines, columns(TIMES, POSITIONS, ATTITUDES))
    np.testing.assert_allclose(read_track(file).positions, POSITIONS, atol=PRINTED)
    assert is_recording(file, file.read_bytes())
    assert not is_recording(tmp_path / "s.toml", b"[limits]\nx = [\n1, 2, 3, 4\n]\n")


@pytest.mark.parametrize("end", [[["0.5"]], [["0.0"]]])
def test_a_clock_that_goes_back(tmp_path, end):
    rows = [[*map(str, TIMES), *end[0]], *columns(np.vstack([POSITIONS, POSITIONS[-1:]]))]
    file = write(tmp_path, ["t,x,y,z"], rows)
    with pytest.raises(ValueError, match=r"line 14: times must increase strictly.* follows") as caught:
        read_track(file)
    assert "pass segment=1 (line 2 to line 13), segment=2 (line 14 to line 14)" in str(caught.value)


def doubled(values):
    return np.repeat(values, 2, axis=0)


def test_equal_rows_count_once(tmp_path):
    recording = read_recording(write(tmp_path, ["t,x,y,z"], columns(doubled(TIMES), doubled(POSITIONS))))
    np.testing.assert_allclose(recording.track.times, TIMES, atol=PRINTED)
    np.testing.assert_allclose(recording.track.positions, POSITIONS, atol=PRINTED)
    assert "12 repeated rows omitted" in recording.facts[3]


def test_similar_rows_at_one_time_are_averaged(tmp_path):
    """Rows that differ by 1 mm, with quaternions of either sign; the other rows are unchanged."""
    order = np.sort([*range(COUNT), 5])
    positions, attitudes = POSITIONS[order], ATTITUDES[order]
    positions[6] += [1e-3, 0, 0]
    attitudes[6] *= -1
    file = write(tmp_path, [], columns(TIMES[order], positions, attitudes[:, [1, 2, 3, 0]]), " ", "hand.txt")
    recording = read_recording(file)
    expected = POSITIONS.copy()
    expected[5, 0] += 0.5e-3
    np.testing.assert_allclose(recording.track.positions, expected, atol=PRINTED)
    np.testing.assert_allclose(recording.track.attitudes, ATTITUDES, atol=PRINTED)
    assert "1 row averaged with another row at the same time" in recording.facts[3]


@pytest.mark.parametrize(("choice", "x"), [("first", 4.5), ("last", 104.5), ("mean", 54.5)])
def test_different_rows_at_one_time(tmp_path, choice, x):
    order = np.sort([*range(COUNT), 5])
    positions = POSITIONS[order]
    positions[6] += [100, 0, 0]
    file = write(tmp_path, ["t,x,y,z"], columns(TIMES[order], positions))
    with pytest.raises(ValueError, match=r"line 8: times must increase strictly.*duplicates='first', 'last' or 'mean'"):
        read_track(file)
    track = read_track(file, duplicates=choice)
    np.testing.assert_allclose(track.positions[5], [x, *POSITIONS[5, 1:]], atol=PRINTED)
    np.testing.assert_allclose(np.delete(track.positions, 5, 0), np.delete(POSITIONS, 5, 0), atol=PRINTED)
    with pytest.raises(ValueError, match="duplicates= must be"):
        read_track(file, duplicates="all")


def test_tables_without_times(tmp_path):
    file = write(tmp_path, ["x;y;z"], columns(POSITIONS), ";")
    with pytest.raises(ValueError, match=r"no columns for the time.*pass rate=.*times="):
        read_track(file)
    np.testing.assert_allclose(read_track(file, rate=10).times, TIMES, atol=PRINTED)
    commas = tmp_path / "commas.dat"
    commas.write_text(file.read_text().replace(".", ","))
    np.testing.assert_allclose(read_track(commas, rate=10).positions, POSITIONS, atol=PRINTED)
    timed = write(tmp_path, ["t,x,y,z"], columns(TIMES, POSITIONS))
    with pytest.raises(ValueError, match="'t' contains times, so omit rate="):
        read_track(timed, rate=10)


def test_the_centre_line_of_a_track_has_no_times(tmp_path):
    header = "# x_m,y_m,w_tr_right_m,w_tr_left_m"
    file = write(tmp_path, [header], columns(POSITIONS[:, :2], np.full((COUNT, 2), 7.5)))
    with pytest.raises(ValueError, match=r"no columns for the time.*The columns are x_m, y_m, w_tr_right_m") as caught:
        read_track(file)
    assert "\n" not in str(caught.value)
    assert "without times and heights" in str(caught.value)
