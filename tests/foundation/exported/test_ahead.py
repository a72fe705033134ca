"""What the last run of a command used is loaded before it is asked for."""

import threading
import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from qtraj.foundation.exported import store
from qtraj.foundation.exported.kept import ahead, keep_in, kept

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


def test_what_is_loading_when_it_is_needed_is_waited_for(run, monkeypatch):
    run(double)
    begun, needed = threading.Event(), threading.Event()
    load, made = store.Executable, []

    def slowly(content):
        begun.set()
        assert needed.wait(30)
        made.append(threading.current_thread().name)
        return load(content)

    monkeypatch.setattr(store, "Executable", slowly)
    threading.Thread(target=lambda: (begun.wait(30), time.sleep(0.2), needed.set())).start()
    np.testing.assert_array_equal(run(double, waits_for=1)[1][0], 2 * X)
    assert [name.rsplit("_")[0] for name in made] == ["qtraj-programs"]


def test_nothing_is_compiled_ahead(run, tmp_path, waiting):
    """Where JAX has kept nothing of what it compiled, loading would be compiling, and the end would wait for it."""
    run(double)
    waiting.names.clear()
    keep_in(tmp_path)
    before = jax.config.jax_compilation_cache_dir
    for folder in (None, str(tmp_path / "deleted")):
        jax.config.update("jax_compilation_cache_dir", folder)
        try:
            with ahead("demo"):
                pass
        finally:
            jax.config.update("jax_compilation_cache_dir", before)
    assert waiting.names == [*LEFT, *LEFT]


LEFT = ("no more", "cancelled")


class Waiting:
    """A pool whose turn never comes."""

    def __init__(self, *of, **named):
        self.names = []

    def submit(self, read, name):
        self.names.append(name.split("-")[0])

    def shutdown(self, wait=True, cancel_futures=False):
        self.names.append("cancelled" if cancel_futures else "no more")


@pytest.fixture
def waiting(monkeypatch):
    pool = Waiting()
    monkeypatch.setattr(store, "ThreadPoolExecutor", lambda *of, **named: pool)
    return pool


def test_what_is_needed_before_its_turn_is_loaded_by_who_needs_it(run, waiting):
    run(double)
    assert run(double)[0] == [(False, "double")]
    assert waiting.names == [*LEFT, "double", *LEFT]


def test_the_largest_comes_first(run, tmp_path, waiting):
    run(double, halve)
    (file,) = tmp_path.glob("*/halve-*")
    file.write_bytes(bytes(1_000_000))
    waiting.names.clear()
    run()
    assert waiting.names == ["halve", "double", *LEFT]


def test_the_note_is_of_the_last_run_that_needed_anything(run, tmp_path):
    run(double, halve)
    (note,) = tmp_path.glob("*/demo.used")
    both = note.read_text()
    assert [name.split("-")[0] for name in both.split()] == ["double", "halve"]
    run()
    assert note.read_text() == both
    run(halve)
    assert note.read_text() == both.split()[1]


GONE = f"double-{0:032x}"


@pytest.mark.parametrize(
    "content", ["\xff", "", "../elsewhere", "x" * 300, f"{'x' * 300}-{0:032x}", GONE], ids=range(6)
)
def test_a_spoilt_note_does_no_harm(run, tmp_path, content):
    run(double)
    (note,) = tmp_path.glob("*/demo.used")
    note.write_text(content, encoding="latin-1")
    np.testing.assert_array_equal(run(double)[1][0], 2 * X)
    assert note.read_text().startswith("double-")
    assert GONE not in note.read_text()


@pytest.mark.parametrize("command", ["other", None])
def test_other_commands_load_nothing(run, tmp_path, waiting, command):
    run(double)
    waiting.names.clear()
    keep_in(tmp_path)
    with ahead(command):
        pass
    assert set(waiting.names) <= set(LEFT)


def test_the_pool_is_left_also_by_an_error(run, tmp_path, waiting):
    keep_in(tmp_path)
    with pytest.raises(KeyboardInterrupt), ahead("demo"):
        raise KeyboardInterrupt
    assert waiting.names == list(LEFT)
    assert not any(tmp_path.rglob("*.used"))
