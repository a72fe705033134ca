"""Generated files: none is read wrongly, and every refusal names its remedy."""

import re
import warnings

import numpy as np
import pandas as pd
import pytest
from tests.io import generated_formats, generated_tables

from qtraj.io.track.recording import is_recording
from qtraj.io.track.track_file import read_track

REMEDY = re.compile(
    r"columns=|units=|units\[|axes=|rate=|times=|duplicates=|segment=|quaternion=|angles=|delete|drop|complete|correct|"
    r"insert|export|write|sort|omit|fill|needs at least|switch"
)
ATTITUDE = 1e-5


def read(source, options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return read_track(source, **options)


def check(case, source, what):
    """The track of a source is that of the case, or the refusal is one line with the expected remedy."""
    try:
        track = read(source, case.options)
    except ValueError as error:
        text = str(error)
        assert case.words, f"{what}: refused: {text}"
        assert re.search(case.words, text), f"{what}: expected {case.words!r}: {text}"
        assert REMEDY.search(text), f"{what}: no remedy: {text}"
        assert "\n" not in text
        return False
    assert not case.words, f"{what}: read, although {case.words!r} was expected"
    times, positions = np.asarray(track.times), np.asarray(track.positions)
    np.testing.assert_allclose(times - times[0], case.times - case.times[0], atol=case.time_tolerance, err_msg=what)
    moved, expected = positions - positions[0], case.positions - case.positions[0]
    np.testing.assert_allclose(moved, expected, atol=case.tolerance, err_msg=what)
    if case.velocities is not None and track.velocities is not None:
        np.testing.assert_allclose(track.velocities, case.velocities, atol=0.01, err_msg=what)
    if case.attitudes is not None:
        assert track.attitudes is not None, what
        same = np.abs(np.sum(np.asarray(track.attitudes) * case.attitudes, axis=1))
        np.testing.assert_allclose(same, 1, atol=ATTITUDE, err_msg=what)
    return True


def generated(tmp_path, make, seeds):
    """Check the files of these seeds; return the number of those that were read."""
    count = 0
    for seed in seeds:
        case = make(np.random.default_rng(seed))
        file = tmp_path / case.name
        file.write_bytes(case.data)
        what = f"seed {seed}: {case.options}\n{case.data[:600].decode(errors='replace')}"
        assert is_recording(file, case.data) or case.words, what
        count += check(case, file, what)
    return count


@pytest.mark.parametrize("first", [0, pytest.param(1000, marks=pytest.mark.slow)])
def test_tables(tmp_path, first):
    assert generated(tmp_path, generated_tables.table, range(first, first + (1500 if first else 500))) > 250


def test_tables_as_data_frames():
    for seed in range(200):
        case = generated_tables.table(np.random.default_rng(seed))
        frame = pd.DataFrame({c.name: typed(c.cells) for c in case.columns})
        frame.columns = [f"{c.name} [{c.unit}]" if c.unit and "[" not in c.name else c.name for c in case.columns]
        if len(set(frame.columns)) == len(frame.columns) and "columns" not in case.options:
            options = {name: value for name, value in case.options.items() if name != "units"}
            check(case._replace(options=options), frame, f"seed {seed}: {options} {list(frame.columns)}")


def typed(cells):
    try:
        return [int(cell) for cell in cells]
    except ValueError:
        pass
    try:
        return [float(cell) if cell else None for cell in cells]
    except ValueError:
        return [cell or None for cell in cells]


@pytest.mark.parametrize("kind", generated_formats.KINDS)
@pytest.mark.parametrize("first", [0, pytest.param(1000, marks=pytest.mark.slow)])
def test_formats(tmp_path, kind, first):
    """The formats of the issue, each in twenty variations."""
    make = generated_formats.KINDS[kind]
    assert generated(tmp_path, make, range(first, first + (200 if first else 20))) > 5


BYTES = list(b",;\t .-+eE0123nZ:\"'#<>/\n\r\x00\xff")


def damaged(rng, data):
    """The bytes of a file with up to five random changes."""
    data = bytearray(data)
    for _ in range(int(rng.integers(1, 6))):
        k, length = int(rng.integers(len(data) + 1)), int(rng.integers(1, 60))
        kind = int(rng.integers(3))
        if kind == 0:
            del data[k : k + length]
        elif kind == 1:
            data[k:k] = bytes(rng.choice(BYTES, int(rng.integers(1, 6))).tolist())
        else:
            data[k:k] = data[:length]
    return bytes(data)


def refusal(file, options):
    """The message of the refusal, or an empty text."""
    try:
        read(file, options)
    except ValueError as error:
        return str(error) if type(error) is ValueError else f"{type(error)}\n"
    return ""


@pytest.mark.parametrize("count", [400, pytest.param(3000, marks=pytest.mark.slow)])
def test_damaged_files(tmp_path, count):
    """They are read, or refused in one line."""
    makes = [generated_tables.table, *generated_formats.KINDS.values()]
    for seed in range(count):
        rng = np.random.default_rng([9, seed])
        case = makes[seed % len(makes)](rng)
        file = tmp_path / case.name
        file.write_bytes(damaged(rng, case.data))
        text = refusal(file, case.options)
        assert "\n" not in text, seed
