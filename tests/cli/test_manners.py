"""How the command line behaves: whole files, quiet streams, help, missing packages, a process of its own."""

import importlib
import io
import itertools
import json
import os
import pkgutil
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from rich.console import Console

import qtraj as qt
from qtraj import cli
from qtraj.cli import terminal
from qtraj.cli.layout import plain_table
from qtraj.cli.main import COMMANDS, application
from qtraj.foundation import folder
from qtraj.foundation.plain import finite
from qtraj.foundation.progress import Progress
from qtraj.foundation.progress_bar import watching
from qtraj.io import instants_csv
from qtraj.scenario import KINDS
from qtraj.viz.result_files import obsolete_files

SOURCE = Path(__file__).parents[2] / "src"
EXAMPLES = Path(__file__).parents[2] / "examples"
HELIX, SIMULATION = EXAMPLES / "helix.toml", EXAMPLES / "simulate_ramp.toml"
DATA = KINDS["route"].embedded.parent


def writes(text):
    return lambda file: file.write_text(text)


def test_all_files_appear_and_others_stay(tmp_path):
    (tmp_path / "mine").write_text("old")
    (tmp_path / "a").write_text("old")
    written = folder.write_all(tmp_path, {"a": writes("new"), "b": writes("new")})
    assert written == [tmp_path / "a", tmp_path / "b"]
    assert {file.name: file.read_text() for file in tmp_path.iterdir()} == {"mine": "old", "a": "new", "b": "new"}


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError, ValueError])
def test_a_failure_leaves_nothing(tmp_path, error):
    def fail(file):
        file.write_text("half")
        raise error

    (tmp_path / "a").write_text("old")
    for out in (tmp_path, tmp_path / "new" / "deep"):
        with pytest.raises(error):
            folder.write_all(out, {"a": writes("new"), "b": fail})
    assert [file.name for file in tmp_path.iterdir()] == ["a"]
    assert (tmp_path / "a").read_text() == "old"


@pytest.fixture
def interruptible():
    """Handle SIGINT as a process in the foreground does; one in the background of a script ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield  # processes that start here inherit the default handler
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_between_two_moves_waits(tmp_path, monkeypatch):
    replace = os.replace

    def interrupted(source, target):
        signal.raise_signal(signal.SIGINT)
        replace(source, target)

    monkeypatch.setattr(os, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        folder.write_all(tmp_path / "out", {"a": writes("1"), "b": writes("2")})
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == ["a", "b"]
    assert [file.name for file in tmp_path.iterdir()] == ["out"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


KILLED = """
import os, signal
from pathlib import Path
from qtraj.foundation import folder
def write(file):
    file.write_text("half")
    {there}
