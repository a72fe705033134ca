"""Later processes load what one process compiled; an unusable folder is an error before anything is compiled."""

import os
import subprocess
import sys
from pathlib import Path

import jax
import platformdirs
import pytest

import qtraj as qt
from qtraj.foundation import compilation_cache
from qtraj.foundation.compilation_cache import default_folder

PROCESS = """
import sys
from pathlib import Path

import jax
import jax.numpy as jnp

import qtraj as qt

hits = []
jax.monitoring.register_event_listener(lambda event, **_: hits.append(event) if event.endswith("/cache_hits") else None)
for folder in sys.argv[1:]:
    print(qt.enable_compilation_cache(folder or None))
    jax.jit(lambda x: 2 * x + len(folder))(jnp.arange(3.0))
print(len(hits))
"""


def process(*folders, **environment):
    """The folders that a new process returned, and the number of functions that it loaded from them."""
    inherited = {k: v for k, v in os.environ.items() if not k.startswith(("JAX_", "XDG_"))}
    command = [sys.executable, "-c", PROCESS, *map(str, folders)]
    done = subprocess.run(command, env=inherited | environment, capture_output=True, text=True, check=True, timeout=120)
    *returned, hits = done.stdout.splitlines()
    assert done.stderr == ""
    return [Path(folder) for folder in returned], int(hits)


def compiled(folder):
    return {file.name for file in folder.glob("*-cache")}


def test_a_second_process_loads_what_the_first_compiled(tmp_path):
    folder = tmp_path / "new" / "compiled"
    assert process(folder) == ([folder], 0)
    first = compiled(folder)
    assert first
    assert process(folder) == ([folder], len(first))
    assert compiled(folder) == first


def test_another_folder_takes_effect_at_once(tmp_path):
    """JAX itself keeps using its first folder."""
    one, other = tmp_path / "one", tmp_path / "another"
    assert process(one, other)[0] == [one, other]
    assert compiled(one)
    assert compiled(other)


def test_the_default_folder_is_the_users_own(tmp_path):
    folders, _ = process("", XDG_CACHE_HOME=str(tmp_path))
    assert folders == [tmp_path / "qtraj" / "jax"]
    assert compiled(*folders)


def test_a_relative_cache_folder_is_ignored(monkeypatch):
    """As the XDG specification demands."""
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    assert default_folder().is_absolute()


def test_without_a_home_folder_one_must_be_passed(monkeypatch):
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda *args, **more: Path("~/.cache/qtraj"))
    with pytest.raises(ValueError, match="no home folder"):
        qt.enable_compilation_cache()


@pytest.mark.parametrize(("name", "message"), [("file", "this is a file"), ("file/below", "cannot be created")])
def test_a_folder_that_cannot_be_created_is_an_error(tmp_path, name, message):
    (tmp_path / "file").write_text("")
    before = jax.config.jax_compilation_cache_dir
    with pytest.raises(ValueError, match=rf"{name}.*{message}"):
        qt.enable_compilation_cache(tmp_path / name)
    assert jax.config.jax_compilation_cache_dir == before


def test_a_folder_that_cannot_be_written_to_is_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr(compilation_cache.os, "access", lambda path, mode: False)
    with pytest.raises(ValueError, match="is not writable"):
        qt.enable_compilation_cache(tmp_path)


def test_the_import_loads_no_heavy_package():
    code = "import sys, qtraj.foundation.compilation_cache; print({'jax', 'equinox', 'numpy'} & {*sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"
