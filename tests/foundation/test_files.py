"""Files appear whole or not at all."""

import os

import pytest

from qtraj.foundation import files


def test_a_failed_write_leaves_nothing(tmp_path, monkeypatch):
    def broken(*_):
        raise OSError("disk full")

    monkeypatch.setattr(files.os, "replace", broken)
    with pytest.raises(OSError, match="disk full"):
        files.write_atomically(tmp_path / "x", b"content")
    assert not os.listdir(tmp_path)
