"""Files are complete or absent, and the staging folders of killed processes are removed by the next write."""

import os
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest

from qtraj.foundation import files

SOURCE = Path(__file__).parents[2] / "src"

locks = pytest.mark.skipif(files._prefix() is None, reason="this system cannot tell which process owns a folder")

STAGE = """
import sys
from pathlib import Path
from qtraj.foundation.files import move, staging
with staging(Path(sys.argv[1])) as stage:
    (stage / "content").write_text("half")
    {step}
    print("staged", flush=True)
    sys.stdin.read()
"""
REPLACE = """
(stage / "store").mkdir()
    (stage / "store" / "new").write_text("")
    import os
    replace = os.replace
    def paused(source, target):
        replace(source, target)
        print("staged", flush=True)
        sys.stdin.read()
    os.replace = paused
    move(stage / "store", Path(sys.argv[1]) / "store")
"""


@contextmanager
def writing(folder, step="pass"):
    """A separate process that has staged files in the folder and waits."""
    command = [sys.executable, "-c", STAGE.format(step=step.strip()), str(folder)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=os.environ | {"PYTHONPATH": str(SOURCE)}
    ) as process:
        try:
            assert process.stdout.readline() == "staged\n"
            yield process
        finally:
            process.kill()


def killed(folder, step="pass"):
    with writing(folder, step) as process:
        process.send_signal(signal.SIGKILL)
        process.wait()
    assert process.returncode == -signal.SIGKILL


def names(folder):
    return sorted(os.listdir(folder))


def test_a_failed_write_leaves_nothing(tmp_path, monkeypatch):
    def failing(*_):
        raise OSError("disk full")

    monkeypatch.setattr(files.os, "replace", failing)
    with pytest.raises(OSError, match="disk full"):
        files.write_atomically(tmp_path / "x", b"content")
    assert not os.listdir(tmp_path)


def test_a_file_never_replaces_a_folder(tmp_path):
    (tmp_path / "x" / "mine").mkdir(parents=True)
    with pytest.raises(OSError):
        files.write_atomically(tmp_path / "x", b"content")
    assert names(tmp_path) == ["x"]
    assert names(tmp_path / "x") == ["mine"]


@locks
def test_the_next_write_removes_the_folder_of_a_killed_process(tmp_path):
    killed(tmp_path)
    killed(tmp_path)
    assert len(names(tmp_path)) == 1  # the second process removed the folder of the first
    assert names(tmp_path)[0].startswith(".qtraj-")
    files.write_atomically(tmp_path / "x", b"content")
    assert names(tmp_path) == ["x"]


@locks
def test_the_folder_of_a_living_process_stays(tmp_path):
    with writing(tmp_path) as process:
        (stage,) = tmp_path.iterdir()
        files.write_atomically(tmp_path / "x", b"content")
        assert (stage / "content").read_text() == "half"
        process.communicate("")  # it continues undisturbed
        assert process.returncode == 0
    assert names(tmp_path) == ["x"]


@locks
def test_the_folder_of_a_stopped_process_stays(tmp_path):
    with writing(tmp_path) as process:
        process.send_signal(signal.SIGSTOP)
        (stage,) = tmp_path.iterdir()
        files.sweep(tmp_path)
        assert (stage / "content").read_text() == "half"


@locks
def test_folders_of_this_process_stay(tmp_path):
    with files.staging(tmp_path) as outer:
        with files.staging(tmp_path) as inner:
            assert outer.is_dir()
            assert inner.is_dir()
        assert outer.is_dir()
        assert not inner.exists()
    assert names(tmp_path) == []


@locks
def test_only_own_staging_folders_are_removed(tmp_path, monkeypatch):
    """Not: other names, another kernel's folders, files, links, folders without lock, another user's folders."""
    own, elsewhere = files._prefix(), tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / ".lock").write_text("")
    for name in (".qtraj-abc", ".qtraj-0123456789abcdef-abc", own + "nolock"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "mine").write_text("")
    (tmp_path / ".qtraj-abc" / ".lock").write_text("")
    (tmp_path / (own + "file")).write_text("")
    (tmp_path / (own + "link")).symlink_to(elsewhere)
    before = names(tmp_path)
    files.sweep(tmp_path)
    assert names(tmp_path) == before
    killed(tmp_path)
    monkeypatch.setattr(files.os, "geteuid", lambda: os.getuid() + 1)
    files.sweep(tmp_path)
    assert len(names(tmp_path)) == len(before) + 1
    monkeypatch.undo()
    files.sweep(tmp_path)
    assert names(tmp_path) == before
    assert names(elsewhere) == [".lock"]


@locks
def test_the_empty_folder_of_a_process_killed_before_locking_is_removed(tmp_path):
    (tmp_path / (files._prefix() + "empty")).mkdir()
    files.sweep(tmp_path)
    assert names(tmp_path) == []


@locks
def test_a_folder_removed_before_it_is_locked_is_created_again(tmp_path, monkeypatch):
    """Another process may consider a folder abandoned while it is empty, and before its lock is taken."""
    make, acquire, events = files.tempfile.mkdtemp, files._acquire, []

    def swept_when_empty(**arguments):
        stage = make(**arguments)
        if not events:
            events.append("empty")
            os.rmdir(stage)
        return stage

    def swept_before_locked(lock, stage):
        if events == ["empty"]:
            events.append("unlocked")
            files._discard(stage)
        return acquire(lock, stage)

    monkeypatch.setattr(files.tempfile, "mkdtemp", swept_when_empty)
    monkeypatch.setattr(files, "_acquire", swept_before_locked)
    files.write_atomically(tmp_path / "x", b"content")
    assert events == ["empty", "unlocked"]
    assert names(tmp_path) == ["x"]


@pytest.mark.parametrize("missing", ["kernel", "locks"])
def test_without_locks_files_are_written_and_nothing_is_removed(tmp_path, monkeypatch, missing):
    def refused(*_):
        raise OSError("no locks available")

    if missing == "kernel":
        monkeypatch.setattr(files, "_prefix", lambda: None)
    elif files.fcntl is not None:
        monkeypatch.setattr(files.fcntl, "flock", refused)
    with files.staging(tmp_path) as stage:
        files.write_atomically(tmp_path / "x", b"content")
        assert stage.is_dir()
        assert not files._prefix() or not stage.name.startswith(files._prefix())
    assert names(tmp_path) == ["x"]


@locks
def test_a_folder_is_restored_if_its_replacement_was_killed(tmp_path):
    """The process is killed while neither the old nor the new folder is in place."""
    (tmp_path / "store").mkdir()
    (tmp_path / "store" / "old").write_text("")
    killed(tmp_path, REPLACE)
    assert "store" not in names(tmp_path)
    files.sweep(tmp_path)
    assert names(tmp_path) == ["store"]
    assert names(tmp_path / "store") == ["old"]


def test_a_folder_is_restored_if_its_replacement_fails(tmp_path, monkeypatch):
    (tmp_path / "store").mkdir()
    (tmp_path / "store" / "old").write_text("")
    replace = os.replace

    def failing(source, target):
        if Path(source).parent.name.startswith(".qtraj-"):
            raise OSError("disk full")
        replace(source, target)

    monkeypatch.setattr(files.os, "replace", failing)
    with files.staging(tmp_path) as stage:
        (stage / "store").mkdir()
        with pytest.raises(OSError, match="disk full"):
            files.move(stage / "store", tmp_path / "store")
        monkeypatch.undo()
    assert names(tmp_path) == ["store"]
    assert names(tmp_path / "store") == ["old"]
