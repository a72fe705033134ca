"""Damaged files of every format: one ValueError in one line with the name of the file, within seconds."""

import copy
import json
import os
import subprocess
import sys
import time

import numpy as np
import pytest

import qtraj as qt

START, END = qt.BoundaryState([10.0, 0, 0], [-1.0, 8, 0.5]), qt.BoundaryState([9.0, 2, 4], [1.0, 8, 0.5])
PATH = qt.SpiralHelix.hermite(START, END, 4.0)
STORED = {
    "path": PATH,
    "route": qt.Route.from_path(PATH),
    "tuned": qt.tune(START, END, qt.Limits(curvature=3.0)),
    "shape": qt.Shape.through([[0.0, 0], [5, 1], [9, 4], [9, 9]], widths=[[1.0, 2]] * 4),
    "retimed": qt.retime(PATH, qt.Limits(speed=20.0, acceleration=40.0)),
    "turn": qt.EulerTurn([1.0, 0, 0, 0], [1.0, 1, 0, 0], qt.Quintic(duration=2.0)),
    "program": qt.FrameProgram(PATH),
}
WRONG = [[], {}, "x", 1e308, -1, True, [[1.0]], [1.0, 2.0], {"type": "Limits"}, "NaN", 0, 10**30, [None], {"type": []}]
DATASETS, DOCUMENTS = ("nc", "zarr", "parquet", "csv"), ("toml", "json")
SECONDS = 60.0
COUNT, FEW, MANY = 40, 6, 500  # flipped bits: of files read by this process, by a child process, and in slow tests


def saved(folder, suffix):
    """A saved dataset or path."""
    file = folder / f"saved.{suffix}"
    if suffix in DOCUMENTS:
        PATH.save(file)
    else:
        qt.save_dataset(qt.evaluate(PATH, np.linspace(0.0, 4.0, 9)), file)
    return file


def read(file):
    """Read a file, which may be damaged; return the message of the error, if any."""
    begun = time.monotonic()
    try:
        (qt.load if file.suffix[1:] in DOCUMENTS else qt.load_dataset)(file)
    except ValueError as error:
        return str(error)
    finally:
        assert time.monotonic() - begun < SECONDS
    return None


def assert_refused(file, message):
    assert str(file) in message
    assert "\n" not in message
    assert len(message) < 1000 + len(str(file))


def flip(folder, suffix, count):
    """Flip one bit of a file, `count` times; return how many of these files are refused."""
    file = saved(folder, suffix)
    parts = [file] if file.is_file() else sorted(x for x in file.rglob("*") if x.is_file())
    random, refused = np.random.default_rng(36), 0
    for _ in range(count):
        part = parts[random.integers(len(parts))]
        content = part.read_bytes()
        changed = bytearray(content)
        changed[random.integers(len(changed))] ^= 1 << int(random.integers(8))
        part.write_bytes(changed)
        if message := read(file):
            assert_refused(file, message)
            refused += 1
        part.write_bytes(content)
    assert read(file) is None
    return refused


@pytest.mark.parametrize("suffix", [*DATASETS, *DOCUMENTS])
def test_a_flipped_bit_is_found_or_harmless(tmp_path, suffix):
    assert flip(tmp_path, suffix, FEW if suffix == "nc" else COUNT) > 0


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [*DATASETS, *DOCUMENTS])
def test_many_flipped_bits(tmp_path, suffix):
    assert flip(tmp_path, suffix, MANY) > MANY // 10


@pytest.mark.parametrize("suffix", [*DATASETS, *DOCUMENTS])
def test_a_truncated_file_is_refused(tmp_path, suffix):
    file = saved(tmp_path, suffix)
    part = file if file.is_file() else file / ".zmetadata"
    content = part.read_bytes()
    part.write_bytes(content[: 2 * len(content) // 3])
    assert_refused(file if file.is_file() else part, read(file))


def places(value, path=()):
    """The places of all values in a document, with at most three elements of a list."""
    yield path
    if isinstance(value, dict):
        for key in value:
            yield from places(value[key], (*path, key))
    elif isinstance(value, list):
        for k in range(min(len(value), 3)):
            yield from places(value[k], (*path, k))


@pytest.mark.parametrize("name", STORED)
def test_values_of_a_wrong_type_are_refused_or_harmless(tmp_path, name):
    file, random = tmp_path / "saved.json", np.random.default_rng(3)
    STORED[name].save(file)
    document = json.loads(file.read_text())
    inside = [place for place in places(document) if place]
    for _ in range(60):
        changed = copy.deepcopy(document)
        place = inside[random.integers(len(inside))]
        outer = changed
        for key in place[:-1]:
            outer = outer[key]
        if isinstance(outer, dict) and random.random() < 0.15:
            del outer[place[-1]]
        else:
            outer[place[-1]] = WRONG[random.integers(len(WRONG))]
        file.write_text(json.dumps(changed))
        if message := read(file):
            assert_refused(file, message)


def test_a_size_that_the_file_cannot_contain_is_refused(tmp_path):
    import h5py

    file = tmp_path / "huge.nc"
    with h5py.File(file, "w") as content:
        content.create_dataset("x", shape=(10**8, 10**8), dtype="f8", chunks=(10, 10))
    assert_refused(file, read(file))


@pytest.mark.parametrize("suffix", [*DATASETS, *DOCUMENTS])
def test_a_pipe_is_refused(tmp_path, suffix):
    file = tmp_path / f"pipe.{suffix}"
    os.mkfifo(file)
    message = read(file)
    assert_refused(file, message)
    assert "this is a pipe or a device" in message


def test_links_in_a_circle_are_refused(tmp_path):
    one, other = tmp_path / "one.nc", tmp_path / "other.nc"
    one.symlink_to(other)
    other.symlink_to(one)
    with pytest.raises(OSError, match=str(one)):
        qt.load_dataset(one)


FULL = """
import resource, sys
import numpy as np
import qtraj as qt

start, end = qt.BoundaryState([10.0, 0, 0], [-1.0, 8, 0.5]), qt.BoundaryState([9.0, 2, 4], [1.0, 8, 0.5])
path = qt.SpiralHelix.hermite(start, end, 4.0)
table = qt.evaluate(path, np.linspace(0.0, 4.0, 3000)).to_xarray()
resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))
try:
    qt.save_dataset(table, sys.argv[1])
except OSError:
    sys.exit(3)
"""


@pytest.mark.parametrize("suffix", DATASETS)
def test_a_full_disk_is_an_error_without_a_crash(tmp_path, suffix):
    """A limit on the size of files stands for a full disk; nothing is left behind."""
    done = subprocess.run([sys.executable, "-c", FULL, tmp_path / f"table.{suffix}"], capture_output=True, text=True)
    assert done.returncode == 3, done.stderr
    assert not list(tmp_path.iterdir())
