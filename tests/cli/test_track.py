"""`qtraj track`: the error against independent arithmetic, the examples, failures, the refusals."""

import csv
import json
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
import xarray
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

import qtraj as qt
from qtraj.cli.tracking.findings import settling_time
from qtraj.cli.tracking.job import Sinusoid, feedback_law, prepare
from qtraj.io.feedback_part import FeedbackPart
from qtraj.io.scenario import TRACK, read_scenario
from qtraj.io.tracking_model import TrackingScenario

EXAMPLES = Path(__file__).parents[2] / "examples"
FILES = ["solution.toml", "table.nc", "table.csv", "track.png", "track.svg"]
DEVIATION = 1e-9  # of a closed loop from its closed form at the default tolerances
ROUND_OFF = 1e-12

TURN = """
angles = "deg"
[program.turn.start]
quaternion = [1, 0, 0, 0]
[program.turn.end]
rotation_vector = [0, 0, 30]
[program.turn.law]
max_acceleration = 20
"""
LAW = "[law]\nsettling_time = 3\n"


@pytest.fixture(scope="module")
def default(qtraj, tmp_path_factory):
    out = tmp_path_factory.mktemp("track") / "new"
    result = qtraj("track", "--json", "--out", out)
    return result, json.loads(result.stdout), out


@pytest.fixture
def prepared(tmp_path):
    def prepared(text):
        (tmp_path / "s.toml").write_text(text)
        return prepare(read_scenario(tmp_path / "s.toml", TrackingScenario))

    return prepared


def columns_of(content):
    return {name: np.array(values, float) for name, values in content["columns"].items()}


def test_the_embedded_loop_follows_its_closed_form(default):
    result, content, out = default
    assert (result.exit_code, result.stderr) == (0, "")
    assert content["finished"]
    assert content["findings"]["closed_form"]["applies"]
    assert content["findings"]["closed_form"]["deviation"] < DEVIATION
    assert content["findings"]["norm"]["drift"] < DEVIATION
    assert content["files"] == [str(out / name) for name in FILES]
    assert all((out / name).stat().st_size > 500 for name in FILES)


def test_the_error_is_the_exponential_of_a_matrix(default):
    """From the keys of the scenario, without the library: (1 + kt)e^(−kt) = 0.02 at 40 s, so k = 5.834/40."""
    content = default[1]
    columns = columns_of(content)
    k1, k2 = content["law"]["k1"], content["law"]["k2"]
    k = k1 / 2
    assert k2 == pytest.approx(k**2)
    assert (1 + 40 * k) * np.exp(-40 * k) == pytest.approx(0.02)
    mu = Rotation.from_rotvec([20.0, -9.0, 12.0], degrees=True).as_quat(scalar_first=True)
    rate = np.radians([0.3, 0.2, -0.4])
    # 2μ̇ = μ∘(0, Ω): the program is at rest at the start.
    slope = 0.5 * np.array([-mu[1:] @ rate, *(mu[0] * rate + np.cross(mu[1:], rate))])
    move = [expm(np.array([[0.0, 1.0], [-k2, -k1]]) * t)[0] for t in columns["time"][::60]]
    expected = np.array([a * (mu - [1, 0, 0, 0]) + b * slope + [1, 0, 0, 0] for a, b in move])
    assert np.max(np.abs(columns["error"][::60] - expected)) < DEVIATION
    angle = 2 * np.arctan2(np.linalg.norm(expected[:, 1:], axis=1), np.abs(expected[:, 0]))
    assert np.max(np.abs(columns["angle"][::60] - angle)) < DEVIATION


def test_the_findings_follow_from_the_table(default):
    content = default[1]
    columns, found = columns_of(content), content["findings"]
    assert found["initial_angle"] == pytest.approx(np.radians(25.0))
    assert found["final_angle"] == columns["angle"][-1]
    settled = found["settled"]["time"]
    assert np.interp(settled, columns["time"], columns["angle"]) == pytest.approx(np.radians(1.0))
    assert np.all(columns["angle"][columns["time"] > settled] < np.radians(1.0))
    sizes = np.linalg.norm(columns["command"][:, 1:], axis=1)
    assert found["peak_command"] == {"value": pytest.approx(sizes.max()), "time": columns["time"][sizes.argmax()]}
    assert (found["norm"]["least"], found["norm"]["largest"]) == (columns["norm"].min(), columns["norm"].max())


