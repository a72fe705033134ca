"""Later processes load what one process compiled; an unusable folder is an error before anything is compiled."""

import os
import subprocess
import sys
from pathlib import Path

import jax
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


@pytest.mark.parametrize(
    ("environment", "expected"),
    [
        ({"XDG_CACHE_HOME": "/somewhere"}, "/somewhere/qtraj/jax"),
        ({"LOCALAPPDATA": "/windows"}, "/windows/qtraj/jax"),
        ({"XDG_CACHE_HOME": "relative", "LOCALAPPDATA": "/windows"}, "/windows/qtraj/jax"),
    ],
)
def test_the_default_is_in_the_cache_folder_of_the_user(monkeypatch, environment, expected):
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert default_folder() == Path(expected)


@pytest.mark.parametrize(("platform", "expected"), [("linux", ".cache"), ("darwin", "Library/Caches")])
def test_without_settings_it_is_in_the_home_folder(monkeypatch, tmp_path, platform, expected):
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    monkeypatch.setattr(compilation_cache.sys, "platform", platform)
    assert default_folder() == tmp_path / expected / "qtraj" / "jax"


def test_without_a_home_folder_one_must_be_passed(monkeypatch):
    def none():
        raise RuntimeError("Could not determine home directory.")

    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(Path, "home", none)
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
