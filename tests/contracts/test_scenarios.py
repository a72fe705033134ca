"""The reference of scenario keys agrees with the models, and describes every key."""

import re
import runpy
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def written():
    return runpy.run_path(str(DOCS / "scenarios.py"))["page"]()


def test_the_page_is_up_to_date(written):
    """If it is not, run .venv/bin/python docs/scenarios.py"""
    assert (DOCS / "scenarios.md").read_text(encoding="utf-8") == written


def test_the_table_of_quantities_is_up_to_date():
    """If it is not, run .venv/bin/python docs/quantities.py"""
    written = runpy.run_path(str(DOCS / "quantities.py"))["page"]()
    assert (DOCS / "howto" / "limits.md").read_text(encoding="utf-8") == written


def test_every_key_has_a_meaning_a_value_and_a_default(written):
    rows = [re.split(r"(?<!\\)\|", row)[1:-1] for row in written.splitlines() if row.startswith("| `")]
    assert len(rows) > 90
    assert [row[0] for row in rows if len(row) != 4 or not all(cell.strip() for cell in row)] == []


def test_every_table_of_every_command_is_listed(written):
    for header in ("[limits]", "[[via]]", "[program.slew]", "[program.slew.law]", "[law.weights]", "[simulation]"):
        assert f"`{header}`" in written
