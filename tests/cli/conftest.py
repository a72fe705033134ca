"""One run of the default scenario for the whole session: compiling the tuning takes most of the time."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import xarray
from typer.testing import CliRunner

from qtraj.cli.main import application
from qtraj.foundation import progress_bar
from qtraj.viz import style


@pytest.fixture(scope="module", autouse=True)
def unchecked(as_a_user_runs_it, each_picture_is_drawn_once):
    """The command line runs as it does for a user, except that it draws each picture once."""


@pytest.fixture(scope="session", autouse=True)
def without_lines_of_progress():
    """A busy machine reports the progress of what takes seconds elsewhere; the tests of messages do not expect it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(progress_bar, "EVERY", 3600.0)
        yield


@pytest.fixture
def all_pictures_are_drawn(monkeypatch, each_picture_is_drawn_once):
    monkeypatch.setattr(style, "save", each_picture_is_drawn_once)


@pytest.fixture(scope="session")
def qtraj():
    """Run the command line in this process."""
    runner = CliRunner()
    return lambda *args, **more: runner.invoke(application(), [str(arg) for arg in args], prog_name="qtraj", **more)


@dataclass
class Run:
    """A finished `qtraj tune`."""

    result: Any
    content: dict
    out: Path

    @property
    def dataset(self):
        return xarray.load_dataset(self.out / "paths.nc")


@pytest.fixture(scope="session")
def default_run(qtraj, tmp_path_factory):
    out = tmp_path_factory.mktemp("default") / "new" / "results"
    result = qtraj("tune", "--json", "--out", out)
    return Run(result, json.loads(result.stdout), out)
