"""Commands and keys that were renamed still work, with a warning on stderr; the output is that of the new name."""

import json

import pytest

from qtraj.cli.main import application

from .loop_scenarios import LAW, SLEW
from .slew_scenarios import LAW as SLEW_LAW, REST

OLD = {"turn": "slew", "track": "simulate"}
SCENARIOS = {"slew": REST + SLEW_LAW, "simulate": SLEW + LAW}


def without_files(text):
    """The JSON of a run, less the places of its files."""
    return {key: value for key, value in json.loads(text).items() if key != "files"}


@pytest.mark.parametrize(("old", "new"), OLD.items())
def test_an_old_command_warns_and_does_the_same(qtraj, tmp_path, old, new):
    (tmp_path / "s.toml").write_text(SCENARIOS[new])
    runs = [qtraj(name, tmp_path / "s.toml", "--samples", 3, "--json", "--out", tmp_path / name) for name in (old, new)]
    assert [run.exit_code for run in runs] == [0, 0]
    assert runs[0].stderr == f"warning: `qtraj {old}` is now `qtraj {new}`; the old name works until 1.0\n"
    assert runs[1].stderr == ""
    assert without_files(runs[0].stdout) == without_files(runs[1].stdout)
    names = [sorted(file.name for file in (tmp_path / name).iterdir()) for name in (old, new)]
    assert names[0] == names[1]


@pytest.mark.parametrize("old", OLD)
def test_an_old_command_refuses_as_the_new_one(qtraj, tmp_path, old):
    result = qtraj(old, tmp_path / "gone.toml", "--out", tmp_path / "out")
    assert (result.exit_code, result.stdout) == (2, "")
    assert "No such file" in result.stderr


def test_old_commands_are_not_listed(qtraj):
    text = qtraj("--help").stdout
    listed = {
        command.name or command.callback.__name__: command.hidden for command in application().registered_commands
    }
    assert [name for name, hidden in listed.items() if hidden] == list(OLD)
    assert not any(f" {old} " in text for old in OLD)


def test_an_old_key_warns_and_means_the_same(qtraj, tmp_path):
    texts = {"new": SLEW + LAW, "old": (SLEW + LAW).replace("program.slew", "program.turn")}
    found = {}
    for name, text in texts.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "s.toml").write_text(text)
        run = qtraj("simulate", tmp_path / name / "s.toml", "--samples", 3, "--json", "--out", tmp_path / name / "out")
        assert run.exit_code == 0
        found[name] = (run.stderr, {key: v for key, v in without_files(run.stdout).items() if key != "scenario"})
    assert found["new"][0] == ""
    assert found["old"][0].endswith("'program.turn' is now 'program.slew'; the old name works until 1.0\n")
    assert found["old"][1] == found["new"][1]
