"""`qtraj slew`: the figures of THEORY against independent arithmetic, the files, the refusals."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import xarray
from scipy.spatial.transform import Rotation

import qtraj as qt
from qtraj.io import instants_csv
from qtraj.motion.programs.slew_history import fine_times
from qtraj.scenario.reader import read_scenario
from qtraj.scenario.slew import SlewPart

from .slew_scenarios import ABOUT, LAW, REST

EXAMPLES = Path(__file__).parents[2] / "examples"
FILES = ["program.toml", "table.nc", "table.csv", "slew.png", "slew.svg"]
ROUND_OFF = 1e-12
V, A = np.radians(1.0), np.radians(0.05)  # of the built-in scenario


@pytest.fixture(scope="module")
def default(qtraj, tmp_path_factory):
    out = tmp_path_factory.mktemp("slew") / "new"
    result = qtraj("slew", "--json", "--out", out)
    return result, json.loads(result.stdout), out


def bang_coast_bang(t, angle=np.pi / 2):
    """Angle, rate and acceleration of the time-optimal turn, by hand."""
    first, total = V / A, angle / V + V / A
    t = t[:, None]
    pieces = [
        np.concatenate([A * t**2 / 2, A * t, A + 0 * t], axis=1),
        np.concatenate([V * (t - first / 2), V + 0 * t, 0 * t], axis=1),
        np.concatenate([angle - A * (total - t) ** 2 / 2, A * (total - t), -A + 0 * t], axis=1),
    ]
    return np.where(t < first, pieces[0], np.where(t < total - first, pieces[1], pieces[2]))


def test_the_embedded_turn_takes_110_seconds(default):
    result, content, out = default
    assert (result.exit_code, result.stderr) == (0, "")
    found = content["verdict"]
    assert found["duration"] == [pytest.approx(110.0, abs=1e-10)]
    assert found["switch_time"] == pytest.approx([20.0, 90.0])
    assert found["angle"] == [pytest.approx(np.pi / 2)]
    assert found["axis_body"] == [pytest.approx([0.0, 0.6, 0.8], abs=ROUND_OFF)]
    assert found["end_sign"] == 1
    assert content["files"] == [str(out / name) for name in FILES]
    assert all((out / name).stat().st_size > 200 for name in FILES)


def test_both_limits_bind_and_the_peaks_have_their_times(default):
    found = default[1]["verdict"]
    assert found["limit"] == ["max_rate", "max_acceleration"]
    assert found["limit_unit"] == ["rad s-1", "rad s-2"]
    assert (found["status"], found["active"]) == (["met", "met"], [True, True])
    assert found["peak"] == pytest.approx([V, A])
    assert found["peak_time"] == pytest.approx([20.0, 0.0])


def test_the_table_is_the_turn(default):
    columns = {name: np.array(values) for name, values in default[1]["columns"].items()}
    t = columns["time"]
    expected = bang_coast_bang(t)
    assert np.max(np.abs(columns["angle"] - expected[:, 0])) < ROUND_OFF
    assert np.max(np.abs(columns["angle_rate"] - expected[:, 1])) < ROUND_OFF
    # At a switch and at the end the later side counts.
    inside = np.min(np.abs(t[:, None] - [20.0, 90.0, 110.0]), axis=1) > 1e-6
    assert np.max(np.abs(columns["angle_acceleration"] - expected[:, 2])[inside]) < ROUND_OFF
    axis = np.array([0.0, 0.6, 0.8])
    rotation = Rotation.from_rotvec(expected[:, :1] * axis)
    assert np.max(np.abs(columns["quaternion"] - rotation.as_quat(scalar_first=True))) < ROUND_OFF
    assert np.max(np.abs(columns["rate"] - expected[:, 1:2] * axis)) < ROUND_OFF
    assert np.max(np.abs(columns["acceleration"] - expected[:, 2:] * axis)[inside]) < ROUND_OFF


def test_the_files_hold_the_table_and_the_program(default):
    _, content, out = default
    dataset = xarray.load_dataset(out / "table.nc")
    for name, values in content["columns"].items():
        assert np.array_equal(dataset[name].values, values)
        assert dataset[name].attrs["units"] == content["units"][name]
    assert dataset.attrs["scenario_sha256"] == read_scenario(None, "slew").hash
    with (out / "table.csv").open() as file:
        header, *rows = csv.reader(file)
    assert header[:3] == ["time [s]", "angle [rad]", "angle_rate [rad/s]"]
    assert header[4:8] == ["quaternion_w", "quaternion_x", "quaternion_y", "quaternion_z"]
    assert np.array_equal(np.array(rows, float)[:, 4:8], content["columns"]["quaternion"])
    program = qt.load(out / "program.toml")
    assert isinstance(program, qt.EulerTurn)
    assert np.asarray(program(55.0).quaternion) == pytest.approx(content["columns"]["quaternion"][100], abs=ROUND_OFF)


def test_the_example_passes_its_attitudes_and_tells_the_sign(qtraj, tmp_path):
    result = qtraj("slew", EXAMPLES / "slew_through_attitudes.toml", "--out", tmp_path / "out", "--samples", 11)
    assert (result.exit_code, result.stderr) == (0, "")
    text = result.stdout
    assert "Slew 2 of 2" in text
    assert "the specified quaternion with the opposite sign" in " ".join(text.split())
    assert "max_rate, max_acceleration and max_jerk are active" in text
    wide = [line for line in text.splitlines() if len(line) > 80 and not line.startswith(("Scenario:", str(tmp_path)))]
    assert wide == []
    program = qt.load(tmp_path / "out" / "program.toml")
    passed = Rotation.from_quat(np.stack([program(t).quaternion for t in program.times]), scalar_first=True)
    given = [
        Rotation.from_euler("ZYX", [30.0, 10.0, 0.0], degrees=True),
        Rotation.from_quat([0.2, 0.4, 0.1, 1.0]),
        Rotation.from_quat([0.3, -0.1, -0.9, -0.2], scalar_first=True),
    ]
    assert max((a.inv() * b).magnitude() for a, b in zip(passed, given, strict=True)) < ROUND_OFF


def test_a_polynomial_in_too_short_a_time_is_written_and_judged(qtraj, tmp_path):
    law = '[law]\nkind = "quintic"\nduration = 150\nmax_rate = 1\nmax_acceleration = 0.1\n'
    (tmp_path / "s.toml").write_text(REST + law)
    result = qtraj("slew", tmp_path / "s.toml", "--out", tmp_path / "out", "--json")
    content = json.loads(result.stdout)
    assert result.exit_code == 1
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == sorted(FILES)
    found, angle = content["verdict"], np.pi / 2
    assert found["status"] == ["broken", "met", "no limit"]
    assert found["bound"][2] is None
    rate, acceleration, jerk = found["peak"]
    assert (rate, found["peak_time"][0]) == pytest.approx((15 / 8 * angle / 150, 75.0))
    assert acceleration == pytest.approx(10 / np.sqrt(3) * angle / 150**2)
    assert found["peak_time"][1] == pytest.approx(150 * (0.5 - np.sqrt(3) / 6))
    assert jerk == pytest.approx(60 * angle / 150**3)
    assert found["least_duration"] == pytest.approx(15 / 8 * 90)  # at 1°/s
    assert "max_rate by 12.5 %" in found["result"]
    assert "168.75 s" in found["result"]


def test_more_than_a_whole_turn(qtraj, tmp_path):
    """450° at 1°/s with 0.05°/s²: 450 s, and 20 s to accelerate; the same attitude as after 90°."""
    scenario = tmp_path / "turn.toml"
    scenario.write_text(ABOUT + LAW, encoding="utf-8")
    result = qtraj("slew", scenario, "--json", "--out", tmp_path / "new")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["verdict"]["met"] is True
    program = qt.load(tmp_path / "new" / "program.toml")
    assert float(program.duration) == pytest.approx(470.0, rel=ROUND_OFF)
    assert float(program.angle) == pytest.approx(np.radians(450.0), rel=ROUND_OFF)
    np.testing.assert_allclose(program.end, np.cos(np.pi / 4) * np.array([-1.0, 0.0, 0.0, -1.0]), atol=ROUND_OFF)


def test_no_turn_at_all(qtraj, tmp_path):
    """λ and −λ are one attitude: there is no slew, it takes no time, and there is no axis."""
    (tmp_path / "s.toml").write_text(REST.replace("rotation_vector = [0, 0, 90]", "quaternion = [-2, 0, 0, 0]") + LAW)
    result = qtraj("slew", tmp_path / "s.toml", "--out", tmp_path / "out", "--json")
    content = json.loads(result.stdout)
    assert result.exit_code == 0
    found = content["verdict"]
    assert (found["duration"], found["angle"], found["end_sign"]) == ([0.0], [0.0], -1)
    assert content["columns"]["quaternion"] == [[1.0, 0.0, 0.0, 0.0]]
    assert found["axis_body"] == [[None, None, None]]
    assert "there is no slew" in found["result"]
    assert xarray.load_dataset(tmp_path / "out" / "table.nc").indexes["time"].is_unique


WAITING = """
angles = "deg"
[start]
euler = [30, 10, -50]
sequence = "ZYX"
[[via]]
euler = [30, 10, -410]
sequence = "ZYX"
[end]
rotation_vector = [0, 0, 400]
"""


def test_a_chain_that_first_stays(qtraj, tmp_path):
    """A whole turn of Euler angles is round-off away from none; of a rotation vector the attitude alone counts."""
    (tmp_path / "s.toml").write_text(WAITING + LAW)
    arguments = ("slew", tmp_path / "s.toml", "--out", tmp_path / "out")
    text = " ".join(qtraj(*arguments).stdout.split())
    content = json.loads(qtraj(*arguments, "--json").stdout)
    assert [duration == 0 for duration in content["verdict"]["duration"]] == [True, False]
    expected = Rotation.from_euler("ZYX", [30, 10, -50], degrees=True).inv() * Rotation.from_euler("z", np.radians(40))
    assert content["verdict"]["angle"][1] == pytest.approx(expected.magnitude())
    assert "axis, body - axis, inertial -" in text
    by = f"{np.degrees(expected.magnitude()):.6g}°"
    assert "The rotation vector of [end] has an angle of 400°, more than a half turn." in text
    assert f"The slew is the shorter rotation to the same attitude, {by}." in text
    assert min(fine_times(qt.load(tmp_path / "out" / "program.toml"))) == 0


def test_a_rate_at_the_end_jumps(qtraj, tmp_path):
    (tmp_path / "s.toml").write_text(REST + LAW + "start_rate = -0.25\nend_rate = 0.5\n")
    content = json.loads(qtraj("slew", tmp_path / "s.toml", "--out", tmp_path / "out", "--json").stdout)
    [note] = content["notes"]
    assert note.startswith(
        "The slew starts at -0.25°/s and ends at 0.5°/s, but the program is at rest before and after"
    )


def test_ctrl_c_ends_with_130_and_writes_nothing(qtraj, tmp_path, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(instants_csv, "write_csv", interrupted)
    result = qtraj("slew", "--out", tmp_path / "out")
    assert (result.exit_code, result.stderr) == (130, "interrupted\n")
    assert list(tmp_path.iterdir()) == []


def test_ten_degrees_take_28_284_seconds():
    """The rate limit is not reached: 2√(Φ/A)."""
    part = SlewPart.model_validate(
        {
            "start": {"quaternion": [1, 0, 0, 0]},
            "end": {"rotation_vector": [0, 10, 0]},
            "law": {"max_rate": 1, "max_acceleration": 0.05},
        }
    )
    found = qt.judge_slew(part.program("deg"), {"max_rate": V, "max_acceleration": A})
    assert found.duration == pytest.approx(28.284, abs=5e-4)
    assert np.asarray(found.switches) == pytest.approx([np.sqrt(10 / 0.05)])
    assert float(found.peaks[0]) == pytest.approx(np.radians(0.05 * np.sqrt(200)))
    assert found.active == ["max_acceleration"]


def test_end_rates_reach_the_program():
    law = {"max_rate": 2, "max_acceleration": 0.05, "start_rate": 0.5, "end_rate": -0.25}
    start, end = {"quaternion": [1, 0, 0, 0]}, {"rotation_vector": [0, 10, 0]}
    part = SlewPart.model_validate({"start": start, "end": end, "law": law})
    program = part.program("deg")
    assert np.degrees(program(0.0).rate) == pytest.approx([0, 0.5, 0])
    assert np.degrees(program(program.duration).rate) == pytest.approx([0, -0.25, 0])


def test_end_accelerations_reach_the_program():
    law = {"kind": "s_curve", "max_acceleration": 0.05, "max_jerk": 0.01, "start_rate": 0.5, "end_acceleration": 0.02}
    start, end = {"quaternion": [1, 0, 0, 0]}, {"rotation_vector": [0, 10, 0]}
    program = SlewPart.model_validate({"start": start, "end": end, "law": law}).program("deg")
    assert np.degrees(program(0.0).rate) == pytest.approx([0, 0.5, 0])
    assert np.degrees(program(program.duration).acceleration) == pytest.approx([0, 0.02, 0])


BODY = "[body]\ninertia = [[10, 1, 0.5], [1, 14, -2], [0.5, -2, 20]]\n"


@pytest.mark.parametrize("limit", ["2.0", "[1.0, 2.0, 2.5]"])
def test_a_torque_limit_slows_the_turn_and_is_shown(qtraj, tmp_path, limit):
    fast = "[law]\nmax_rate = 60\nmax_acceleration = 30\n"
    rest = REST.replace("[0, 0, 90]", "[50, 40, -60]")
    (tmp_path / "slew.toml").write_text(rest + fast + BODY + f"max_torque = {limit}\n")
    result = qtraj("slew", tmp_path / "slew.toml", "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    name = "torque" if limit == "2.0" else "torque_x"
    [line] = [line for line in result.stdout.splitlines() if line.split()[:1] == [name]]
    assert "N·m" in line
    assert "active" in line
    content = json.loads(qtraj("slew", tmp_path / "slew.toml", "--out", tmp_path / "out", "--json").stdout)
    assert content["verdict"]["active"][content["verdict"]["limit"].index(f"max_{name}")]
    assert content["units"]["torque"] == "N m"
    table = xarray.load_dataset(tmp_path / "out" / "table.nc")
    assert table["torque"].dims == ("time", "body")
    assert np.linalg.norm(table["torque"], axis=1).max() <= (2.0 if limit == "2.0" else 2.8) * (1 + 1e-9)
    report = qtraj("report", tmp_path / "out", "--out", tmp_path / "out")
    assert report.exit_code == 0, report.output
    assert "torque, body axes" in (tmp_path / "out" / "report.html").read_text()


def test_a_torque_in_a_fixed_time_is_judged(qtraj, tmp_path):
    law = "[law]\nkind = 'quintic'\nduration = 3.0\nmax_rate = 100\n"
    (tmp_path / "slew.toml").write_text(REST + law + BODY + "max_torque = 1.0\n")
    result = qtraj("slew", tmp_path / "slew.toml", "--out", tmp_path / "out", "--json")
    assert result.exit_code == 1
    content = json.loads(result.stdout)
    assert content["verdict"]["status"][content["verdict"]["limit"].index("max_torque")] == "broken"
    (tmp_path / "slew.toml").write_text(
        REST + law.replace("3.0", f"{content['verdict']['least_duration'] * (1 + 1e-9)}") + BODY + "max_torque = 1.0\n"
    )
    assert qtraj("slew", tmp_path / "slew.toml", "--out", tmp_path / "out").exit_code == 0


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("[body]\ninertia = [1, 2]\n", "body.inertia"),
        ("[body]\ninertia = [[1, 2, 0], [0, 1, 0], [0, 0, 1]]\n", "symmetric"),
        ("[body]\ninertia = 2\nmax_torque = [1, 0, 1]\n", "max_torque"),
        ("[body]\nmax_torque = 2\n", "inertia"),
    ],
)
def test_a_body_that_is_none_is_refused(qtraj, tmp_path, body, words):
    (tmp_path / "slew.toml").write_text(REST + LAW + body)
    result = qtraj("slew", tmp_path / "slew.toml", "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert words in result.stderr