def test_the_files_hold_the_motion(default):
    _, content, out = default
    dataset = xarray.load_dataset(out / "table.nc")
    for name, values in content["columns"].items():
        assert np.array_equal(dataset[name].values, values)
        assert dataset[name].attrs["units"] == content["units"][name]
    assert dataset.attrs["scenario_sha256"] == read_scenario(TRACK, TrackingScenario).hash
    solution = qt.load(out / "solution.toml")
    assert isinstance(solution, qt.Solution)
    assert np.array_equal(solution.quaternion, content["columns"]["quaternion"])
    with (out / "table.csv").open() as file:
        header, *rows = csv.reader(file)
    table = dict(zip(header, np.array(rows, float).T, strict=True))
    assert np.array_equal(table["angle [rad]"], content["columns"]["angle"])
    assert np.array_equal(table["command_x [rad/s²]"], np.array(content["columns"]["command"])[:, 1])


def test_a_path_is_followed(qtraj, tmp_path):
    result = qtraj("track", EXAMPLES / "track_ramp.toml", "--out", tmp_path / "out")
    assert (result.exit_code, result.stderr) == (0, "")
    text = " ".join(result.stdout.split())
    assert "natural frame of ramp_from_states.toml" in text
    assert "error at the start 13°, on the near sheet" in text
    assert "closed form met within" in text
    wide = [
        line
        for line in result.stdout.splitlines()
        if len(line) > 80 and not line.startswith(("Scenario:", str(tmp_path)))
    ]
    assert wide == []
    # The program is the trihedral of the path, which turns by a quarter while it climbs.
    program = xarray.load_dataset(tmp_path / "out" / "table.nc")["program_quaternion"].values
    tangent = Rotation.from_quat(program, scalar_first=True).apply([1.0, 0.0, 0.0])
    headings = np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))
    assert headings[-1] - headings[0] == pytest.approx(np.pi / 2)


def test_a_real_loop_has_no_closed_form(qtraj, tmp_path):
    result = qtraj("track", EXAMPLES / "track_disturbed.toml", "--out", tmp_path / "out", "--json")
    content = json.loads(result.stdout)
    assert (result.exit_code, content["finished"]) == (0, True)
    closed = content["findings"]["closed_form"]
    assert (closed["applies"], closed["deviation"]) == (False, None)
    assert "disturbance" in closed["reason"]
    assert content["findings"]["norm"]["drift"] is None
    columns = columns_of(content)
    commands = np.linalg.norm(columns["command"][:, 1:], axis=1)
    assert commands.max() == pytest.approx(np.radians(4.0))  # the limit
    held = columns["command"][2:5]  # 0.2, 0.3 and 0.4 s: renewed at 0.25 s
    assert not np.array_equal(held[0], held[1])
    assert np.array_equal(held[1], held[2])
    assert content["findings"]["settled"]["time"] < 15


def test_a_stop_is_written_and_explained(qtraj, tmp_path):
    """From −λ on the program, μ = −1: the error runs straight through zero, where there is no command."""
    (tmp_path / "s.toml").write_text(TURN + '[law]\nk1 = 2\nk2 = 1\n[error]\nsign = "far"\n')
    result = qtraj("track", tmp_path / "s.toml", "--out", tmp_path / "out", "--json")
    content = json.loads(result.stdout)
    assert result.exit_code == 1
    assert not content["finished"]
    assert "far sheet" in content["result"]
    assert "sign = 'auto' in [error]" in content["result"]
    assert content["start"]["sheet"] == "far"
    assert content["findings"]["final_angle"] is None
    assert content["findings"]["settled"]["time"] is None
    assert "did not finish" in content["findings"]["closed_form"]["reason"]
    assert content["columns"]["angle"][-1] is None
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == sorted(FILES)