os.replace = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
folder.write_all(Path("out"), {{"a": write, "b": write}})
"""


@pytest.mark.skipif(not Path("/proc/sys/kernel/random/boot_id").exists(), reason="staging folders are swept on Linux")
@pytest.mark.parametrize("there", ["pass", "Path('out').mkdir(exist_ok=True)"], ids=["late", "meanwhile"])
def test_a_run_after_a_killed_one_leaves_only_results(tmp_path, there):
    """Killed between staging and moving, in a folder that was there before, or is since."""
    for _ in range(2):
        done = subprocess.run([sys.executable, "-c", KILLED.format(there=there)], env=surroundings(), cwd=tmp_path)
        assert done.returncode == -signal.SIGKILL
        assert list(tmp_path.rglob(".qtraj-*/a"))
    folder.write_all(tmp_path / "out", {"a": writes("1"), "b": writes("2")})
    assert sorted(str(file.relative_to(tmp_path)) for file in tmp_path.rglob("*")) == ["out", "out/a", "out/b"]


def test_obsolete_files_are_removed_after_the_new_ones_are_complete(tmp_path):
    def fail(file):
        raise ValueError

    for name in ("a", "old", "mine"):
        (tmp_path / name).write_text("old")
    with pytest.raises(ValueError):
        folder.write_all(tmp_path, {"a": fail}, [tmp_path / "old"])
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a", "mine", "old"]
    folder.write_all(tmp_path, {"a": writes("new")}, [tmp_path / "old", tmp_path / "gone"])
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a", "mine"]


def test_files_of_an_earlier_run_are_removed_and_listed(qtraj, tmp_path):
    """The route has a certificate only with limits; the report shows the dataset that is replaced."""
    recording = DATA / "boreas_right_angle.csv"
    kept = ["tuning.toml", "fit.json.bak"]
    for name in ("certificate.json", "tuning.json", *kept):
        (tmp_path / name).write_text("mine")
    assert obsolete_files(tmp_path, {"paths.nc": writes("")}, ["certificate.json"]) == []  # no earlier run
    (tmp_path / "paths.nc").write_text("")
    result = qtraj("route", recording, "--out", tmp_path, "--json")
    assert result.exit_code == 0, result.output
    content = json.loads(result.stdout)
    removed = [str(tmp_path / name) for name in ("certificate.json", "tuning.json")]
    assert list(content)[-2:] == ["files", "removed"]
    assert content["removed"] == removed
    assert {file.name for file in tmp_path.iterdir()} == {Path(name).name for name in content["files"]} | set(kept)
    assert json.loads(qtraj("route", recording, "--out", tmp_path, "--json").stdout)["removed"] == []


def test_a_report_of_a_replaced_dataset_is_removed(qtraj, tmp_path):
    (tmp_path / "report.html").write_text("of another result")
    evaluate = ("evaluate", HELIX, "--samples", 3, "--out", tmp_path)
    assert "Files removed" not in qtraj(*evaluate).stdout  # no dataset was replaced
    text = qtraj(*evaluate).stdout
    _, title, removed = text.partition("Files removed")
    assert title
    assert "report.html" in removed
    assert sorted(file.name for file in tmp_path.iterdir()) == ["table.csv", "table.nc"]


def test_folders_and_links_are_not_obsolete(tmp_path):
    (tmp_path / "paths.nc").write_text("")
    (tmp_path / "report.html").symlink_to(tmp_path / "paths.nc")
    (tmp_path / "tuning.json").mkdir()
    assert obsolete_files(tmp_path, {"paths.nc": writes("")}, ["tuning.json"]) == []


def test_numbers_that_are_not_finite_become_null(qtraj, tmp_path):
    """The path turns by 1e309 rad, which is infinite in float64."""
    qt.SpiralHelix([10.0], [0.0, 1e308], [0.0, 0.5], 10.0).save(tmp_path / "path.json")
    result = qtraj("evaluate", tmp_path / "path.json", "--samples", 3, "--json")
    assert (result.exit_code, result.exception) == (0, None)
    assert json.loads(result.stdout)["path"]["turn"] is None


def test_no_file_is_written_if_the_json_fails(qtraj, tmp_path, monkeypatch):
    monkeypatch.setattr(terminal, "finite", lambda content: {"x": float("nan")})
    result = qtraj("evaluate", HELIX, "--samples", 3, "--json", "--out", tmp_path / "out")
    assert (result.exit_code, result.stdout) == (2, "")
    assert not (tmp_path / "out").exists()


def test_a_folder_in_the_way_is_told_before_anything_moves(tmp_path):
    (tmp_path / "b").mkdir()
    with pytest.raises(IsADirectoryError, match="there is a folder with the same name"):
        folder.write_all(tmp_path, {"a": writes("1"), "b": writes("2")})
    assert [file.name for file in tmp_path.iterdir()] == ["b"]


def test_ctrl_c_ends_with_130_and_writes_nothing(qtraj, tmp_path, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(instants_csv, "write_csv", interrupted)
    result = qtraj("evaluate", HELIX, "--samples", 7, "--out", tmp_path / "out")
    assert result.exit_code == 130
    assert result.stderr == "interrupted\n"
    assert list(tmp_path.iterdir()) == []


class Screen(io.StringIO):
    """A stream that is a terminal, or is none."""

    def __init__(self, terminal):
        super().__init__()
        self.isatty = lambda: terminal


def shown(monkeypatch, is_terminal):
    """What the progress of a command leaves on stderr, in an environment without wishes about terminals."""
    for name in ("FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    stream = Screen(is_terminal)
    monkeypatch.setattr(sys, "stderr", stream)
    with watching() as watch:
        watch.say("fitting")
        watch.tuning(Progress("searches", 3, 8))
    return stream.getvalue()


def test_progress_is_shown_on_a_terminal_and_wiped(monkeypatch):
    text = shown(monkeypatch, is_terminal=True)
    assert "tuning: 3 of 8 searches" in text
    assert text.rpartition("searches")[2].endswith("\x1b[2K")  # the line is erased, and nothing comes after


def test_progress_is_silent_where_stderr_is_no_terminal(monkeypatch):
    assert shown(monkeypatch, is_terminal=False) == ""


COLOUR = re.compile(r"\x1b\[[0-9;]*(?<![0-9])(?:3[0-8]|4[0-8]|9[0-7]|10[0-7])(?:;[0-9;]*)?m")
"""A change of colour; bold and dim are none."""


@pytest.mark.parametrize(("wish", "coloured"), [({}, True), ({"NO_COLOR": "1"}, False)], ids=["plain", "NO_COLOR"])
def test_no_color_is_respected(monkeypatch, qtraj, wish, coloured, tmp_path):
    """On a terminal there is colour, on errors as well as in help, unless NO_COLOR asks for none."""
    for name in ("NO_COLOR", "TERM", "COLORTERM"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("typer.rich_utils.FORCE_TERMINAL", True)
    monkeypatch.setenv("TERM", "xterm-256color")
    for name, value in wish.items():
        monkeypatch.setenv(name, value)
    assert bool(COLOUR.search(qtraj("tune", "--help", color=True).output)) == coloured
    stream = Screen(True)
    monkeypatch.setattr(sys, "stdout", stream)
    terminal.stdout().print("[green]met[/green]")
    assert bool(COLOUR.search(stream.getvalue())) == coloured


@pytest.mark.parametrize(
    ("arguments", "fragments"),
    [
        ([], ["tune", "evaluate", "slew", "simulate", "report", "--version", "--install-completion"]),
        (["tune"], ["--out", "--json", "--motion", "--objective", "--starts"]),
        (["evaluate"], ["--samples", "--step", "--out", "--json"]),
        (["slew"], ["--samples", "--out", "--json"]),
        (["simulate"], ["--samples", "--out", "--json"]),
        (["report"], ["--out", "--json", "--frame", "moving frame"]),
    ],
)
def test_help_has_examples_within_80_columns(qtraj, monkeypatch, arguments, fragments):
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("NO_COLOR", "1")
    result = qtraj(*arguments, "--help")
    assert result.exit_code == 0
    for fragment in fragments:
        assert fragment in result.stdout
    about, _, examples = result.stdout.partition("Examples:")
    assert examples.count(" qtraj ") >= 2
    assert max(map(len, result.stdout.splitlines())) <= 80
    assert "\x1b" not in result.stdout
    prose = about.partition("╭")[0].split("\n")
    short = [line for line, after in itertools.pairwise(prose) if 1 < len(line.strip()) < 55 and after.strip()]
    assert short == []  # paragraphs are filled


def test_every_module_with_a_command_is_registered_with_examples():
    registered = {command.callback.__name__: command for command in application().registered_commands}
    names = [name for _, name, _ in pkgutil.iter_modules(cli.__path__)]
    functions = {name: getattr(importlib.import_module(f"qtraj.cli.{name}"), name, None) for name in names}
    commands = {name for name, function in functions.items() if function and hasattr(function, "__wrapped__")}
    assert len(commands) >= 7
    assert commands == set(registered) == set(COMMANDS)
    for name, command in registered.items():
        assert command.help
        title, *examples = filter(None, command.epilog.splitlines())
        assert title == "Examples:"
        assert any(f"{example} ".startswith(f"qtraj {name} ") for example in examples)


def complete(runner, shell, line, **more):
    """What a shell is offered for the last word of a line."""
    words = line.split(" ")
    asked = {"COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1), "_TYPER_COMPLETE_ARGS": line}
    result = runner(env={"_QTRAJ_COMPLETE": f"complete_{shell}"} | asked | more)
    assert result.exit_code == 0
    return result.stdout


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_shells_complete_commands_options_and_values(qtraj, shell):
    script = qtraj(env={"_QTRAJ_COMPLETE": f"source_{shell}"})
    assert script.exit_code == 0
    assert f"_QTRAJ_COMPLETE=complete_{shell}" in script.stdout
    more = {"_TYPER_COMPLETE_FISH_ACTION": "get-args"} if shell == "fish" else {}
    commands = complete(qtraj, shell, "qtraj s", **more)
    assert all(name in commands for name in ("slew", "simulate"))
    assert "evaluate" not in commands
    assert "--objective" in complete(qtraj, shell, "qtraj tune --ob", **more)
    assert "smoothest" in complete(qtraj, shell, "qtraj tune --objective s", **more)


def test_a_narrow_terminal_folds_numbers_and_cuts_none():
    narrow = Console(file=io.StringIO(), width=20)
    table = plain_table(right=("value", "limit"))
    table.add_row("0.0501612", "0.0444444")
    narrow.print(table)
    digits = [line.split() for line in narrow.file.getvalue().splitlines() if any(map(str.isdigit, line))]
    assert ["".join(cells) for cells in zip(*digits, strict=True)] == ["0.0501612", "0.0444444"]


def test_json_has_null_where_a_number_is_not_finite():
    assert finite({"a": [1.0, float("nan")], "b": {"c": float("inf")}, "d": "x"}) == {
        "a": [1.0, None],
        "b": {"c": None},
        "d": "x",
    }


def test_version(qtraj):
    result = qtraj("--version")
    assert (result.exit_code, result.stdout) == (0, f"qtraj {qt.__version__}\n")


@pytest.mark.parametrize(
    ("setting", "expected"),
    [
        ({"JAX_COMPILATION_CACHE_DIR": "/somewhere"}, "/somewhere"),
        ({"JAX_ENABLE_COMPILATION_CACHE": "0"}, "None"),
        ({}, "{cache}/qtraj/jax"),
    ],
    ids=["folder", "off", "none"],
)
def test_the_environment_decides_on_the_cache(tmp_path, setting, expected):
    """A folder of JAX's own setting is left alone, and a cache that is switched off stays off."""
    code = "import jax; from qtraj.cli.main import prepare; prepare(); print(jax.config.jax_compilation_cache_dir)"
    done = process(["-c", code], XDG_CACHE_HOME=str(tmp_path), **setting)
    assert done.stdout.strip() == expected.format(cache=tmp_path)
    assert any(tmp_path.iterdir()) == (not setting)


