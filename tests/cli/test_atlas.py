"""`qtraj atlas`: the border of the built-in scenario in closed form, its files, the keys that change, the refusals."""

import json

import numpy as np
import pytest
import xarray

import qtraj as qt
from qtraj.scenario.atlas import Point, atlas_task
from qtraj.scenario.reader import read_scenario

ROUND_OFF = 1e-12

BASE = """
[start]
position = [20.0, 0.0, 0.0]
velocity = [0.0, 3.0, 4.0]
[end]
position = [0.0, 30.0, 2.0]
velocity = [-6.0, 0.0, 0.0]
[limits]
curvature = 0.1
longitudinal_acceleration = [-2.0, 1.0]
[atlas]
x = {key = "start.speed", range = [3.0, 9.0], tolerance = 1.0, steps = 2}
y = {key = "radius", range = [10.0, 40.0], tolerance = 5.0, steps = 2}
"""

COARSE = (
    BASE.replace("steps = 2", "steps = 1")
    .replace("[limits]", "[tune]\nstarts = 1\n[limits]")
    .replace("tolerance = 1.0", "tolerance = 9.0")
    .replace("tolerance = 5.0", "tolerance = 40.0")
)
"""The scenario with few points and one start for each."""


@pytest.fixture(scope="module")
def default(qtraj, tmp_path_factory):
    out = tmp_path_factory.mktemp("atlas") / "new"
    result = qtraj("atlas", "--json", "--out", out)
    return result, json.loads(result.stdout), out


def test_the_built_in_scenario_has_the_border_of_an_arc(default):
    """The path is an arc: v² = a R, and R is at least 12 m."""
    result, content, _ = default
    assert result.exit_code == 0
    tight, lateral = 1 / 0.08333, 1.5
    r, v = np.concatenate(content["border"]).T
    along = np.minimum(abs(v - np.sqrt(lateral * r)) / 0.75, abs(r - v**2 / lateral) / 4.0)
    assert np.minimum(along, abs(r - tight) / 4.0).max() <= 0.5
    assert content["axes"]["y"] == {"key": "start.speed", "range": [3.0, 9.0], "tolerance": 0.75, "unit": "m s-1"}
    assert content["limits"]["lateral_acceleration"] > 5


def test_the_files_are_those_of_the_result(default):
    _, content, out = default
    assert {file.name for file in out.iterdir()} == {"atlas.nc", "atlas.json", "atlas.png", "atlas.svg"}
    atlas = qt.load(out / "atlas.json")
    assert atlas.evaluations == content["evaluations"]
    data = xarray.load_dataset(out / "atlas.nc")
    np.testing.assert_array_equal(data["start.speed"], atlas.y)
    assert data.attrs["title"] == "A corner for a city bus"
    assert (data.status.values == atlas.status).all()


@pytest.fixture
def point(tmp_path):
    """The arguments of a tuning of the scenario above."""
    (tmp_path / "s.toml").write_text(BASE)
    task = atlas_task(read_scenario(tmp_path / "s.toml", "atlas")).tuning
    return Point(task.start, task.end, task.limits, None, None, qt.Placement([1.0, 2.0, 0.0]))