def test_a_baseline_under_a_constant_disturbance_stays_beside_the_program(qtraj, tmp_path):
    """After the turn Ω̇ = −K1Ω − K2e + d rests where K2 sin Φ = |d|."""
    text = TURN + '[law]\nkind = "geometric"\nk1 = 4.0\nk2 = 4.0\n[disturbance]\nacceleration = [0, 20, 0]\n'
    (tmp_path / "s.toml").write_text(text + "[simulation]\nduration = 20\nsamples = 21\nsettled = 6\n")
    result = qtraj("track", tmp_path / "s.toml", "--out", tmp_path / "out", "--json")
    content = json.loads(result.stdout)
    assert result.exit_code == 0
    found = content["findings"]
    assert np.sin(found["final_angle"]) == pytest.approx(np.radians(20.0) / 4.0, abs=1e-6)
    assert "not linear" in found["closed_form"]["reason"]
    assert "closed_form_angle" not in content["columns"]
    assert found["norm"]["drift"] < DEVIATION  # nothing steers |λ|
    assert found["settled"]["time"] == 0.0


@pytest.mark.parametrize(
    ("table", "gains"),
    [
        ({"kind": "inertial", "k1": 3, "k2": 2.0}, (3.0, 2.0)),
        ({"kind": "body", "damping": 0.5, "frequency": 3.0}, (3.0, 9.0)),
        ({"kind": "additive", "weights": {"error": 16.0, "rate": 1.0}}, (3.0, 4.0)),
        ({"kind": "quaternion", "k1": [1, 2, 3.0], "k2": np.eye(3).tolist()}, ([1, 2, 3], np.eye(3))),
        ({"kind": "body", "k1": np.eye(4).tolist(), "k2": [1, 2, 3, 4]}, (np.eye(4), [1, 2, 3, 4])),
    ],
)
def test_gains(table, gains):
    law = feedback_law(FeedbackPart.model_validate(table))
    assert np.asarray(law.k1) == pytest.approx(np.array(gains[0]))
    assert np.asarray(law.k2) == pytest.approx(np.array(gains[1]))
    assert getattr(law, "error", "quaternion") == table["kind"]


def test_the_gain_of_a_rate_law():
    law = feedback_law(FeedbackPart(kind="rate", settling_time=2.0, residual=0.01))
    assert isinstance(law, qt.RateLaw)
    assert np.exp(-2.0 * float(law.k)) == pytest.approx(0.01)


def test_the_sign_is_chosen(prepared):
    """An error of 200° is one of 160° from the other side: μ0 = cos 100° < 0."""
    error = "[error]\nrotation_vector = [200, 0, 0]\nsign = '{}'\n"
    signs = {sign: prepared(TURN + LAW + error.format(sign)) for sign in ("near", "far", "auto")}
    near = signs["near"].quaternion
    assert float(near[0]) == pytest.approx(np.cos(np.radians(80)))
    assert np.array_equal(signs["far"].quaternion, -near)
    assert np.array_equal(signs["auto"].quaternion, near)  # at rest the nearer one
    assert [signs[name].flipped for name in ("near", "far", "auto")] == [False, True, False]


def test_the_gibbs_gauge(prepared):
    job = prepared(TURN + LAW + "[error]\nrotation_vector = [90, 0, 0]\nrate = [10, 0, 0]\ngauge = 'gibbs'\n")
    assert np.asarray(job.quaternion) == pytest.approx([1, 1, 0, 0])  # μ0 = 1, μ_v = tan 45°
    assert np.asarray(job.rate) == pytest.approx([np.radians(10), np.radians(10), 0, 0])


