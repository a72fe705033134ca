"""The tables of docs/performance.md agree with the committed results."""

import json
import re
from pathlib import Path

import pytest
from benchmarks import __main__ as command
from benchmarks.races import RACES
from benchmarks.report import DOCS, DOCUMENT, RESULTS, body, text, written

TEXT = DOCUMENT.read_text(encoding="utf-8")
KNOWN = json.loads(RESULTS.read_text(encoding="utf-8"))


def test_the_tables_are_the_results():
    assert written(TEXT, KNOWN) == TEXT


def test_every_race_has_results_and_a_place():
    assert KNOWN["races"].keys() <= set(RACES)
    assert len(KNOWN["races"]) >= len(RACES) - 2  # some need hardware or programs that not every machine has
    assert sorted(re.findall(r"<!-- end (\w+) -->", TEXT)) == sorted([*RACES, "device"])


def test_every_figure_exists():
    figures = re.findall(r"\]\((figures/[^)]+)\)", TEXT)
    assert len(figures) == 2
    assert all((DOCS / name).exists() for name in figures)


def test_every_race_says_how_it_was_made():
    for race in KNOWN["races"].values():
        made = race["made"]
        assert made["command"].startswith("python -m benchmarks")
        assert "--quick" not in made["command"]  # small sizes and few rounds are not measurements
        assert {"processor", "cores", "python", "versions", "load_before"} <= made["machine"].keys()
        assert made["device"] in body(race)


def test_a_changed_number_is_detected():
    changed = json.loads(json.dumps(KNOWN))
    changed["races"]["sizes"]["rows"][0]["stored [ms]"] = 123.0
    assert written(TEXT, changed) != TEXT


@pytest.mark.parametrize("arguments", [["--quick"], ["--name", "mine"], ["--folder", "."]])
def test_only_full_results_are_written_into_documents(arguments, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["benchmarks", "--write", *arguments])
    with pytest.raises(SystemExit) as error:
        command.main()
    assert error.value.code == 2
    assert "--write takes no --quick" in capsys.readouterr().err


@pytest.mark.parametrize("written", [None, ""])
def test_a_race_that_records_nothing_is_reported(written, tmp_path, monkeypatch, capsys):
    def nothing(options):
        if written is not None:
            Path(options[options.index("--benchmark-json") + 1]).write_text(written)
        return 1

    monkeypatch.chdir(tmp_path)  # restored after the test, whatever the command does
    monkeypatch.setattr(command.pytest, "main", nothing)
    monkeypatch.setattr("sys.argv", ["benchmarks", "sizes", "--folder", "."])
    assert command.main() == 1
    assert "sizes: failed, and nothing was recorded" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("cell", "shown"), [(0.0, "0"), (1234.5, "1230"), (0.12345, "0.123"), (2e-9, "2.0e-09"), (7, "7"), ("a", "a")]
)
def test_numbers_are_short(cell, shown):
    assert text(cell) == shown
