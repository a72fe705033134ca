"""The reference of scenario keys agrees with the models, and describes every key."""

import re
import runpy
import tomllib
from pathlib import Path

import pytest

from qtraj.scenario import KINDS
from qtraj.scenario.reader import read_scenario

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
    for header in ("[[program.sequence]]", "[law.hysteresis]", "[body.wheels]", "[disturbance.gravity_gradient]"):
        assert f"`{header}`" in written


def test_every_example_is_a_scenario_that_can_be_built(tmp_path, written):
    """Each example is completed by the tables that it does not have, and has an effect on the scenario."""
    examples = runpy.run_path(str(DOCS / "scenarios.py"))["EXAMPLES"]
    assert len(examples) >= 10
    for model, example in examples.items():
        assert f"```toml\n{example}\n```" in written, model
        kind = "slew" if model == "SlewScenario" else "loop"
        start, law = "[start]\nquaternion = [1, 0, 0, 0]\n", "[law]\nmax_acceleration = 2\n"
        if kind == "loop":
            program = "[program.spin]\nrate = [0, 0, 1]\nduration = 5\n"
            start, law = ("" if "program" in example else program), "[law]\nsettling_time = 2\n"
        file = tmp_path / f"{model}.toml"
        file.write_text(f"angles = 'deg'\n{example}\n{start}{law}")
        loaded = read_scenario(file, kind)
        KINDS[kind].build(loaded)
        tables = tomllib.loads(example)
        assert all(getattr(loaded.scenario, name) is not None for name in tables), model