def test_everything_around_the_body_is_in_radians(prepared):
    job = prepared(
        TURN
        + LAW
        + "[sensor]\nsampling = 0.1\nrate_bias = [1, 2, 3]\nattitude_noise = 0.5\nseed = 3\n"
        + "[actuator]\nlimit = [1, 2, 3]\nsaturation = 'axis'\n"
        + "[disturbance]\ntorque = [3, 2, 1]\ninertia = [1.5, 1, 0.5]\nperiod = 4\nphase = 90\n"
    )
    assert np.asarray(job.sensor.rate_bias) == pytest.approx(np.radians([1, 2, 3]))
    assert float(job.sensor.attitude_noise) == pytest.approx(np.radians(0.5))
    assert np.asarray(job.actuator.limit) == pytest.approx(np.radians([1, 2, 3]))
    assert np.asarray(job.disturbance.acceleration(jnp.asarray(0.0))) == pytest.approx([2, 2, 2])
    assert np.asarray(job.disturbance.acceleration(jnp.asarray(2.0))) == pytest.approx([-2, -2, -2])


def test_a_sinusoid():
    wave = Sinusoid(jnp.array([1.0, -2.0, 0.0]), 8.0, np.pi / 2)
    assert np.asarray(wave(jnp.asarray(1.0))) == pytest.approx(np.array([1.0, -2.0, 0.0]) / np.sqrt(2))


@pytest.mark.parametrize(
    ("angle", "expected"),
    [
        ([3.0, 2.0, 0.5, 0.2], 1 + 1 / 1.5),
        ([3.0, 0.5, 2.0, 0.0], 2.5),
        ([0.5, 0.2, 0.1, 0.9], 0.0),
        ([3.0, 0.5, 0.5, 2.0], None),
        ([3.0, 0.5, np.nan, np.nan], None),
    ],
)
def test_settling(angle, expected):
    found = settling_time(np.arange(4.0), np.array(angle), 1.0)
    assert found is None if expected is None else found == pytest.approx(expected)


