"""The options that say how a recording is read, on every command that takes one."""

import json

import numpy as np
import pytest

SECONDS = np.arange(0, 20.001, 0.1)
POSITIONS = np.stack([50 * np.sin(0.2 * SECONDS), 50 - 50 * np.cos(0.2 * SECONDS), 0.02 * SECONDS], axis=1)
"""A circle of 50 m at 10 m/s."""
LENGTH = 200.0


def save(tmp_path, header, columns, name="log.csv"):
    file = tmp_path / name
    head = [header] if header else []
    file.write_text("\n".join([*head, *(",".join(f"{x:.6f}" for x in row) for row in np.column_stack(columns))]) + "\n")
    return file


def length(result):
    assert result.exit_code in (0, 1), result.output
    return json.loads(result.stdout)["fit"]["length"]


def facts(result):
    return json.loads(result.stdout)["recording"]["facts"]


def test_route_prints_what_was_read(qtraj, tmp_path):
    file = save(tmp_path, "t,x,y,z,battery", [SECONDS, POSITIONS, SECONDS])
    result = qtraj("route", file, "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    k = lines.index("Recording")
    assert lines[k + 1 : k + 5] == [
        "time: column 1 't', s",
        "position: x, y, z, m, as x, y, z with z up",
        "velocity, attitude and rate: none",
        "rows: 201; left out: battery",
    ]


def test_names_units_and_axes(qtraj, tmp_path):
    file = save(tmp_path, "clock,a,b,c", [1000 * SECONDS, 100 * POSITIONS @ [[0, 1, 0], [1, 0, 0], [0, 0, -1]]])
    options = ("--columns", "time=clock", "--columns", "position=a,b,c", "--units", "time=ms", "--units", "position=cm")
    for command in ("route", "retime"):
        limits = ("--limit", "speed=10") if command == "retime" else ()
        result = qtraj(command, file, *options, *limits, "--axes", "ned", "--json", "--out", tmp_path / command)
        np.testing.assert_allclose(length(result), LENGTH, rtol=1e-3)
        assert facts(result)[1] == "position: a, b, c, cm, as north, east, down"


def test_times_and_rates(qtraj, tmp_path):
    file = save(tmp_path, "x,y,z", [POSITIONS])
    refused = qtraj("route", file)
    assert refused.exit_code == 2
    assert "--rate or --times" in refused.stderr
    assert len(refused.stderr.splitlines()) == 1
    by_rate = qtraj("route", file, "--rate", 10, "--json", "--out", tmp_path / "out")
    np.testing.assert_allclose(length(by_rate), LENGTH, rtol=1e-3)
    stamps = tmp_path / "stamps.txt"
    stamps.write_text("\n".join(f"{t:.3f}" for t in SECONDS))
    by_times = qtraj("route", file, "--times", stamps, "--json", "--out", tmp_path / "out")
    np.testing.assert_allclose(length(by_times), LENGTH, rtol=1e-3)


def test_segments_and_duplicates(qtraj, tmp_path):
    times = np.concatenate([SECONDS[:60], SECONDS[20:]])
    file = save(tmp_path, "t,x,y,z", [times, np.vstack([POSITIONS[:60], POSITIONS[20:]])])
    refused = qtraj("route", file)
    assert refused.exit_code == 2
    assert "--segment" in refused.stderr
    result = qtraj("route", file, "--segment", 2, "--json", "--out", tmp_path / "out")
    np.testing.assert_allclose(length(result), 0.9 * LENGTH, rtol=1e-3)
    jump = np.insert(POSITIONS, 50, POSITIONS[49] + 30, axis=0)
    twice = save(tmp_path, "t,x,y,z", [np.insert(SECONDS, 50, SECONDS[49]), jump])
    refused = qtraj("route", twice)
    assert refused.exit_code == 2
    assert "--duplicates" in refused.stderr
    result = qtraj("route", twice, "--duplicates", "first", "--json", "--out", tmp_path / "out")
    np.testing.assert_allclose(length(result), LENGTH, rtol=1e-3)


def test_the_order_of_quaternions(qtraj, tmp_path):
    half = 0.1 * SECONDS
    attitude = np.stack([0 * half, 0 * half, np.sin(half), np.cos(half)], axis=1)
    file = save(tmp_path, "t,x,y,z,q0,q1,q2,q3", [SECONDS, POSITIONS, attitude])
    without = qtraj("route", file, "--out", tmp_path / "out")
    shown = " ".join(without.stdout.split())
    assert "Note: the columns q0, q1, q2, q3 are a quaternion" in shown
    assert "pass --quaternion wxyz (scalar first)" in shown
    result = qtraj("route", file, "--quaternion", "xyzw", "--json", "--out", tmp_path / "out")
    assert json.loads(result.stdout)["fit"]["attitude_rms"] < 0.01


def test_options_replace_keys_of_a_scenario(qtraj, tmp_path):
    save(tmp_path, "t,x,y,z", [1000 * SECONDS[:41], 100 * POSITIONS[:41]])
    scenario = tmp_path / "turn.toml"
    scenario.write_text(
        "[track]\nfile = 'log.csv'\n[track.units]\ntime = 's'\nposition = 'm'\n[limits]\ncurvature = 0.03\n"
    )
    options = ("--units", "time=ms", "--units", "position=cm", "--json")
    result = qtraj("evaluate", scenario, *options)
    assert result.exit_code == 0, result.output
    np.testing.assert_allclose(json.loads(result.stdout)["path"]["duration"], 4.0)
    tuned = qtraj("tune", scenario, *options, "--out", tmp_path / "out")
    assert tuned.exit_code == 0, tuned.output
    assert facts(tuned)[0] == "time: column 1 't', ms"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--columns", "position"), r"--columns needs NAME=COLUMN[,COLUMN…], but 'position' was given"),
        (("--columns", "height=z"), "track.columns"),
        (("--units", "velocity"), "--units needs NAME=UNIT"),
        (("--units", "position=parsec"), "must be m, mm, cm, km"),
        (("--axes", "flat"), "'enu', 'ned' or 'camera'"),
        (("--rate", -1), "track.rate"),
        (("--rate", 10), "contains times, so omit rate"),
        (("--times", "nowhere.txt"), "contains times, so omit rate"),
        (("--duplicates", "all"), "'first', 'last' or 'mean'"),
        (("--quaternion", "zyx"), "'wxyz' or 'xyzw'"),
        (("--segment", 0), "track.segment"),
        (("--segment", 2), "the recording has 1 segment"),
        (("--columns", "position=x,y,up"), "there is no column 'up'"),
    ],
)
def test_bad_options_are_one_line(qtraj, tmp_path, options, words):
    file = save(tmp_path, "t,x,y,z", [SECONDS, POSITIONS])
    result = qtraj("route", file, *options)
    assert result.exit_code == 2, result.output
    assert words in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert "Traceback" not in result.output


