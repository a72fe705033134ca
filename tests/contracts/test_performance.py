"""The tables of docs/performance.md are those of the committed results."""

import json
import re

import pytest
from benchmarks.races import RACES
from benchmarks.report import DOCS, DOCUMENT, RESULTS, body, text, written

TEXT = DOCUMENT.read_text(encoding="utf-8")
KNOWN = json.loads(RESULTS.read_text(encoding="utf-8"))


def test_the_tables_are_the_results():
    assert written(TEXT, KNOWN) == TEXT


def test_every_race_has_results_and_a_place():
    assert KNOWN["races"].keys() <= set(RACES)
    assert len(KNOWN["races"]) >= len(RACES) - 2  # some need what not every machine has
    assert sorted(re.findall(r"<!-- end (\w+) -->", TEXT)) == sorted(RACES)


def test_every_figure_exists():
    figures = re.findall(r"\]\((figures/[^)]+)\)", TEXT)
    assert len(figures) == 2
    assert all((DOCS / name).exists() for name in figures)


def test_every_race_says_how_it_was_made():
    for race in KNOWN["races"].values():
        made = race["made"]
        assert made["command"].startswith("python -m benchmarks")
        assert {"processor", "cores", "python", "versions", "load"} <= made["machine"].keys()
        assert made["device"] in body(race)


def test_a_changed_number_is_seen():
    changed = json.loads(json.dumps(KNOWN))
    changed["races"]["sizes"]["rows"][0]["stored [ms]"] = 123.0
    assert written(TEXT, changed) != TEXT


@pytest.mark.parametrize(
    ("cell", "shown"), [(0.0, "0"), (1234.5, "1230"), (0.12345, "0.123"), (2e-9, "2.0e-09"), (7, "7"), ("a", "a")]
)
def test_numbers_are_short(cell, shown):
    assert text(cell) == shown
