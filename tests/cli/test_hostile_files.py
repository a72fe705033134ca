"""Files made to break a reader: one line and exit code 2, whatever they hold."""

import contextlib
import json

import numpy as np
import pytest

import qtraj as qt
from qtraj.foundation import untrusted
from qtraj.io.flat import FORMAT

DEEP = 100_000
NESTED = untrusted.MAX_DEPTH + 1

HEADER = {"format": FORMAT, "rows": ["time"], "dimensions": {"time": 1}, "attributes": {}, "variables": {}}
DATASET = "# " + json.dumps(HEADER)
LONG = 1_000_000
DIGITS = "9" * 10_000
FILES = {
    "deep.json": "[" * DEEP + "]" * DEEP,
    "deep.toml": "a = " + "[" * DEEP + "]" * DEEP,
    "tables.toml": ".".join("a" * DEEP) + " = 1",
    "nested.json": json.dumps({"format": "qtraj/1", "type": "Limits", "curvature": 0.1})[:-1]
    + ', "more": '
    + "[" * NESTED
    + "]" * NESTED
    + "}",
    "deep.csv": "# {" + '"a": ' + "[" * DEEP + "]" * DEEP + "}\nt\n1\n",
    "wide.csv": DATASET + "\nt,x\n1," + "9" * 200_000 + "\n",
    "wide_text.csv": "t,x,y,z\n0," + "9" * 200_000 + ",0,0\n" + "\n".join(f"{k},{k},0,0" for k in range(1, 12)),
    "list.csv": "# " + json.dumps(HEADER | {"variables": []}) + "\nt\n1\n",
    "number.csv": "# " + json.dumps(HEADER | {"variables": {"t": 3}}) + "\nt\n1\n",
    "numbers.csv": "# " + json.dumps(HEADER | {"numbers": 3}) + "\nt\n1\n",
    "long.toml": "x = '" + "a" * LONG + "'",
    "empty.json": "",
    "null.toml": "\0",
    "digits.toml": "format = " + DIGITS,
    "digits.json": '{"format": "qtraj/1", "type": "Limits", "curvature": ' + DIGITS + "}",
    "digits.csv": "# " + json.dumps(HEADER | {"numbers": 3})[:-1] + ', "more": ' + DIGITS + "}\nt\n1\n",
}


@pytest.mark.parametrize("command", ["report", "tune"])
@pytest.mark.parametrize("name", FILES)
def test_a_hostile_file_is_refused_in_one_line(qtraj, tmp_path, name, command):
    file = tmp_path / name
    file.write_text(FILES[name])
    result = qtraj(command, file, "--out", tmp_path / "out.html")
    assert result.exit_code == 2, result.output
    assert result.stderr.startswith("error: ")
    assert result.stderr.count("\n") == 1
    assert str(file) in result.stderr
    assert len(result.stderr) < 1000 + len(str(file))
    assert "set_int_max_str_digits" not in result.stderr


def test_a_recording_with_a_cell_too_large_is_refused(qtraj, tmp_path):
    (tmp_path / "track.csv").write_text(FILES["wide_text.csv"])
    (tmp_path / "s.toml").write_text('[track]\nfile = "track.csv"\n[limits]\ncurvature = 0.1\n')
    result = qtraj("tune", tmp_path / "s.toml", "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize("name", [name for name in FILES if name.endswith(("json", "toml"))])
def test_load_refuses_what_it_cannot_take(tmp_path, name):
    (tmp_path / name).write_text(FILES[name])
    with pytest.raises(ValueError, match=name):
        qt.load(tmp_path / name)


def test_a_long_text_is_no_deep_table():
    """Neither slow nor refused: a megabyte of letters, and parts with dots in a text."""
    texts = {"note": "1." * 100, "long": "a" * LONG}
    assert untrusted.parse_toml("\n".join(f"{name} = '{text}'" for name, text in texts.items())) == texts
    with pytest.raises(ValueError, match="nested deeper than 64 levels"):
        untrusted.parse_toml("[" + ".".join("a" * 66) + "]\nb = 1")


@pytest.mark.parametrize("name", ["a.toml", "a.csv"])
def test_a_file_over_the_limit_is_not_read(tmp_path, monkeypatch, name):
    monkeypatch.setattr(untrusted, "MAX_SIZE", 10)
    (tmp_path / name).write_text("x" * 11)
    with pytest.raises(ValueError, match="larger than"):
        qt.load(tmp_path / name) if name.endswith("toml") else qt.read_track(tmp_path / name)


def test_bytes_changed_at_random_end_in_an_explained_error(tmp_path):
    file = tmp_path / "path.toml"
    qt.SpiralHelix([20.0, 1.0], [0.2, 0.35], [1.0, 0.4], 4.5).save(file)
    content, random = file.read_bytes(), np.random.default_rng(5)
    loaded = 0
    for _ in range(300):
        changed = bytearray(content)
        for place in random.integers(0, len(content), random.integers(1, 6)):
            changed[place] = random.integers(0, 256)
        file.write_bytes(changed)
        with contextlib.suppress(ValueError):
            qt.load(file)
            loaded += 1
    assert loaded < 200