def test_keys_change_speeds_headings_radii_and_limits(point):
    faster = point.at("start.speed", 10.0)
    np.testing.assert_allclose(faster.start.velocity, [0.0, 6.0, 8.0], atol=ROUND_OFF)
    np.testing.assert_allclose(point.at("end.heading", 0.5).end.velocity, [6 * np.cos(0.5), 6 * np.sin(0.5), 0.0])
    wider = point.at("radius", 12.0)
    for state, own in ((wider.start, point.start), (wider.end, point.end)):
        from_axis, before = state.position - [1.0, 2.0, 0.0], own.position - [1.0, 2.0, 0.0]
        assert np.hypot(*from_axis[:2]) == pytest.approx(12.0)
        assert from_axis[0] * before[1] == pytest.approx(from_axis[1] * before[0])
        assert from_axis[2] == before[2]
    assert np.hypot(*(point.at("end.radius", 7.0).end.position[:2] - [1.0, 2.0])) == pytest.approx(7.0)
    limited = point.at("limits.curvature", 0.3).limits.given()
    assert {name: float(x) for name, x in limited.items()} == {
        "curvature": 0.3,
        "longitudinal_acceleration_min": -2.0,
        "longitudinal_acceleration_max": 1.0,
    }
    assert set(point.at("limits.jerk", 2.0).limits.given()) == {*limited, "jerk"}
    assert point.at("duration", 4.0).duration == 4.0


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"radius"', '"start.speed"', "atlas.x and atlas.y have the same key"),
        ('"radius"', '"raduis"', "cannot change in an atlas: did you mean 'radius'"),
        ('"radius"', '"limits.speeed"', "speeed"),
        ('"radius"', '"limits.longitudinal_acceleration"', "so it must be one number"),
        ("[10.0, 40.0]", "[10.0, 10.0]", "must end above its start"),
        ("[10.0, 40.0]", "[-10.0, 40.0]", "starts at -10.0, but this key cannot be negative"),
        ("tolerance = 5.0", "tolerance = 0", "tolerance"),
        ("steps = 2}\n", "steps = 0}\n", "steps"),
        ("[atlas]", "[altas]", "altas"),
        ("curvature = 0.1\nlongitudinal_acceleration = [-2.0, 1.0]", "", r"\[limits\] is missing or empty"),
    ],
)
def test_bad_scenarios_are_refused_with_one_message(qtraj, tmp_path, old, new, message):
    assert old in BASE
    (tmp_path / "s.toml").write_text(BASE.replace(old, new, 1))
    result = qtraj("atlas", tmp_path / "s.toml", "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert not (tmp_path / "out").exists()
    [line] = [" ".join(result.stderr.split())]
    assert line.startswith("error:")
    with pytest.raises(ValueError, match=message):
        read_scenario(tmp_path / "s.toml", "atlas")


THIRD = """z = {key = "limits.speed", values = [0.001, 20.0]}
"""


@pytest.fixture(scope="module")
def infeasible(qtraj, tmp_path_factory):
    """The atlas of the first value of the third key, and its folder."""
    folder = tmp_path_factory.mktemp("infeasible")
    (folder / "s.toml").write_text(COARSE.replace("[limits]", "[limits]\nspeed = 0.001"))
    return qtraj("atlas", folder / "s.toml", "--out", folder / "out"), folder / "out"


def test_a_third_key_has_an_atlas_for_each_value_and_a_report(qtraj, infeasible, tmp_path):
    """Each is the atlas of a scenario with this value; at a walking pace of 1 mm/s nothing is feasible."""
    (tmp_path / "s.toml").write_text(COARSE + THIRD)
    result = qtraj("atlas", tmp_path / "s.toml", "--json", "--out", tmp_path / "out")
    assert result.exit_code == 0
    content = json.loads(result.stdout)
    assert content["axes"]["z"] == {"key": "limits.speed", "values": [0.001, 20.0], "unit": "m s-1"}
    assert [x["value"] for x in content["atlases"]] == [0.001, 20.0]
    atlases = [qt.load(tmp_path / "out" / f"atlas_{k}.json") for k in (1, 2)]
    for atlas, one in zip(atlases, content["atlases"], strict=True):
        assert atlas.shares == one["shares"]
    assert len({tuple(x.status.tolist()) for x in atlases}) == 2
    with xarray.open_dataset(tmp_path / "out" / "atlas_2.nc") as data:
        assert data.attrs["third_key"] == "limits.speed = 20 m/s"
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.count("<img") == 2
    alone = qt.load(infeasible[1] / "atlas.json")
    np.testing.assert_array_equal(alone.status, atlases[0].status)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[0.001, 20.0]", "[0.1]", "must be 2 to 64 different numbers in ascending order"),
        ("[0.001, 20.0]", "[0.1, 0.05]", "must be 2 to 64 different numbers in ascending order"),
        ("[0.001, 20.0]", "[0.1, 0.1]", "must be 2 to 64 different numbers in ascending order"),
        ("[0.001, 20.0]", "[nan, 0.1]", "atlas.z.values"),
        ("[0.001, 20.0]", "[-0.1, 0.1]", "speed"),
        ("limits.speed", "start.speed", "atlas.x and atlas.z have the same key"),
        ("limits.speed", "limits.sped", "unknown path quantity 'sped'"),
        ("limits.speed", "mass", "cannot change in an atlas"),
        ("limits.speed", "limits.longitudinal_acceleration", "so it must be one number"),
    ],
)
def test_bad_third_keys_are_refused(qtraj, tmp_path, old, new, message):
    (tmp_path / "s.toml").write_text(BASE + THIRD.replace(old, new))
    result = qtraj("atlas", tmp_path / "s.toml", "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert message in " ".join(result.stderr.split())
    assert not (tmp_path / "out").exists()


def test_an_atlas_without_a_feasible_point_exits_with_1(infeasible):
    result, _ = infeasible
    assert result.exit_code == 1
    assert "infeasible" in result.stdout
