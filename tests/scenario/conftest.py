"""Scenarios are read and built as the command line does it for a user."""

import pytest

from qtraj.scenario.loop import prepare
from qtraj.scenario.reader import read_scenario


@pytest.fixture(scope="module", autouse=True)
def unchecked(as_a_user_runs_it):
    """Without the checks of shapes."""


@pytest.fixture
def read(tmp_path):
    """Read a scenario of a path, or of another kind, from its text."""

    def read(text, kind="path"):
        (tmp_path / "s.toml").write_text(text, encoding="utf-8")
        return read_scenario(tmp_path / "s.toml", kind)

    return read


@pytest.fixture
def prepared(read):
    """Read a scenario of a loop from its text, and prepare its simulation."""
    return lambda text: prepare(read(text, "loop"))