BAD = {
    "an empty file": ("", ["the key 'angles' is missing", "and 2 more"]),
    "no program": (
        "angles = 'deg'\n[program]\n" + LAW,
        ["[program]: there is no program", "path = 'a path scenario", "file = 'a saved"],
    ),
    "two programs": (
        TURN + "[program]\nfile = 'p.toml'\n" + LAW,
        ["[program]: there are several programs (turn"],
    ),
    "a frame of a turn": (TURN + "[program]\nframe = 'natural'\n" + LAW, ["the key 'frame' belongs to a path"]),
    "a misspelt limit": (
        TURN.replace("max_acc", "max_ac") + LAW,
        ["unknown key 'program.turn.law.max_aceleration'", "did you mean 'max_acceleration'?"],
    ),
    "an impossible turn": (TURN + "duration = 0.1\n" + LAW, ["[law]: a turn by", "Allow more time"]),
    "no gains": (TURN + "[law]\n", ["[law]: there are no gains", "settling_time", "[law.weights]"]),
    "two gains": (TURN + LAW + "damping = 1\nfrequency = 1\n", ["there are several gains (settling_time, damping)"]),
    "one gain of two": (TURN + "[law]\nk1 = 1\n", ["the key 'k2' is missing: k1 and k2 belong together"]),
    "a gain that is a text": (TURN + "[law]\nk1 = 'x'\nk2 = 1\n", ["'law.k1' holds 'x'", "a finite number, a list"]),
    "a gain beyond floats": (TURN + f"[law]\nk1 = 1{'0' * 400}\nk2 = 1\n", ["'law.k1' holds 1000"]),
    "a ragged gain": (TURN + "[law]\nk1 = [[1, 2], [3]]\nk2 = 1\n", ["'law.k1' holds [[1, 2], [3]]", "square matrix"]),
    "a small gain": (TURN + "[law]\nk1 = [1, 2, 3]\nk2 = 1\n", ["a gain of size 3", "4 for a diagonal"]),
    "a gain of another law": (TURN + "[law]\nk = 1\n", ["the key 'k' does not suit the kind 'body'"]),
    "a residual of nothing": (
        TURN + "[law]\nk1 = 1\nk2 = 1\nresidual = 0.1\n",
        ["'residual' belongs to"],
    ),
    "an infinite weight": (TURN + "[law.weights]\nerror = inf\n", ["'law.weights.error' holds inf", "[1/s⁴]"]),
    "an error twice": (TURN + LAW + "[error]\ngibbs = [0, 0, 0]\nquaternion = [1, 0, 0, 0]\n", ["[error]: there are"]),
    "a gauge at a half turn": (
        TURN + LAW + "[error]\nrotation_vector = [180, 0, 0]\ngauge = 'gibbs'\n",
        ["error.gauge = 'gibbs' is not possible at a half turn"],
    ),
    "a rate error of a rate law": (
        TURN + LAW + "kind = 'rate'\n[error]\nrate = [1, 0, 0]\n",
        ["'error.rate' suits no law of the kind 'rate'"],
    ),
    "a disturbed rate law": (
        TURN + LAW + "kind = 'rate'\n[disturbance]\nacceleration = [1, 0, 0]\n",
        ["[disturbance] suits no law of the kind 'rate'"],
    ),
    "a torque on nothing": (TURN + LAW + "[disturbance]\ntorque = [1, 0, 0]\n", ["torque and inertia belong together"]),
    "two inertias": (
        TURN + LAW + "[disturbance]\ntorque = [1, 0, 0]\ninertia = [1, 2]\n",
        ["'disturbance.inertia' holds [1, 2]", "[kg m²]"],
    ),
    "a negative inertia": (
        TURN + LAW + "[disturbance]\ntorque = [1, 0, 0]\ninertia = [1, 2, -3]\n",
        ["an inertia must be symmetric with positive principal moments"],
    ),
    "noise without samples": (TURN + LAW + "[sensor]\nrate_noise = 0.1\n", ["the key 'sampling' is missing: noise"]),
    "a negative noise": (
        TURN + LAW + "[sensor]\nrate_noise = -0.1\n",
        ["'sensor.rate_noise' holds -0.1", "negative"],
    ),
    "two samplings": (
        TURN + LAW + "[sensor]\nsampling = 0.1\n[actuator]\nsampling = 0.2\n",
        ["sensor.sampling and actuator.sampling differ"],
    ),
    "a limit of each axis": (TURN + LAW + "[actuator]\nlimit = [1, 2, 3]\n", ["needs saturation = 'axis'"]),
    "a limit of zero": (TURN + LAW + "[actuator]\nlimit = 0\n", ["'actuator.limit' holds 0", "a positive finite"]),
    "one sample": (TURN + LAW + "[simulation]\nsamples = 1\n", ["'simulation.samples' holds 1", "from 2 to"]),
    "a missing program": ("angles = 'deg'\n[program]\nfile = 'gone.toml'\n" + LAW, ["gone.toml", "No such file"]),
    "a program that is none": (
        "angles = 'deg'\n[program]\nfile = 'path.toml'\n" + LAW,
        ["a saved program was expected, but the file holds a SpiralHelix"],
    ),
    "a straight path": (
        "angles = 'deg'\n[program]\npath = 'path.toml'\n" + LAW,
        ["the natural frame of this path does not exist at t = 0 s", "'upright'"],
    ),
    "a path that ends": (
        "angles = 'deg'\n[program]\npath = 'path.toml'\nframe = 'upright'\n[simulation]\nduration = 9\n" + LAW,
        ["'simulation.duration' holds 9", "no more than 3 s"],
    ),
}


@pytest.mark.parametrize("content", BAD.values(), ids=BAD)
def test_bad_scenarios(qtraj, tmp_path, content):
    text, fragments = content
    qt.SpiralHelix([1.0, 2.0, 0.0, 0.0], [0.3, 0.0], [0.0, 0.5, 0.0, 0.0], 3.0).save(tmp_path / "path.toml")
    (tmp_path / "scenario.toml").write_text(text)
    before = sorted(tmp_path.iterdir())
    result = qtraj("track", tmp_path / "scenario.toml", "--out", tmp_path / "out")
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert result.stderr.startswith(f"error: {tmp_path}")
    assert result.stderr.count("\n") == 1
    for fragment in fragments:
        assert fragment in result.stderr
    assert sorted(tmp_path.iterdir()) == before
