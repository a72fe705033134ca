"""`qtraj retime`: the built-in scenario against the library, files, exit codes, bad input. One compiled search."""

import json
from pathlib import Path

import numpy as np
import pytest
import xarray

import qtraj as qt
from qtraj.design.timing import part_search, search
from qtraj.scenario import KINDS
from qtraj.scenario.reader import read_scenario
from qtraj.scenario.route import EMBEDDED, read_retiming, retiming

EXAMPLES = Path(__file__).parents[2] / "examples"
FILES = ["paths.nc", "path.json", "retimed.json", "timing.nc", "timing.csv", "retime.png", "retime.svg", "report.html"]


@pytest.fixture(scope="module")
def default(qtraj, tmp_path_factory):
    out = tmp_path_factory.mktemp("retime") / "out"
    result = qtraj("retime", "--out", out, "--json")
    return result, json.loads(result.stdout), out


def test_the_built_in_path_is_retimed_as_by_the_library(default):
    result, content, _ = default
    assert result.exit_code == 0
    assert [Path(file).name for file in content["files"]] == FILES
    path = KINDS["path"].build(read_scenario(EMBEDDED, "path")).path
    limits = qt.Limits(speed=8.33, lateral_acceleration=1.5, longitudinal_acceleration=1.2, jerk=0.9)
    timed = qt.retime(path, limits, start_speed=0.0, end_speed=6.0)
    assert content["retimed"]["duration"] == pytest.approx(float(timed.duration))
    assert content["retimed"]["end_speeds"] == pytest.approx([0.0, 6.0], rel=1e-5)
    assert content["certificate"]["status"] == ["proved"] * 4
    assert content["result"] == timed.result
    profile = qt.speed_profile(timed)
    assert content["profile"]["share"] == pytest.approx(profile.shares.tolist())
    assert content["profile"]["duration"] == pytest.approx([float(path.duration), float(timed.duration)])


def test_the_files_contain_both_paths_and_the_timing(default):
    _, content, out = default
    duration = content["retimed"]["duration"]
    path, timed = qt.load(out / "path.json"), qt.load(out / "retimed.json")
    assert path.duration == timed.duration == duration
    assert np.linalg.norm(path.velocity(duration)) == pytest.approx(6.0, rel=1e-5)
    dataset = xarray.load_dataset(out / "paths.nc")
    assert dataset["path"].values.tolist() == ["before", "after"]
    assert dataset["duration"].values[1] == duration
    assert dataset["jerk_magnitude"].sel(path="after").max() <= 0.9
    table = np.loadtxt(out / "timing.csv", delimiter=",", skiprows=1)
    assert (out / "timing.csv").read_text().startswith("time [s],parameter [s],distance [m],speed [m/s],")
    assert table[-1, 0] == pytest.approx(duration, rel=1e-12)
    assert table[-1, 2] == pytest.approx(float(path.length()), rel=1e-8)
    assert xarray.load_dataset(out / "timing.nc")["usage"].dims == ("limit", "cell")


def test_the_report_shows_what_bounds_the_speed(qtraj, default):
    _, content, out = default
    for result in (out, out / "retimed.json"):
        report = json.loads(qtraj("report", result, "--json").stdout)
        assert report["findings"] == [content["result"][:1].upper() + content["result"][1:]]
        assert {"Limits", "Limits that bound the speed", "Duration and length"} <= set(report["tables"])
        assert [body["name"] for body in report["bodies"]] == ["before", "after"]


def test_the_terminal_shows_it_within_80_columns(qtraj, tmp_path):
    result = qtraj("retime", "--out", tmp_path)
    assert result.exit_code == 0
    for text in ("proved", "reached on", "s instead of 5.469", "0.000 m/s at the start", "converged: the fastest"):
        assert text in result.stdout
    paths = ("Scenario:", str(tmp_path))
    assert [line for line in result.stdout.splitlines() if len(line) > 80 and not line.startswith(paths)] == []


def test_an_end_speed_out_of_reach_is_a_failure_with_results(qtraj, tmp_path):
    result = qtraj("retime", "--end-speed", 50, "--out", tmp_path)
    assert result.exit_code == 1
    assert "cannot be reached within the limits" in " ".join(result.stdout.split())
    assert (tmp_path / "path.json").exists()


