"""Obstacles in scenarios: `qtraj route` checks and avoids them, and says what is wrong with them."""

import json

import numpy as np
import pytest

SCENARIO = """
[track]
file = "drive.csv"

[limits]
speed = 12.0

[[limits.keep_out]]
cylinder = {point = [0.0, 52.0, 0.0], axis = [0.0, 0.0, 1.0], radius = 1.5}

[[limits.keep_out]]
polygon = [[-10.0, -10.0], [10.0, -10.0], [10.0, 10.0], [-10.0, 10.0]]

[[limits.body]]
radius = 1.0

[[limits.body]]
offset = 2.0
radius = 1.0
"""


@pytest.fixture
def folder(tmp_path):
    """A drive on a circle of 50 m at 10 m/s, which passes a mast at 0.5 m."""
    t = np.linspace(0.0, 20.0, 401)
    rows = np.stack([t, 50 * np.cos(0.2 * t), 50 * np.sin(0.2 * t), 0.1 * t], axis=1)
    np.savetxt(tmp_path / "drive.csv", rows, delimiter=",", header="t,x,y,z", comments="", fmt="%.6f")
    return tmp_path


def test_a_route_is_checked_and_tuned(qtraj, folder):
    file = folder / "scenario.toml"
    file.write_text(f"{SCENARIO}\n[tune]\ntube = 2.0\n")
    result = qtraj("route", file, "--out", folder / "out", "--json")
    assert result.exit_code == 0, result.stderr
    content = json.loads(result.stdout)
    text = json.dumps(content)
    assert "keep_out[0]" in text
    assert "keep_out[1]" in text
    checked = qtraj("route", file)
    assert "keep_out[0]" in checked.stdout
    assert "broken" in checked.stdout


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("radius = 1.5}", "radius = 1.5}\nball = {centre = [0.0, 0.0, 0.0], radius = 1.0}"), "several obstacles"),
        (("radius = 1.5}", "radius = -1.5}"), "limits.keep_out[0].cylinder.radius"),
        (("[10.0, 10.0], [-10.0, 10.0]]", "[-10.0, 10.0], [10.0, 10.0]]"), "convex polygon"),
        (("offset = 2.0\nradius = 1.0", "offset = 2.0"), "limits.body[1].radius"),
    ],
)
def test_bad_obstacles_are_named(qtraj, folder, change, message):
    file = folder / "scenario.toml"
    file.write_text(SCENARIO.replace(*change))
    result = qtraj("route", file)
    assert result.exit_code == 2
    assert message in " ".join(result.stderr.split())


TURN = """
[start]
position = [20.0, 0.0, 0.0]
velocity = [0.0, 6.0, 0.5]

[end]
position = [0.0, 22.0, 3.0]
velocity = [-6.0, 0.0, 0.2]

[tune]
starts = 2

[limits]
curvature = 0.1

[[limits.keep_out]]
cylinder = {point = [14.5, 14.5, 0.0], axis = [0.0, 0.0, 1.0], radius = 1.5}

[[limits.keep_out]]
polygon = [[8.0, 16.0], [10.0, 16.0], [10.0, 18.0], [8.0, 18.0]]

[[limits.body]]
radius = 0.5
"""


def test_a_turn_is_tuned_and_drawn(qtraj, tmp_path):
    file = tmp_path / "turn.toml"
    file.write_text(TURN)
    result = qtraj("tune", file, "--out", tmp_path / "out", "--json")
    assert result.exit_code == 0, result.stderr
    content = json.loads(result.stdout)
    assert content["tuning"]["status"] == "converged"
    assert "touches keep_out[0]" in content["tuning"]["result"]
    assert (tmp_path / "out" / "tuning.png").exists()


def test_a_start_inside_an_obstacle_is_an_error_of_the_file(qtraj, tmp_path):
    file = tmp_path / "turn.toml"
    file.write_text(TURN.replace("[14.5, 14.5, 0.0]", "[20.5, 0.0, 0.0]"))
    result = qtraj("tune", file)
    assert result.exit_code == 2
    assert "at the start, whose position is fixed, the body is inside keep_out[0], by 1.5 m" in " ".join(
        result.stderr.split()
    )