def test_options_need_a_recording(qtraj, tmp_path):
    scenario = tmp_path / "s.toml"
    scenario.write_text("[start]\nposition = [1, 0, 0]\n")
    for command in ("tune", "retime", "evaluate"):
        result = qtraj(command, scenario, "--axes", "ned")
        assert result.exit_code == 2
        assert "--axes applies to recordings, but this file has no table [track]" in result.stderr


def test_odd_units_and_limits_are_named(qtraj, tmp_path):
    """Velocities in km/h, and the radius of a curve instead of its curvature."""
    velocities = 36 * np.stack([np.cos(0.2 * SECONDS), np.sin(0.2 * SECONDS), 0 * SECONDS], axis=1)
    save(tmp_path, "t,x,y,z,vx,vy,vz", [SECONDS, POSITIONS, velocities])
    scenario = tmp_path / "s.toml"
    scenario.write_text("[track]\nfile = 'log.csv'\n[limits]\ncurvature = 21.5\n")
    for command in ("route", "retime"):
        more = ("--limit", "speed=20") if command == "retime" else ()
        shown = " ".join(qtraj(command, scenario, *more, "--out", tmp_path / "out").stdout.split())
        assert "velocities are 3.6 times the velocities of the positions" in shown
        assert "pass --units velocity=km/h" in shown
        assert "curvature = 21.5 is a radius of 46.51 mm: if 21.5 is a radius in m, write curvature = 0.04651" in shown
    corrected = qtraj("route", scenario, "--units", "velocity=km/h", "--json", "--out", tmp_path / "out")
    assert len(json.loads(corrected.stdout)["recording"]["notes"]) == 1


def test_a_fit_that_fails_says_what_is_odd(qtraj, tmp_path):
    file = save(tmp_path, "t,x,y,z", [1000 * SECONDS, POSITIONS])
    result = qtraj("route", file, "--out", tmp_path / "out")
    assert "if the times are in ms, pass --units time=ms" in " ".join(result.output.split())
    assert "Traceback" not in result.output
