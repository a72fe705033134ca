"""Texts of the user on the terminal: a file is named once in a message, and brackets are not markup."""

import numpy as np
import pytest

COMMANDS = ("tune", "evaluate", "route", "retime", "slew", "simulate", "sweep", "report")
TIMES = np.arange(0.0, 6.0, 0.1)
ROWS = [f"{t:.1f},{8 * t:.3f},{t * t:.3f},{0.1 * t:.3f}" for t in TIMES]
DRIVE = "\n".join(["t,x,y,z", *ROWS])
ODD = {
    "cell.csv": "\n".join(["t,x,y,z", *ROWS[:3], "0.3,a,0,0", *ROWS[4:]]),
    "missing.csv": "\n".join(["t,x,y,z", *ROWS[:3], "0.3,,0,0", *ROWS[4:]]),
    "wide.csv": "\n".join(["t,x,y,z", *ROWS[:3], "0,3,1,0,0", *ROWS[4:]]),
    "back.csv": "\n".join(["t,x,y,z", *ROWS[:9], *ROWS[3:]]),
    "names.csv": "\n".join(["a,b,c,d", *ROWS]),
    "short.csv": "t,x,y,z\n0,0,0,0",
    "empty.csv": "",
    "binary.csv": b"\xff\x00\x81" * 99,
    "binary.nc": b"\xff\x00\x81" * 99,
    "cut.gpx": '<?xml version="1.0"?><gpx><trk>',
    "log.nmea": "$GPGGA,1\n$GPGGA,2\n",
    "syntax.toml": "[track\n",
    "key.toml": "[trak]\nfile = 'drive.csv'\n",
    "window.toml": "[track]\nfile = 'drive.csv'\nwindow = [100, 120]\n[limits]\ncurvature = 1.0\n",
    "nothing.toml": "",
    "syntax.json": '{"format": 1',
    "other.json": '{"format": "other", "type": "SpiralHelix"}',
    "list.json": "[1, 2]",
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The current folder, with a file `drive.csv`."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "drive.csv").write_text(DRIVE)
    return tmp_path


def assert_names_once(result, file):
    """The message begins with the name of the file, which otherwise occurs only in a line to be written."""
    assert result.exit_code == 2, result.output
    (message,) = result.stderr.splitlines()
    assert message.startswith(f"error: {file}"), message
    for quoted in (f'file = "{file}"', f"path = '{file}'", f"file = '{file}'"):
        message = message.replace(quoted, "")
    assert message.count(file) == 1, message


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("name", [*ODD, "absent.csv", "absent.toml", "absent.nc"])
def test_a_message_names_a_file_once(qtraj, folder, command, name):
    if (text := ODD.get(name)) is not None:
        (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    assert_names_once(qtraj(command, name, "--out", "out"), name)


@pytest.mark.parametrize("name", [name for name in ODD if name.endswith("csv")])
def test_a_message_names_a_scenario_and_its_recording_once(qtraj, folder, name):
    text = ODD[name]
    (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    (folder / "scenario.toml").write_text(f"[track]\nfile = '{name}'\n[limits]\nspeed = 9.0\n")
    for command in ("route", "retime", "tune", "evaluate"):
        result = qtraj(command, "scenario.toml", "--out", "out")
        assert_names_once(result, "scenario.toml")
        assert result.stderr.count(name) == 1, result.stderr


@pytest.mark.parametrize("window", ["[100, 120]", "[5.0, 7.0]", "[-3.0, 2.0]"])
def test_a_window_outside_the_recording_names_both_ranges(qtraj, folder, window):
    (folder / "scenario.toml").write_text(f"[track]\nfile = 'drive.csv'\nwindow = {window}\n[limits]\nspeed = 9.0\n")
    start, end = (float(x) for x in window.strip("[]").split(","))
    for command in ("route", "retime", "tune", "evaluate"):
        result = qtraj(command, "scenario.toml", "--out", "out")
        assert result.exit_code == 2
        assert f"the window {start:.9g} to {end:.9g} s extends beyond the recording" in result.stderr
        assert "the recording runs from 0 to 5.9 s" in result.stderr


def test_brackets_are_not_markup(qtraj, folder):
    """In names, descriptions, sources, reasons, column names, and names of files and folders."""
    texts = {"name": "[tune] my [bold]drive[/bold] [/]", "description": "[red]x [/x]", "source": "[link=a] b"}

    rows = [f"{row},1" for row in ROWS]
    (folder / "a[bold].csv").write_text("\n".join(["t,x,y,z,[red]", *rows]))
    (folder / "b[tune].toml").write_text(
        f"name = '{texts['name']}'\ndescription = '{texts['description']}'\n[track]\nfile = 'a[bold].csv'\n"
        f"source = '{texts['source']}'\n[limits]\nspeed = 99.0\n"
    )
    result = qtraj("route", "b[tune].toml", "--out", "out[red]")
    assert result.exit_code == 0, result.output
    for text in (*texts.values(), "b[tune].toml", "left out: [red]", "out[red]/paths.nc"):
        assert text in result.stdout
    (folder / "b[tune].toml").write_text("name = '[tune]'\n[[/]]\n")
    assert "b[tune].toml" in qtraj("route", "b[tune].toml").stderr


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        ("", ["--columns", "positon=x,y,z"], "unknown key 'track.columns.positon'; did you mean 'position'?"),
        ("", ["--units", "velocty=km/h"], "unknown key 'track.units.velocty'; did you mean 'velocity'?"),
        ("", ["--units", "speed=km/h"], "unknown key 'track.units.speed'; the known keys are time, position"),
        ("windw = [0, 1]", [], "unknown key 'track.windw'; did you mean 'window'?"),
        ("[limits]\ncurvatur = 1", [], "unknown key 'limits.curvatur'; did you mean 'curvature'?"),
        ("[limits]\nspeed = 9\n[tune]\nfixed = ['end.heding']", [], "(did you mean 'end.heading'?)"),
        ("[limits]\nspeed = 9\n[tune]\nfixed = ['start.V_hh']", [], "(did you mean 'start.V_h'?)"),
        ("[limits]\nspeed = 9\n[tune.bounds]\nduratoin = [1, 2]", [], "(did you mean 'duration'?)"),
        ("[limits]\nspeed = 9\n[tune]\nheight = 0", [], "unknown key 'tune.height'; the known keys are"),
    ],
)
def test_an_unknown_key_is_refused_with_the_nearest_name(qtraj, folder, text, options, message):
    (folder / "scenario.toml").write_text(f"[track]\nfile = 'drive.csv'\n{text}\n")
    command = "tune" if "[limits]" in text else "route"
    result = qtraj(command, "scenario.toml", *options, "--out", "out")
    assert result.exit_code == 2
    assert message in result.stderr
