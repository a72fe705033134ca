"""What reaches the terminal: no control characters of the input, one line for each error, progress in a log."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from qtraj.cli.console import LONGEST
from qtraj.foundation import progress_bar
from qtraj.foundation.printable import one_line, printable
from qtraj.foundation.progress import Progress
from qtraj.foundation.progress_bar import watching

EXAMPLES = Path(__file__).parents[2] / "examples"
RED = "\x1b[31m"
FULL = "/dev/full"
TABLE = ["evaluate", EXAMPLES / "helix.toml", "--samples", "2"]

LOST = """
import gc, signal, sys, time
from qtraj.cli.interrupts import keep_interrupts

signal.signal(signal.SIGINT, signal.default_int_handler)  # also in the background of a script
keep_interrupts()
gc.callbacks.append(lambda phase, info: time.sleep(0.5))
print("ready", flush=True)
try:
    for _ in range(100):
        gc.collect()
        time.sleep(0.3)
except KeyboardInterrupt:
    sys.exit(130)
"""


def run(*arguments, **streams):
    command = [sys.executable, "-m", "qtraj", *map(str, arguments)]
    return subprocess.run(command, capture_output=not streams, text=True, timeout=300, **streams)


@pytest.mark.skipif(not os.path.exists(FULL), reason="this system has no device that is always full")
@pytest.mark.parametrize("arguments", [["--version"], TABLE, [*TABLE, "--json"], ["--help"]])
def test_output_that_cannot_be_printed_is_one_message(tmp_path, arguments):
    with open(FULL, "w") as full:
        done = run(*arguments, cwd=tmp_path, stdout=full, stderr=subprocess.PIPE)
    assert done.returncode == 1
    *progress, last = done.stderr.splitlines()  # a busy machine reports the progress of what takes long
    assert last == "error: the results could not be printed: No space left on device"
    assert all("error" not in line for line in progress)


def test_control_characters_of_names_and_headers_are_printed_escaped(qtraj, tmp_path):
    scenario, missing, headers = tmp_path / "s.toml", tmp_path / f"{RED}none.csv", tmp_path / f"{RED}.csv"
    headers.write_text(f"t,x{RED},q\n0,1,2\n1,2,3\n")
    scenario.write_text(f'"a{RED}" = 1\n')
    for file in (missing, headers, scenario):
        result = qtraj("route", file)
        assert result.exit_code == 2
        assert "\x1b" not in result.output
        assert "\\x1b[31m" in result.stderr
        assert result.stderr.count("\n") == 1


def test_control_characters_of_a_scenario_are_printed_escaped(qtraj, tmp_path):
    scenario = tmp_path / "s.toml"
    text = (EXAMPLES / "slew_through_attitudes.toml").read_text()
    name = "A camera through three attitudes"
    scenario.write_text(text.replace(name, "a\\u001b[31mb\\u202e"))
    result = qtraj("slew", scenario, "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "a\\x1b[31mb\\u202e" in result.output
    assert "\x1b" not in result.output


def test_letters_of_all_languages_are_printed_as_they_are():
    text = "Straße → ω⁰ 曲率\t½"
    assert printable(text) == text


def test_messages_have_one_line_and_at_most_a_screenful():
    assert one_line("a\n  b\rc\n", LONGEST) == "a b\\rc"
    assert len(one_line("x" * 10 * LONGEST, LONGEST)) == LONGEST


def test_an_interrupt_in_a_callback_of_the_garbage_collector_is_not_lost():
    process = subprocess.Popen(
        [sys.executable, "-c", LOST],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    time.sleep(0.2)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "ignored" not in errors


def test_a_log_has_a_line_every_few_seconds_and_none_for_short_computations(monkeypatch, capsys):
    monkeypatch.setattr(progress_bar, "EVERY", 0.1)
    with watching() as watch:
        watch.say("reading")
    assert capsys.readouterr().err == ""
    begun = time.monotonic()
    with watching() as watch:
        watch.tuning(Progress("searches", 3, 8))
        time.sleep(0.35)
    lines = capsys.readouterr().err.splitlines()
    assert 1 <= len(lines) <= (time.monotonic() - begun) / 0.1  # the sleep takes longer on a busy machine
    assert lines[0].startswith("tuning: 3 of 8 searches (")


def test_quiet_prints_no_progress(monkeypatch, capsys):
    monkeypatch.setattr(progress_bar, "EVERY", 0.02)
    with watching(quiet=True) as watch:
        watch.say("reading")
        time.sleep(0.1)
    assert capsys.readouterr().err == ""
