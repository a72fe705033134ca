"""What the last run of a command used is loaded before it is asked for."""

import threading
import time

import jax.numpy as jnp
import numpy as np
import pytest

from qtraj.foundation.programs import store
from qtraj.foundation.programs.kept import ahead, keep_in, kept

X = jnp.arange(3.0)


def double(x):
    return 2 * x


def halve(x):
    return x / 2


@pytest.fixture
def run(tmp_path, monkeypatch):
    """One process: a command that calls some functions; the threads that read programs, and what they read."""
    read = store.read

    def process(*functions, waits_for=0):
        seen = []

        def noted(file):
            content = read(file)
            if content is not None:
                seen.append((threading.current_thread().name.startswith("qtraj-programs"), file.name.split("-")[0]))
            return content

        monkeypatch.setattr(store, "read", noted)
        keep_in(tmp_path)
        with ahead("demo"):
            until = time.monotonic() + 30
            while len(seen) < waits_for and time.monotonic() < until:
                time.sleep(0.01)
            results = [kept()(f)(X) for f in functions]
        return sorted(seen), results

    yield process
    keep_in(None)


def test_the_second_process_finds_its_programs_loaded(run):
    assert run(double, halve)[0] == []
    seen, (doubled, halved) = run(double, halve, waits_for=2)
    assert seen == [(True, "double"), (True, "halve")]
    np.testing.assert_array_equal(doubled, 2 * X)
    np.testing.assert_array_equal(halved, X / 2)


class Waiting:
    """A pool whose turn never comes."""

    def __init__(self, *of, **named):
        self.names = []

    def submit(self, read, name):
        self.names.append(name.split("-")[0])

    def shutdown(self, **named):
        self.names.append("shut down")


@pytest.fixture
def waiting(monkeypatch):
    pool = Waiting()
    monkeypatch.setattr(store, "ThreadPoolExecutor", lambda *of, **named: pool)
    return pool


def test_what_is_needed_before_its_turn_is_loaded_by_who_needs_it(run, waiting):
    run(double)
    assert run(double)[0] == [(False, "double")]
    assert waiting.names == ["shut down", "double", "shut down"]


def test_the_largest_comes_first(run, tmp_path, waiting):
    run(double, halve)
    (file,) = tmp_path.glob("*/halve-*")
    file.write_bytes(bytes(1_000_000))
    waiting.names.clear()
    run()
    assert waiting.names == ["halve", "double", "shut down"]


def test_the_note_is_of_the_last_run_that_needed_something_else(run, tmp_path):
    run(double, halve)
    (note,) = tmp_path.glob("*/demo.used")
    both = note.read_text()
    assert [name.split("-")[0] for name in both.split()] == ["double", "halve"]
    run(double)
    assert note.read_text() == both
    note.write_text("")
    run(halve)
    assert note.read_text() == both.split()[1]


@pytest.mark.parametrize("content", [b"\xff\xfe", b"", b"never-seen\n../elsewhere"])
def test_a_spoilt_note_does_no_harm(run, tmp_path, content):
    run(double)
    (note,) = tmp_path.glob("*/demo.used")
    note.write_bytes(content)
    np.testing.assert_array_equal(run(double)[1][0], 2 * X)


@pytest.mark.parametrize("command", ["other", None])
def test_other_commands_load_nothing(run, tmp_path, waiting, command):
    run(double)
    waiting.names.clear()
    keep_in(tmp_path)
    with ahead(command):
        pass
    assert set(waiting.names) <= {"shut down"}


def test_the_pool_is_left_also_by_an_error(run, tmp_path, waiting):
    keep_in(tmp_path)
    with pytest.raises(KeyboardInterrupt), ahead("demo"):
        raise KeyboardInterrupt
    assert waiting.names == ["shut down"]
    assert not any(tmp_path.rglob("*.used"))
