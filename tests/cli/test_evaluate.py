"""`qtraj evaluate`: tables on the terminal, as JSON, netCDF and CSV."""

import json
from pathlib import Path

import numpy as np
import pytest
import xarray

import qtraj as qt

EXAMPLES = Path(__file__).parents[2] / "examples"

R, RATE, CLIMB = 10.0, 0.39269908169872414, 0.25  # examples/helix.toml
HELIX = EXAMPLES / "helix.toml"
ROUND_OFF = 1e-12


def test_the_helix_has_the_values_of_its_closed_form(qtraj):
    result = qtraj("evaluate", HELIX, "--samples", 7, "--json")
    assert result.exit_code == 0
    content = json.loads(result.stdout)
    columns = {name: np.array(values) for name, values in content["columns"].items()}
    t = columns["time"]
    assert t == pytest.approx(np.linspace(0, 24, 7))
    square = (R * RATE) ** 2 + CLIMB**2
    position = np.stack([100 + R * np.cos(RATE * t), 50 + R * np.sin(RATE * t), CLIMB * t], axis=1)
    assert np.max(np.abs(columns["position"] - position)) < 1e-10
    assert columns["speed"] == pytest.approx(np.full(7, np.sqrt(square)), rel=ROUND_OFF)
    assert columns["curvature"] == pytest.approx(np.full(7, R * RATE**2 / square), rel=ROUND_OFF)
    assert columns["torsion"] == pytest.approx(np.full(7, CLIMB * RATE / square), rel=ROUND_OFF)
    climb = np.arctan2(CLIMB, R * RATE)
    rate = [RATE * np.sin(climb), 0.0, RATE * np.cos(climb)]  # of the upright frame: it yaws about the world's vertical
    assert content["frame"] == "upright"
    assert columns["rate"] == pytest.approx(np.tile(rate, (7, 1)), abs=ROUND_OFF)
    assert np.all(np.sum(columns["quaternion"][1:] * columns["quaternion"][:-1], axis=1) >= 0)
    assert content["path"]["length"] == pytest.approx(24 * np.sqrt(square))
    assert content["units"]["curvature"] == "m-1"


def test_the_terminal_shows_it_within_80_columns(qtraj):
    result = qtraj("evaluate", HELIX, "--step", 4)
    assert result.exit_code == 0
    assert "24.0000 s" in result.stdout
    assert "540.00°" in result.stdout
    assert "0.099596" in result.stdout  # the curvature
    wide = [line for line in result.stdout.splitlines() if len(line) > 80 and not line.startswith("Scenario:")]
    assert wide == []
    assert result.stdout.count("24.000 ") == 2  # the end is there, in both blocks


def test_files_hold_the_table(qtraj, tmp_path):
    out = tmp_path / "out"
    result = qtraj("evaluate", HELIX, "--samples", 7, "--out", out, "--json")
    content = json.loads(result.stdout)
    assert content["files"] == [str(out / "table.nc"), str(out / "table.csv")]
    dataset = xarray.load_dataset(out / "table.nc")
    for name, values in content["columns"].items():
        assert np.array_equal(dataset[name].values, values)
        assert dataset[name].attrs["units"] == content["units"][name]
    assert dataset.attrs["scenario_sha256"] == content["scenario"]["sha256"]
    track = qt.read_track(out / "table.csv")
    assert np.array_equal(track.times, content["columns"]["time"])
    assert np.array_equal(track.positions, content["columns"]["position"])
    assert np.array_equal(track.velocities, content["columns"]["velocity"])
    assert np.array_equal(track.attitudes, content["columns"]["quaternion"])


def test_further_outputs_are_added_to_the_files_and_to_json(qtraj, tmp_path):
    options = ("--samples", 3, "--also", "yaw_rate", "--also", "dcm", "--out", tmp_path / "out", "--json")
    content = json.loads(qtraj("evaluate", HELIX, *options).stdout)
    climbing = R * RATE / np.hypot(R * RATE, CLIMB)  # the cosine of the climb, about whose normal the frame yaws
    assert content["columns"]["yaw_rate"] == pytest.approx([RATE * climbing] * 3)
    assert content["units"]["yaw_rate"] == "rad s-1"
    header = (tmp_path / "out" / "table.csv").read_text().splitlines()[0].split(",")
    assert header[-10:-7] == ["yaw_rate [rad/s]", "dcm_forward_x", "dcm_forward_y"]
    refused = qtraj("evaluate", HELIX, "--also", "colour")
    assert refused.exit_code == 2
    assert "unknown output 'colour'; the known outputs are position" in refused.stderr


