"""`qtraj turn`: the figures of THEORY against independent arithmetic, the files, the refusals."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import xarray
from scipy.spatial.transform import Rotation

import qtraj as qt
from qtraj.cli.turning.job import legs, turn_program
from qtraj.cli.turning.peaks import judged
from qtraj.io.scenario import TURN, read_scenario
from qtraj.io.turn_model import TurnLawPart, TurnPart, TurnScenario

EXAMPLES = Path(__file__).parents[2] / "examples"
FILES = ["program.toml", "table.nc", "table.csv", "turn.png", "turn.svg"]
ROUND_OFF = 1e-12
V, A = np.radians(1.0), np.radians(0.05)  # of the embedded scenario

REST = """
angles = "deg"
[start]
quaternion = [1, 0, 0, 0]
[end]
rotation_vector = [0, 0, 90]
"""
LAW = "[law]\nmax_rate = 1\nmax_acceleration = 0.05\n"


@pytest.fixture(scope="module")
def default(qtraj, tmp_path_factory):
    out = tmp_path_factory.mktemp("turn") / "new"
    result = qtraj("turn", "--json", "--out", out)
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
    assert content["duration"] == pytest.approx(110.0, abs=1e-10)
    [turn] = content["turns"]
    assert turn["switches"] == pytest.approx([20.0, 90.0])
    assert turn["angle"] == pytest.approx(np.pi / 2)
    assert turn["axis_body"] == pytest.approx([0.0, 0.6, 0.8], abs=ROUND_OFF)
    assert content["end"]["sign"] == 1
    assert content["files"] == [str(out / name) for name in FILES]
    assert all((out / name).stat().st_size > 200 for name in FILES)


def test_both_limits_bind_and_the_peaks_have_their_times(default):
    limits = default[1]["limits"]
    assert {name: (entry["status"], entry["binding"]) for name, entry in limits.items()} == {
        "max_rate": ("met", True),
        "max_acceleration": ("met", True),
    }
    assert (limits["max_rate"]["value"], limits["max_rate"]["time"]) == pytest.approx((V, 20.0))
    assert (limits["max_acceleration"]["value"], limits["max_acceleration"]["time"]) == pytest.approx((A, 0.0))


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
    assert dataset.attrs["scenario_sha256"] == read_scenario(TURN, TurnScenario).hash
    with (out / "table.csv").open() as file:
        header, *rows = csv.reader(file)
    assert header[:3] == ["time [s]", "angle [rad]", "angle_rate [rad/s]"]
    assert header[4:8] == ["qw", "qx", "qy", "qz"]
    assert np.array_equal(np.array(rows, float)[:, 4:8], content["columns"]["quaternion"])
    program = qt.load(out / "program.toml")
    assert isinstance(program, qt.EulerTurn)
    assert np.asarray(program(55.0).quaternion) == pytest.approx(content["columns"]["quaternion"][100], abs=ROUND_OFF)


def test_the_example_passes_its_attitudes_and_tells_the_sign(qtraj, tmp_path):
    result = qtraj("turn", EXAMPLES / "turn_through_attitudes.toml", "--out", tmp_path / "out", "--samples", 11)
    assert (result.exit_code, result.stderr) == (0, "")
    text = result.stdout
    assert "Turn 2 of 2" in text
    assert "the given quaternion with the other sign" in " ".join(text.split())
    assert "max_rate, max_acceleration and max_jerk bind" in text
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
    result = qtraj("turn", tmp_path / "s.toml", "--out", tmp_path / "out", "--json")
    content = json.loads(result.stdout)
    assert result.exit_code == 1
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == sorted(FILES)
    rate, acceleration, jerk = content["limits"].values()
    assert (rate["status"], acceleration["status"], jerk["status"]) == ("broken", "met", None)
    angle = np.pi / 2
    assert (rate["value"], rate["time"]) == pytest.approx((15 / 8 * angle / 150, 75.0))
    assert acceleration["value"] == pytest.approx(10 / np.sqrt(3) * angle / 150**2)
    assert acceleration["time"] == pytest.approx(150 * (0.5 - np.sqrt(3) / 6))
    assert jerk["value"] == pytest.approx(60 * angle / 150**3)
    assert content["least_duration"] == pytest.approx(15 / 8 * 90)  # at 1°/s
    assert "max_rate by 12.5 %" in content["result"]
    assert "168.75 s" in content["result"]


def test_no_turn_at_all(qtraj, tmp_path):
    """λ and −λ are one attitude: there is nothing to turn, and it takes no time."""
    (tmp_path / "s.toml").write_text(REST.replace("rotation_vector = [0, 0, 90]", "quaternion = [-2, 0, 0, 0]") + LAW)
    result = qtraj("turn", tmp_path / "s.toml", "--out", tmp_path / "out", "--samples", 2, "--json")
    content = json.loads(result.stdout)
    assert result.exit_code == 0
    assert (content["duration"], content["angle"], content["end"]["sign"]) == (0.0, 0.0, -1)
    assert content["columns"]["quaternion"] == [[1.0, 0.0, 0.0, 0.0]] * 2


def test_ten_degrees_take_28_284_seconds():
    """The rate limit is not reached: 2√(Φ/A)."""
    part = TurnPart.model_validate(
        {
            "start": {"quaternion": [1, 0, 0, 0]},
            "end": {"rotation_vector": [0, 10, 0]},
            "law": {"max_rate": 1, "max_acceleration": 0.05},
        }
    )
    turns = legs(turn_program(part, "deg"))
    assert turns[0].end == pytest.approx(28.284, abs=5e-4)
    assert turns[0].switches() == pytest.approx([np.sqrt(10 / 0.05)])
    found = judged(turns, {"max_rate": V, "max_acceleration": A}, ["max_rate", "max_acceleration"])
    assert found["max_rate"]["value"] == pytest.approx(np.radians(0.05 * np.sqrt(200)))
    assert [entry["binding"] for entry in found.values()] == [False, True]


def test_end_rates_reach_the_program():
    law = {"max_rate": 2, "max_acceleration": 0.05, "start_rate": 0.5, "end_rate": -0.25}
    start, end = {"quaternion": [1, 0, 0, 0]}, {"rotation_vector": [0, 10, 0]}
    part = TurnPart.model_validate({"start": start, "end": end, "law": law})
    program = turn_program(part, "deg")
    assert np.degrees(program(0.0).rate) == pytest.approx([0, 0.5, 0])
    assert np.degrees(program(program.duration).rate) == pytest.approx([0, -0.25, 0])


@pytest.mark.parametrize(
    ("law", "missing"),
    [({}, "max_acceleration"), ({"kind": "s_curve", "max_acceleration": 1.0}, "max_jerk")],
)
def test_laws_say_what_they_need(law, missing):
    with pytest.raises(ValueError, match=f"the key '{missing}' is missing"):
        TurnLawPart.model_validate(law)


BAD = {
    "no unit": (REST.replace('angles = "deg"', "") + LAW, ["the key 'angles' is missing", "'deg' or 'rad'"]),
    "another unit": (REST.replace('"deg"', '"grad"') + LAW, ["the key 'angles' holds 'grad'", "'deg' or 'rad'"]),
    "no law": (REST, ["the key 'law' is missing", "a table [law]"]),
    "no end": (REST.split("[end]")[0] + LAW, ["the key 'end' is missing"]),
    "no attitude": (REST.replace("quaternion = [1, 0, 0, 0]", "") + LAW, ["[start]: there is no attitude"]),
    "two attitudes": (REST.replace("[end]", "[end]\ngibbs = [0, 0, 1]") + LAW, ["[end]: there are several attitudes"]),
    "a zero quaternion": (REST.replace("[1, 0", "[0, 0") + LAW, ["[start]: the quaternion is zero"]),
    "three components": (
        REST.replace("[1, 0, 0, 0]", "[1, 0, 0]") + LAW,
        ["'start.quaternion' holds [1, 0, 0]", "four finite numbers"],
    ),
    "angles without a sequence": (
        REST.replace("rotation_vector", "euler") + LAW,
        ["[end]: euler and sequence belong together"],
    ),
    "a strange sequence": (
        REST.replace("rotation_vector", "sequence = 'xxy'\neuler") + LAW,
        ["an Euler sequence must be", "'xxy' was given"],
    ),
    "a misspelt limit": (
        REST + LAW.replace("max_rate", "maxrate"),
        ["unknown key 'law.maxrate'", "did you mean 'max_rate'?"],
    ),
    "a misspelt key in a list": (
        REST + "[[via]]\ngibs = [0, 0, 1]\n" + LAW,
        ["unknown key 'via[0].gibs'", "did you mean 'gibbs'?"],
    ),
    "a text for a component": (
        REST + "[[via]]\ngibbs = [0, 'x', 1]\n" + LAW,
        ["'via[0].gibbs[1]' holds 'x'", "three finite numbers"],
    ),
    "a negative limit": (REST + LAW.replace("= 1", "= -1"), ["'law.max_rate' holds -1", "angle per s"]),
    "another law": (REST + LAW + "kind = 'linear'\n", ["'law.kind' holds 'linear'", "'time_optimal', 's_curve'"]),
    "a jerk of jumps": (REST + LAW + "max_jerk = 1\n", ["[law]: a time_optimal turn has jumps"]),
    "an end rate of a smooth law": (
        REST + LAW + "kind = 'cubic'\nend_rate = 0.1\n",
        ["[law]: the key 'end_rate' belongs to 'time_optimal'"],
    ),
    "an end rate beyond the limit": (
        REST + LAW + "end_rate = 3\n",
        ["'end_rate' holds 3", "no more than max_rate = 1"],
    ),
    "an end rate of a chain": (
        REST + "[[via]]\ngibbs = [0, 0, 1]\n" + LAW + "end_rate = 0.1\n",
        ["the key 'law.end_rate' suits no chain of turns"],
    ),
    "nothing that takes time": (REST + "[law]\nkind = 'cubic'\n", ["needs a duration or a limit"]),
    "too short a time": (REST + LAW + "duration = 100\n", ["[law]: a turn by", "in 100 s", "Allow more time"]),
    "a saved program": ("format = 'qtraj/1'\ntype = 'EulerTurn'\n", ["unknown key 'format'"]),
}


@pytest.mark.parametrize("content", BAD.values(), ids=BAD)
def test_bad_scenarios(qtraj, tmp_path, content):
    text, fragments = content
    file = tmp_path / "scenario.toml"
    file.write_text(text)
    result = qtraj("turn", file, "--out", tmp_path / "out")
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert result.stderr.startswith(f"error: {file}: ")
    assert result.stderr.count("\n") == 1
    for fragment in fragments:
        assert fragment in result.stderr
    assert list(tmp_path.iterdir()) == [file]