def surroundings(**environment):
    """The environment of a true process, away from the settings of this test session."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("JAX_", "XDG_", "PYTHON"))}
    return kept | {"PYTHONPATH": str(SOURCE)} | environment


def process(arguments, **environment):
    return subprocess.run(
        [sys.executable, *arguments],
        env=surroundings(**environment),
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGINT for one process of a group")
@pytest.mark.usefixtures("interruptible")
def test_ctrl_c_in_a_running_process_leaves_nothing_but_its_compilations(tmp_path):
    """Interrupted once it computes, which it does when the first compilation lies in its cache."""
    cache, out = tmp_path / "cache", tmp_path / "results"
    command = [sys.executable, "-m", "qtraj", "simulate", str(SIMULATION), "--out", str(out)]
    environment = surroundings(XDG_CACHE_HOME=str(cache))
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as running:
        deadline = time.monotonic() + 60
        while running.poll() is None and time.monotonic() < deadline and not any(cache.glob("qtraj/jax/*")):
            time.sleep(0.05)
        running.send_signal(signal.SIGINT)
        printed, told = running.communicate(timeout=60)
    assert running.returncode == 130
    *progress, last = told.splitlines()  # a slow machine reports progress
    assert (printed, last) == (b"", b"interrupted")
    assert all(re.fullmatch(rb".* \(\d+ s\)", line) for line in progress), told
    assert [file.name for file in tmp_path.iterdir()] == ["cache"]
    assert any((cache / "qtraj" / "jax").iterdir())


def test_a_process_computes_in_float64():
    done = process(["-m", "qtraj", "evaluate", str(HELIX), "--samples", "2", "--json", "--quiet"])
    assert (done.returncode, done.stderr) == (0, "")
    curvature = json.loads(done.stdout)["columns"]["curvature"][0]
    rate = 0.39269908169872414
    assert curvature == pytest.approx(10 * rate**2 / (100 * rate**2 + 0.25**2), rel=1e-14)


def test_neither_a_cache_that_cannot_be_made_nor_a_terminal_without_greek_is_an_error(tmp_path):
    (tmp_path / "file").write_text("")
    arguments = ["-m", "qtraj", "evaluate", str(HELIX), "--samples", "2", "--quiet"]
    done = process(arguments, XDG_CACHE_HOME=str(tmp_path / "file"), PYTHONIOENCODING="ascii")
    assert (done.returncode, done.stderr) == (0, "")
    assert "540.00? about the axis" in done.stdout


def test_missing_packages_are_named():
    missing = "import sys; sys.modules.update(typer=None, matplotlib=None, plotly=None)"
    code = f"{missing}; from qtraj.cli.main import main; main()"
    done = process(["-c", code])
    assert done.returncode == 2
    assert done.stdout == ""
    assert "typer, matplotlib, plotly" in done.stderr
    assert "pip install 'qtraj[all]'" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("command", "words"),
    [("evaluate", "[default: 25]"), ("evaluate", "[default: upright]"), ("slew", "in the table"), ("tune", "upright]")],
)
def test_help_shows_what_stands_in_brackets(qtraj, command, words):
    assert words in " ".join(qtraj(command, "--help").stdout.replace("│", " ").split())
