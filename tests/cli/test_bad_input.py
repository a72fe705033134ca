"""Bad input: one message, exit code 2, nothing written, no traceback."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import qtraj as qt

DATA = Path(__file__).parents[1] / "data"
EXAMPLES = Path(__file__).parents[2] / "examples"

STATES = """
[start]
position = [12.0, 0.0, 0.0]
velocity = [0.0, 5.0, 0.0]
[end]
position = [0.0, 12.0, 1.5]
velocity = [-4.5, 0.0, 0.2]
[limits]
curvature = 0.1
"""
TRACK = """
[track]
file = "track.csv"
[limits]
curvature = 0.1
"""
ROWS = "\n".join(f"{k},{k},{0.01 * k**2},0" for k in range(12))
CSV = f"t,x,y,z\n{ROWS}\n"

BAD = {
    "an empty file": ("", ["there is no path", "[track]", "[start] and [end]"]),
    "limits alone": ("[limits]\ncurvature = 1.0\n", ["there is no path"]),
    "no limits": (STATES.split("[limits]")[0], ["[limits] is missing or empty"]),
    "one end alone": (
        "[start]\nposition = [1, 0, 0]\nvelocity = [0, 1, 0]\n",
        ["[start] requires [end]", "is missing"],
    ),
    "two paths": (STATES + TRACK.split("[limits]")[0], ["several paths (track, start, end)"]),
    "a misspelt limit": (
        STATES.replace("curvature", "curvatur"),
        ["unknown key 'limits.curvatur'", "did you mean 'curvature'?"],
    ),
    "a misspelt table": (STATES.replace("[limits]", "[limit]"), ["unknown key 'limit'", "did you mean 'limits'?"]),
    "a key of another table": (
        STATES + "duration = 4.0\n",
        ["unknown key 'limits.duration'", "the known keys are curvature, torsion, speed"],
    ),
    "a strange key": (
        STATES + "[tune]\nxyzzy = 1\n",
        ["unknown key 'tune.xyzzy'", "the known keys are objective, motion"],
    ),
    "an unknown method": (
        STATES + "[tune]\nmethod = 'sgd'\n",
        ["'tune.method' has the value 'sgd'", "'sqp', 'lbfgs' or 'adam'"],
    ),
    "a learning rate for nothing": (
        STATES + "[tune]\nlearning_rate = 0.1\n",
        ["learning_rate is valid only with method = 'adam', but the method is 'sqp'"],
    ),
    "inner steps for nothing": (
        STATES + "[tune]\ninner_steps = 10\n",
        ["inner_steps is valid only with method = 'lbfgs' or 'adam'"],
    ),
    "a text for a number": (
        STATES.replace("0.1", "'0.1'"),
        ["the key 'limits.curvature' has the value '0.1'", "expected a positive finite number, a range, steps"],
    ),
    "a truth for a number": (STATES.replace("0.1", "true"), ["'limits.curvature' has the value True"]),
    "a negative limit": (STATES.replace("0.1", "-0.1"), ["'limits.curvature' has the value -0.1", "positive"]),
    "a zero limit": (STATES.replace("0.1", "0"), ["'limits.curvature' has the value 0", "positive"]),
    "an infinite limit": (STATES.replace("0.1", "inf"), ["'limits.curvature' has the value inf", "finite"]),
    "a limit that is not a number": (STATES.replace("0.1", "nan"), ["'limits.curvature' has the value nan"]),
    "a limit beyond floats": (STATES.replace("0.1", "1" + "0" * 400), ["'limits.curvature' has the value 1000"]),
    "two components": (
        STATES.replace("[12.0, 0.0, 0.0]", "[12.0, 0.0]"),
        ["'start.position' has the value [12.0, 0.0]", "three finite numbers [x, y, z] [m]"],
    ),
    "a component that is a text": (
        STATES.replace("[0.0, 5.0, 0.0]", "[0.0, '5', 0.0]"),
        ["'start.velocity[1]' has the value '5'", "three finite numbers"],
    ),
    "a missing velocity": (
        STATES.replace("velocity = [0.0, 5.0, 0.0]", ""),
        ["the key 'start.velocity' is missing", "[m/s]"],
    ),
    "an unknown motion": (
        STATES + "[tune]\nmotion = 'circular'\n",
        ["'tune.motion' has the value 'circular'", "'uniform' or 'hermite'"],
    ),
    "a negative turn": (
        STATES + "[tune]\nturns = -1\n",
        ["'tune.turns' has the value -1", "an integer, 0 or more"],
    ),
    "a fixed name that is none": (
        STATES + "[tune]\nfixed = ['end.V_z']\n",
        ["'end.V_z' is not a variable of this problem", "start.V_rho"],
    ),
    "a bounded name that is none": (STATES + "[tune.bounds]\nspeed = [1, 2]\n", ["'speed' is not a variable"]),
    "bounds that contradict": (
        STATES + "[tune.bounds]\nduration = [8.0, 4.0]\n",
        ["the bounds of duration contradict each other: 8.0 is not below 4.0"],
    ),
    "fixed and bounded": (
        STATES + "[tune]\nfixed = ['end.V_h']\nbounds = {'end.V_h' = [0, 1]}\n",
        ["end.V_h is both fixed and bounded"],
    ),
    "one bound": (
        STATES + "[tune.bounds]\nduration = [4.0]\n",
        ["'tune.bounds.duration' has the value [4.0]", "[low, high]"],
    ),
    "a bound of another word": (
        STATES + "[tune.bounds]\nduration = {low = 4.0}\n",
        ["'tune.bounds.duration' has the value {'low': 4.0}", "duration = {max = 8.0}, or {min = 4.0}"],
    ),
    "no bound": (STATES + "[tune.bounds]\nduration = {}\n", ["'tune.bounds.duration' has the value {}", "{max = 8.0}"]),
    "an infinite bound": (
        STATES + "[tune.bounds]\nduration = [4.0, inf]\n",
        [
            "'tune.bounds.duration[1]' has the value inf",
            "or with one bound: duration = {max = 8.0}, or {min = 4.0}",
        ],
    ),
    "one bound that is infinite": (
        STATES + "[tune.bounds]\nduration = {max = inf}\n",
        ["'tune.bounds.duration' has the value inf", "{max = 8.0}"],
    ),
    "one-sided bounds that contradict": (
        STATES + "[tune.bounds]\nduration = {max = 4.0, min = 8.0}\n",
        ["the bounds of duration contradict each other: 8.0 is not below 4.0"],
    ),
    "a bound without quotes": (
        STATES + "[tune.bounds]\nend.V_h = [0, 1]\n",
        ["'tune.bounds.end' has the value {'V_h': [0, 1]}", "a name with a dot needs quotes"],
    ),
    "turns twice": ("turns = 1\n" + STATES + "[tune]\nturns = 1\n", ["turns and tune.turns are the same setting"]),
    "turns of a track": (TRACK + "[tune]\nturns = 1\n", ["tune.turns is valid only with [start] and [end]"]),
    "a fit of nothing": (STATES + "[fit]\nmotion = 'uniform'\n", ["[fit] requires [track]"]),
    "a purpose of nothing": (
        STATES + "[purpose]\nspeed = 'comfort'\n",
        ["purpose.speed", "there is no limit 'speed' in [limits]"],
    ),
    "a bank in degrees": (
        STATES + "[vehicle]\nmass = 1e3\nbank = 3.0\n",
        ["'vehicle.bank' has the value 3.0", "between -pi/2 and pi/2 [rad]; 3 degrees are 0.0524"],
    ),
    "an impossible inertia": (
        STATES + "[vehicle]\nmass = 1e3\ninertia = [1, 1, 100]\n",
        ["the key 'vehicle.inertia': no body has a principal moment of inertia that exceeds the sum of the other two"],
    ),
    "a window backwards": (
        TRACK.replace("[limits]", "window = [5, 1]\n[limits]"),
        ["[track]: the key 'window' has the value [5.0, 1.0]", "t0 < t1"],
    ),
    "a window outside": (
        TRACK.replace("[limits]", "window = [5, 50]\n[limits]"),
        ["the window 5 to 50 s extends beyond the recording", "0 to 11 s"],
    ),
    "a parked car": (
        TRACK.replace("track.csv", "parked.csv"),
        ["scenario.toml: the vehicle stands still in this window", "Choose a window in which it moves"],
    ),
    "two bends": (
        TRACK.replace("track.csv", "bends.csv"),
        ["contains 2 bends in opposite directions", "the largest bend, from about 69.79 to 77.36 s"],
    ),
    "a straight window": (TRACK.replace("track.csv", "straight.csv"), ["the window is nearly straight"]),
    "a missing recording": (TRACK.replace("track.csv", "gone.csv"), ["gone.csv: there is no such file"]),
    "a broken recording": (TRACK.replace("track.csv", "broken.csv"), ["broken.csv, line 3", "column 'x'", "'?'"]),
    "an unknown column": (
        TRACK.replace("[limits]", "columns = {time = 'clock'}\n[limits]"),
        ["there is no column 'clock'", "t, x, y, z"],
    ),
    "a misspelt column": (
        TRACK.replace("track.csv", "misspelt.csv"),
        ["found x, y, missing z", 'position = ["x", "y", "altitud"] under [track.columns]'],
    ),
    "an unknown part": (
        TRACK.replace("[limits]", "columns = {tyme = 't'}\n[limits]"),
        ["unknown key 'track.columns.tyme'", "did you mean 'time'?"],
    ),
    "a missing path": ("path = 'gone.toml'\n[limits]\nspeed = 1\n", ["gone.toml", "No such file"]),
    "a path that is none": ("path = 'track.csv'\n[limits]\nspeed = 1\n", ["track.csv", "must end in .toml or .json"]),
    "a path of another format": ("path = 'scenario.toml'\n[limits]\nspeed = 1\n", ["not a qtraj document"]),
    "states on the axis": (STATES.replace("12.0, 0.0, 0.0", "0, 0, 0"), ["radius 0"]),
    "equal azimuths": (STATES.replace("[0.0, 12.0, 1.5]", "[13.0, 0.0, 1.5]"), ["the same azimuth"]),
    "a start without sense": (
        STATES.replace("[0.0, 5.0, 0.0]", "[5.0, 0.0, 0.0]"),
        ["the sense of rotation is unknown"],
    ),
    "opposite senses": (STATES.replace("[-4.5, 0.0, 0.2]", "[9.0, 0.0, 0.2]"), ["opposite senses"]),
    "accelerations": (
        STATES.replace("velocity", "acceleration = [0, 0, 0]\nvelocity") + "[tune]\nmotion = 'hermite'\nduration = 4\n",
        ["cannot keep boundary accelerations", "omit them"],
    ),
    "one acceleration": (
        STATES.replace("[end]", "acceleration = [0, 0, 0]\n[end]") + "[tune]\nmotion = 'hermite'\nduration = 4\n",
        ["pass accelerations for both ends or for neither"],
    ),
    "a duration that is not free": (STATES + "[tune]\nduration = 4\n", ["a duration was given", "motion='hermite'"]),
    "bad syntax": ("[start]\nposition = [1, 2\nvelocity = 3", ["not valid TOML", "line 3"]),
    "a text without quotes": (
        TRACK.replace('"track.csv"', "track.csv  # here"),
        ["line 3, column 8", "in 'file = track.csv  # here'", 'a string needs quotes: file = "track.csv"'],
    ),
    "a file with a date and without quotes": ("path = 2024.csv\n", ["in 'path = 2024.csv'", 'path = "2024.csv"']),
    "names without quotes": ("a = [x, y]\n", ["in 'a = [x, y]'; a string needs quotes\n"]),
    "a number with a unit": ("duration = 0.5 s\n", ["in 'duration = 0.5 s'\n"]),
    "an unclosed array": ("[limits]\ncurvature = [1,", ["not valid TOML", "line 2, column 16"]),
    "a key twice": ("name = 'a'\nname = 'b'\n", ["not valid TOML", "line 2"]),
    "no text": (b"\xff\xfe\x00", ["not a UTF-8 text file"]),
    "deep nesting": ("a = " + "[" * 5000, ["not"]),
}


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "track.csv").write_text(CSV)
    (tmp_path / "straight.csv").write_text("t,x,y,z\n" + "\n".join(f"{k},{k},0,0" for k in range(12)))
    for name in ("parked", "bends"):
        shutil.copy(DATA / f"boreas_{name.replace('parked', 'standing')}.csv", tmp_path / f"{name}.csv")
    (tmp_path / "misspelt.csv").write_text(CSV.replace("z", "altitud"))
    (tmp_path / "broken.csv").write_text(CSV.replace("1,1,0.01,0", "1,?,0.01,0"))
    return tmp_path


@pytest.mark.parametrize("content", BAD.values(), ids=BAD)
def test_bad_scenarios(qtraj, folder, content):
    text, fragments = content
    file = folder / "scenario.toml"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    before = sorted(folder.iterdir())
    result = qtraj("tune", file, "--out", folder / "out")
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert result.stderr.startswith("error: ")
    assert result.stderr.count("\n") == 1
    assert str(file) in result.stderr or "gone" in result.stderr
    assert " more)" not in result.stderr
    for fragment in fragments:
        assert fragment in result.stderr
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize("command", ["tune", "evaluate", "slew", "simulate"])
def test_files_that_cannot_be_read(qtraj, folder, command):
    for name, fragment in (("nothing.toml", "No such file"), ("", "Is a directory")):
        result = qtraj(command, folder / name, "--out", folder / "out")
        assert result.exit_code == 2
        assert str(folder / name) in result.stderr
        assert fragment in result.stderr
        assert not (folder / "out").exists()


@pytest.mark.parametrize("command", ["tune", "slew", "simulate"])
def test_an_out_that_is_a_file_is_refused_before_any_work(qtraj, folder, command):
    (folder / "out").write_text("mine")
    for out in (folder / "out", folder / "out" / "deeper"):
        result = qtraj(command, "--out", out)
        assert result.exit_code == 2
        assert "a folder to write into was expected" in result.stderr
    assert (folder / "out").read_text() == "mine"


@pytest.mark.parametrize(
    ("command", "fragment"),
    [
        ("tune", 'write a .toml file with file = "track.csv" under [track], and with [limits]'),
        ("evaluate", 'write a .toml file with file = "track.csv" under [track]'),
        ("slew", "`qtraj route` and `qtraj retime` read recordings; for other commands, write a .toml file"),
    ],
)
def test_a_recording_is_no_scenario(qtraj, folder, command, fragment):
    result = qtraj(command, folder / "track.csv", "--out", folder / "out")
    assert result.exit_code == 2
    assert "track.csv: this is a recording, not a scenario" in result.stderr
    assert fragment in result.stderr
    assert not (folder / "out").exists()


@pytest.mark.parametrize(
    "text",
    [CSV, f"# by hand\n{CSV.replace(',', ';')}", "# timestamp tx ty tz qx qy qz qw\n0.5 1e1 -2 .3 0 0 0 1\n", ROWS],
    ids=["csv", "semicolons", "tum", "no header"],
)
@pytest.mark.parametrize("name", ["track.txt", "track", "track.toml"])
def test_a_recording_is_known_by_what_it_holds(qtraj, tmp_path, text, name):
    (tmp_path / name).write_text(text)
    result = qtraj("tune", tmp_path / name, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert f"{name}: this is a recording, not a scenario" in result.stderr
    assert f'write a .toml file with file = "{name}" under [track]' in result.stderr


def test_a_scenario_with_a_fault_among_numbers_is_no_recording(qtraj, tmp_path):
    (tmp_path / "s.txt").write_text("quaternion = [\n1, 0, 0, 0\nend = 3\n")
    assert "not valid TOML" in qtraj("tune", tmp_path / "s.txt").stderr


def test_a_saved_path_has_nothing_to_tune_for(qtraj, folder):
    file = folder / "path.toml"
    file.write_text('format = "qtraj/1"\ntype = "SpiralHelix"\n')
    result = qtraj("tune", file, "--out", folder / "out")
    assert result.exit_code == 2
    assert "this is a saved SpiralHelix, not a scenario" in result.stderr
    assert "to tune a path, write a scenario with path = 'path.toml' and [limits]" in result.stderr


@pytest.mark.parametrize("command", ["tune", "evaluate", "retime"])
def test_a_missing_json_file_is_named(qtraj, tmp_path, command):
    result = qtraj(command, tmp_path / "missing.json", "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert "missing.json: No such file or directory" in result.stderr


def test_a_description_does_not_make_a_scenario_a_saved_object(qtraj, tmp_path):
    (tmp_path / "s.toml").write_text(f"description = '''\nformat = old\n'''\n{STATES}")
    assert qtraj("evaluate", tmp_path / "s.toml", "--samples", 3).exit_code == 0


def test_a_recording_without_a_known_suffix_is_a_drive(qtraj, tmp_path):
    (tmp_path / "drive.txt").write_bytes((EXAMPLES / "drive.csv").read_bytes())
    result = qtraj("route", tmp_path / "drive.txt", "--out", tmp_path / "out", "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["certificate"] is None


def test_a_route_for_another_command_is_recognised(qtraj, tmp_path):
    result = qtraj("tune", EXAMPLES / "bus_route.toml", "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert "this is a scenario for `qtraj route` and `qtraj retime`" in result.stderr


def test_a_stored_document_that_is_no_path(qtraj, folder):
    (folder / "limits.toml").write_text('format = "qtraj/1"\ntype = "Limits"\nspeed = 3.0\n')
    result = qtraj("evaluate", folder / "limits.toml")
    assert result.exit_code == 2
    assert "a saved path was expected, but the file contains an object of type Limits" in result.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        ["tune", "--motion", "circular"],
        ["tune", "--nonsense"],
        ["evaluate"],
        ["evaluate", "x", "--samples", "1"],
        ["slew", "--samples", "1"],
        ["simulate", "--samples", "1"],
        ["sing"],
    ],
)
def test_bad_arguments(qtraj, tmp_path, monkeypatch, arguments):
    monkeypatch.chdir(tmp_path)
    result = qtraj(*arguments)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert "Usage" in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_numbers_that_are_not_finite_are_null_in_json(qtraj, tmp_path):
    """Not a traceback after the files are written."""
    (tmp_path / "path.toml").write_text((EXAMPLES / "helix.toml").read_text())
    path = qt.load(tmp_path / "path.toml")
    huge = qt.SpiralHelix(path.radius, [0.0, 1e308], path.height, path.duration, path.placement)
    huge.save(tmp_path / "path.toml")
    result = qtraj("evaluate", tmp_path / "path.toml", "--samples", 3, "--json", "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert None in np.asarray(json.loads(result.stdout)["columns"]["position"]).ravel().tolist()