def test_outputs_of_a_vehicle_need_its_keys(qtraj, tmp_path):
    states = (EXAMPLES / "ramp_from_states.toml").read_text()
    for vehicle, name, expected in (
        ("", "power", "--also power needs a vehicle: add a table [vehicle] with the mass"),
        ("\n[vehicle]\nmass = 1e3\n", "moment", "--also moment needs the vehicle's inertia: set the key"),
    ):
        (tmp_path / "scenario.toml").write_text(states + vehicle)
        refused = qtraj("evaluate", tmp_path / "scenario.toml", "--also", name)
        assert refused.exit_code == 2
        assert expected in refused.stderr
    inertia = "inertia = [[9e2, 0, 10], [0, 2e3, 0], [10, 0, 2.2e3]]\n"
    (tmp_path / "scenario.toml").write_text(states + vehicle + inertia)
    content = json.loads(qtraj("evaluate", tmp_path / "scenario.toml", "--also", "moment", "--json").stdout)
    assert content["units"]["moment"] == "N m"


def test_moments_are_printed_for_principal_axes_and_refused_for_others(qtraj, tmp_path):
    result = qtraj("evaluate", EXAMPLES / "free_flyer.toml", "--samples", 3)
    assert result.exit_code == 0
    assert "moments M that rotate the vehicle with the natural trihedral [N·m]" in result.stdout
    assert "|M_τ|" in result.stdout
    content = json.loads(qtraj("evaluate", EXAMPLES / "free_flyer.toml", "--samples", 3, "--json").stdout)
    assert content["units"]["normal_moment"] == "N m"
    states = (EXAMPLES / "ramp_from_states.toml").read_text().replace("[limits]", "[limits]\nnormal_moment = 1e3")
    vehicle = "\n[vehicle]\nmass = 1e3\n"
    products = vehicle + "inertia = [[9e2, 0, 10], [0, 2e3, 0], [10, 0, 2.2e3]]\n"
    for text, expected in (
        ("", "limits.normal_moment needs a vehicle: add a table [vehicle] with the mass"),
        (vehicle, "limits.normal_moment needs the vehicle's inertia: set the key 'vehicle.inertia' [kg m²]"),
        (products, "limits.normal_moment needs an inertia whose principal axes are τ, n and b, but"),
    ):
        (tmp_path / "scenario.toml").write_text(states + text)
        refused = qtraj("evaluate", tmp_path / "scenario.toml")
        assert refused.exit_code == 2
        assert expected in refused.stderr
        assert refused.stderr.count("\n") == 1


def test_a_scenario_is_evaluated_before_tuning(qtraj):
    result = qtraj("evaluate", EXAMPLES / "ramp_from_states.toml", "--samples", 7, "--json")
    columns = json.loads(result.stdout)["columns"]
    ends = [columns["position"][0], columns["position"][-1]]
    assert ends == [pytest.approx([12, 0, 0]), pytest.approx([0, 12, 1.5], abs=1e-12)]
    assert columns["velocity"][0] == pytest.approx([0, 4.75, 0], abs=1e-12)


def test_accelerations_are_met_by_a_polynomial_angle(qtraj, tmp_path):
    state = "position = [{}]\nvelocity = [{}]\nacceleration = [{}]\n"
    start = state.format("12.0, 0.0, 0.0", "0.5, 5.0, 0.0", "0.1, 0.2, 0.3")
    end = state.format("0.0, 12.0, 1.5", "-4.5, 0.0, 0.2", "0.0, -1.0, 0.0")
    text = f"duration = 4.0\nturns = 1\n[start]\n{start}[end]\n{end}[tune]\nmotion = 'hermite'\n"
    (tmp_path / "s.toml").write_text(text)
    content = json.loads(qtraj("evaluate", tmp_path / "s.toml", "--samples", 2, "--json").stdout)
    columns = content["columns"]
    assert columns["acceleration"] == [pytest.approx([0.1, 0.2, 0.3]), pytest.approx([0, -1, 0], abs=1e-9)]
    assert content["path"]["turn"] == pytest.approx(2.5 * np.pi)