@pytest.mark.parametrize("limit", ["speed=1e-300", "speed=1e300", "acceleration=1e300"])
def test_a_limit_whose_powers_overflow_is_refused(qtraj, default, tmp_path, limit):
    result = qtraj("retime", default[2] / "path.json", "--limit", limit, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert "use other units" in " ".join(result.stderr.split())
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("all_pictures_are_drawn")
def test_a_failed_search_is_a_failure_with_results(qtraj, default, tmp_path, monkeypatch):
    """The figure and the numbers of a timing that contains NaN: neither an error of matplotlib nor `nan`."""

    def failed(*given):
        found = search.completed(*given)
        return found._replace(powers=np.nan * found.powers, usage=np.nan * found.usage)

    monkeypatch.setattr(part_search, "completed", failed)
    result = qtraj("retime", default[2] / "path.json", "--limit", "speed=9", "--out", tmp_path / "out")
    assert result.exit_code == 1, result.output
    assert "duration  unknown instead of" in result.stdout
    assert not {"nan", "inf"} & set(result.stdout.split())
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == sorted(FILES)


def test_a_saved_path_is_retimed_and_its_shape_is_checked(qtraj, default, tmp_path):
    """The curvature does not depend on the timing: it is checked on the path itself, and its place is a time."""
    limits = ["speed=8.33", "lateral_acceleration=1.5", "longitudinal_acceleration=1.2", "jerk=0.9", "curvature=0.01"]
    options = [x for limit in limits for x in ("--limit", limit)]
    more = ("--start-speed", 0, "--end-speed", 6, "--json", "--out", tmp_path)
    result = qtraj("retime", default[2] / "retimed.json", *options, *more)
    assert result.exit_code == 1
    content = json.loads(result.stdout)
    assert content["retimed"]["duration"] == pytest.approx(default[1]["retimed"]["duration"], rel=1e-6)
    found = content["certificate"]
    assert found["limit"][-1] == "curvature"
    assert found["status"] == ["proved"] * 4 + ["broken"]
    path = qt.load(tmp_path / "path.json")
    curvature = qt.evaluate(path, [found["worst_time"][-1]], ("curvature",)).curvature[0]
    assert float(curvature) == pytest.approx(found["worst_value"][-1], rel=1e-6)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--limit", "speed"], "--limit needs NAME=VALUE, such as speed=13.9, but 'speed' was given"),
        (["--limit", "speed=3", "--limit", "speed=4"], "--limit speed was given more than once"),
        (["--limit", "spead=3"], "unknown limit 'spead'; did you mean 'speed'?"),
        (["--limit", "climb=-2:3"], "[[limits.own]]"),
        (["--limit", "speed=-3"], "--limit speed must be positive and finite, but -3 was given"),
        (["--limit", "friction=0.5"], "limits.friction needs a vehicle: add a table [vehicle] with the mass"),
        (["--knots", 100], "power of two"),
        (["--knots", 2**40], "knots must be a power of two from 16 to 16384"),
        (["--start-speed", -1], "at least 0"),
    ],
)
def test_bad_options_are_refused(qtraj, tmp_path, options, message):
    result = qtraj("retime", *options, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert message in result.stderr
    assert not (tmp_path / "out").exists()


def test_limits_that_the_retiming_does_not_support_are_checked(qtraj, tmp_path):
    """The rate of the natural trihedral is undefined at rest, where the vehicle starts."""
    result = qtraj("retime", "--limit", "angular_acceleration=9", "--knots", 64, "--json", "--out", tmp_path)
    assert result.exit_code == 1
    found = json.loads(result.stdout)["certificate"]
    assert found["limit"][-1] == "angular_acceleration"
    assert found["status"] == ["proved"] * 4 + ["undefined"]


def test_limits_on_own_quantities_are_imposed(qtraj, tmp_path):
    """On a straight line of 100 m, at 10 m/s in the recording."""
    (tmp_path / "drive.csv").write_text("t,x,y,z\n" + "".join(f"{k / 10:.1f},{k},0,0\n" for k in range(101)))
    scenario = tmp_path / "s.toml"
    own = "[[limits.own]]\nname = 'ahead'\nunit = 'm/s'\nexpression = 'velocity[0]'\nlimit = 5\n"
    scenario.write_text(f"[track]\nfile = 'drive.csv'\n[limits]\nspeed = 20\nlongitudinal_acceleration = 3\n{own}")
    result = qtraj("retime", scenario, "--json", "--out", tmp_path / "out")
    assert result.exit_code == 0
    found = json.loads(result.stdout)
    assert found["certificate"]["status"] == ["proved"] * 3
    assert found["retimed"]["duration"] == pytest.approx(20.0, rel=1e-3)


RECORDING = '[track]\nfile = "drive.csv"\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "[limits]\nspeed = 9\n[retime]\nknots = 100\n",
            "the key 'retime.knots': knots must be a power of two from 16 to 16384, such as 512, but 100 was given",
        ),
        ("[limits]\nspeed = 9\n[retime]\nstart_speed = -1\n", "expected a finite number, 0 or more [m/s]"),
        ("[limits]\nspeed = 9\n[retime]\nshape = 'line'\n", "expected 'route' or 'spiral-helix'"),
        ("[limits]\nspeed = 9\n[retime]\nshape = 'route'\n[fit]\nmotion = 'hermite'\n", "unknown key 'fit.motion'"),
        ("", "retime needs a limit that bounds the speed"),
    ],
)
def test_bad_scenarios_are_refused(qtraj, tmp_path, text, message):
    (tmp_path / "drive.csv").write_bytes((EXAMPLES / "drive.csv").read_bytes())
    scenario = tmp_path / "s.toml"
    scenario.write_text(RECORDING + text)
    result = qtraj("retime", scenario, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert result.stderr.startswith(f"error: {scenario}: ")
    assert message in result.stderr
    assert not (tmp_path / "out").exists()


def test_the_keys_decide_on_the_shape_fitted_to_a_recording(tmp_path):
    (tmp_path / "drive.csv").write_bytes((EXAMPLES / "drive.csv").read_bytes())
    limits = "[limits]\nspeed = 9\n"
    kinds = {
        "": qt.Route,
        "[fit]\nmotion = 'hermite'\n": qt.SpiralHelix,
        "[retime]\nshape = 'spiral-helix'\n": qt.SpiralHelix,
    }
    for text, kind in kinds.items():
        (tmp_path / "s.toml").write_text(RECORDING + limits + text)
        task = retiming(read_retiming(tmp_path / "s.toml", {"jerk": 2.0}), {})
        assert isinstance(task.path, kind)
        assert task.tuning is None
        assert set(task.limits.given()) == {"speed", "jerk"}
    task = retiming(read_retiming(tmp_path / "drive.csv", {"speed": 5.0}), {})
    assert isinstance(task.path, qt.Route)
    (tmp_path / "s.toml").write_text(RECORDING + limits + "[retime]\nstop_speed = 0\nstop_distance = 0.1\n")
    own = read_retiming(tmp_path / "s.toml", {}).scenario.retime
    assert (own.stop_speed, own.stop_distance) == (0.0, 0.1)
    (tmp_path / "s.toml").write_text(RECORDING + limits + "[tune]\ntube = 0.3\n")
    assert retiming(read_retiming(tmp_path / "s.toml", {}), {}).tuning is not None


@pytest.mark.slow
def test_a_recorded_street_of_the_examples(qtraj, tmp_path):
    result = qtraj("retime", EXAMPLES / "bus_timing.toml", "--out", tmp_path, "--json")
    content = json.loads(result.stdout)
    assert result.exit_code == 0
    assert set(content["certificate"]["status"]) == {"proved"}
    assert content["retimed"]["end_speeds"][0] == pytest.approx(5.0, rel=1e-5)
    assert content["profile"]["distance"][-1] == pytest.approx(content["fit"]["length"], rel=1e-6)


@pytest.mark.slow
def test_a_scenario_with_a_tuning_is_tuned_first(qtraj, tmp_path):
    states = "[start]\nposition = [12, 0, 0]\nvelocity = [0, 5, 0]\n[end]\nposition = [0, 12, 1.5]\n"
    limits = "velocity = [-4.5, 0, 0.2]\n[limits]\nlateral_acceleration = 1.8\ncurvature = 0.1\n"
    (tmp_path / "s.toml").write_text(states + limits + "[tune]\n[retime]\nknots = 64\n")
    result = qtraj("retime", tmp_path / "s.toml", "--out", tmp_path / "out", "--json")
    assert result.exit_code == 0, result.output
    content = json.loads(result.stdout)
    assert content["tuned"]["outcome"] == "converged"
    assert content["certificate"]["status"] == ["proved", "proved"]
    assert content["profile"]["duration"][1] < content["profile"]["duration"][0]
