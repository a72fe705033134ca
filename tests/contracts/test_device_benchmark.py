"""The benchmark of an accelerator runs with few packages, keeps what it measured, and reports what fails."""

import json
from functools import partial

import lazy_loader
import pytest
from benchmarks import bare, device, passes

import qtraj


def test_the_stand_in_finds_what_lazy_loader_finds():
    own, _, names = bare.attach_stub("qtraj", qtraj.__file__)
    other, _, expected = lazy_loader.attach_stub("qtraj", qtraj.__file__)
    assert sorted(names) == sorted(expected)
    assert all(own(name) is other(name) for name in ("quaternion", "tune", "Limits"))
    own, _, _ = bare.attach("qtraj.algebra", ["rotation"])
    assert own("rotation") is qtraj.rotation
    with pytest.raises(AttributeError):
        own("rotations")


def test_a_failure_loses_no_other_row(tmp_path, monkeypatch):
    rows = {
        "one": partial(device.evaluation, "float64", 1, 500, None, 1),
        "none": partial(device.evaluation, "float64", 1, 500, "median", 1),
        "proofs": partial(device.proofs, 3, 1),
    }
    monkeypatch.setattr(device, "tasks", lambda quick, on_cpu: rows)
    folder = tmp_path / "created" / "for it"
    assert device.main(["--quick", "--folder", str(folder)]) == 1
    (file,) = folder.iterdir()
    assert file.name == f"{device.name()}.json"
    found = json.loads(file.read_text())["races"]["device"]["rows"]
    assert [row["agrees"] for row in found[::2]] == ["yes", "yes"]
    assert "ValueError: reduce must be" in found[1]["agrees"]


def test_a_wrong_value_is_reported():
    row = device.row("wrong", device.Found([1.0, 2.0, 3.0], 1e-3, 1e-6, 4e9, 5.0), 8e9)
    assert row["agrees"] == "no, more than 1e-06"
    assert row["time [ms]"] == 2000
    assert row["fraction of the copy"] == 0.25


def test_a_cpu_is_not_written_into_documents(capsys):
    with pytest.raises(SystemExit) as error:
        device.main(["--write"])
    assert error.value.code == 2
    assert "only measurements of an accelerator" in capsys.readouterr().err


def test_separate_outputs_are_computed_in_several_passes():
    """XLA's compiler for CPUs reads the times in many loops and repeats operations, but not in one loop."""
    given, found = passes.measured(64)
    separate, joined = found["separate arrays"], found["in one loop"]
    assert joined.loops_that_read_the_times == 1
    assert joined.additions_and_multiplications <= 1.1 * given
    assert separate.loops_that_read_the_times > 10
    assert separate.additions_and_multiplications > 2 * given