@pytest.mark.parametrize(
    ("frame", "labels"),
    [
        ("upright", ["forward", "left", "up"]),
        ("natural", ["tangent", "normal", "binormal"]),
        ("rotation-minimizing", ["tangent", "first", "second"]),
        ("thrust-aligned", ["forward", "left", "thrust"]),
    ],
)
def test_the_frame_is_chosen_and_names_the_columns(qtraj, tmp_path, frame, labels):
    options = ("--samples", 5, "--frame", frame, "--out", tmp_path / "out")
    result = qtraj("evaluate", HELIX, *options)
    assert result.exit_code == 0, result.output
    assert f"of the {frame} frame" in result.stdout
    assert all(
        len(line) <= 80 for line in result.stdout.splitlines() if "Scenario:" not in line and "table." not in line
    )
    header = (tmp_path / "out" / "table.csv").read_text().splitlines()[0]
    assert header.endswith(",".join(f"rate_{label} [rad/s]" for label in labels))
    dataset = xarray.load_dataset(tmp_path / "out" / "table.nc")
    assert (dataset.attrs["frame"], dataset["body"].values.tolist()) == (frame, labels)
    rolling = {"upright": RATE * CLIMB / np.hypot(R * RATE, CLIMB), "rotation-minimizing": 0.0}
    rolling["natural"] = rolling["upright"]  # on a helix both turn about the vertical
    sine = np.sin(np.arctan2(R * RATE**2, 9.80665))  # of the bank; x points up by what the velocity has across z
    rolling["thrust-aligned"] = RATE * CLIMB * sine**2 / np.hypot(R * RATE, CLIMB * sine)
    assert dataset["rate"].values[:, 0] == pytest.approx(np.full(5, rolling[frame]), abs=ROUND_OFF)


def test_changing_sides_does_not_roll_the_vehicle_over(qtraj, tmp_path):
    """The natural trihedral turns over where the bend changes sides; the frame of a vehicle does not."""
    bends = qt.SpiralHelix([50.0, 0.0, 3.0, -2.0], [0.0, 0.2], [0.0, 0.0], 1.0)
    bends.save(tmp_path / "s_bend.json")
    up = {}
    for frame in ("upright", "natural"):
        content = json.loads(
            qtraj("evaluate", tmp_path / "s_bend.json", "--frame", frame, "--also", "dcm", "--json").stdout
        )
        up[frame] = np.array(content["columns"]["dcm"])[:, 2, 2]
    assert up["natural"].min() < -0.9 < 0.9 < up["natural"].max()
    assert up["upright"].min() > 0.999


def test_where_there_is_no_trihedral_a_dash_stands(qtraj, tmp_path):
    straight = qt.SpiralHelix([1.0, 2.0, 0.0, 0.0], [0.3, 0.0], [0.0, 0.5, 0.0, 0.0], 3.0, qt.Placement())
    straight.save(tmp_path / "straight.json")
    upright = qtraj("evaluate", tmp_path / "straight.json", "--samples", 7)
    assert "does not exist" not in upright.stdout
    assert sum(line.rstrip().endswith(" -") for line in upright.stdout.splitlines()) == 7
    result = qtraj("evaluate", tmp_path / "straight.json", "--samples", 7, "--frame", "natural")
    assert result.exit_code == 0
    assert "the natural frame does not exist (zero speed or zero curvature) at 7 instants" in " ".join(
        result.stdout.split()
    )


@pytest.mark.parametrize("step", ["0", "-1", "nan", "1e-9"])
def test_a_step_that_makes_no_sense(qtraj, step):
    result = qtraj("evaluate", HELIX, "--step", step)
    assert result.exit_code == 2
    assert "--step" in result.stderr
    assert result.stdout == ""


def test_too_many_samples(qtraj):
    result = qtraj("evaluate", HELIX, "--samples", 10**9)
    assert result.exit_code == 2
    assert "must be at most 1000000" in result.stderr


def test_samples_and_step_exclude_each_other(qtraj):
    result = qtraj("evaluate", HELIX, "--step", 1, "--samples", 5)
    assert result.exit_code == 2
    assert "pass one of them" in result.stderr
