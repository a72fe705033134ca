"""Recordings in the formats of other programs, through the commands that read them."""

import json

import numpy as np
import pytest
from tests.io import drive, generated_formats

KINDS = ("tum", "kitti", "euroc", "gpx", "ais", "race line", "headers", "autopilot", "waypoints")

LENGTH = 1e-3
"""Relative error of the length of a route: the files contain rounded positions."""


def file_of(tmp_path, kind):
    """The first file of a kind that is read, and its options for the command line."""
    for seed in range(100):
        case = generated_formats.KINDS[kind](np.random.default_rng(seed))
        if not case.words and len(case.times) in (5, drive.COUNT):
            break
    file = tmp_path / case.name
    file.write_bytes(case.data)
    options = [text for name, value in case.options.items() for text in (f"--{name}", str(value))]
    return case, file, options


def length(case):
    """The length of the drive at the heights of the case, or of the polygon through waypoints."""
    fine = np.linspace(0, case.times[-1], 20001)
    rise = 0.05 if np.ptp(case.positions[:, 2]) > 0.1 else 0.0
    points = np.stack([8 * fine, 30 * np.sin(fine / 9), rise * fine], axis=1)
    return np.linalg.norm(np.diff(points, axis=0), axis=1).sum()


@pytest.mark.parametrize("kind", KINDS)
def test_route_reads_it(qtraj, tmp_path, kind):
    case, file, options = file_of(tmp_path, kind)
    result = qtraj("route", file, *options, "--json", "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    content = json.loads(result.stdout)
    np.testing.assert_allclose(content["fit"]["duration"], np.ptp(case.times), rtol=LENGTH)
    tolerance = 5 * LENGTH if kind == "waypoints" else LENGTH
    np.testing.assert_allclose(content["fit"]["length"], length(case), rtol=tolerance)


@pytest.mark.parametrize("kind", ["gpx", "race line", "waypoints"])
def test_retime_reads_it(qtraj, tmp_path, kind):
    case, file, options = file_of(tmp_path, kind)
    result = qtraj("retime", file, *options, "--limit", "speed=5", "--json", "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    content = json.loads(result.stdout)
    np.testing.assert_allclose(content["retimed"]["duration"], length(case) / 5, rtol=5 * LENGTH)


def test_a_centre_line_is_a_shape(qtraj, tmp_path):
    file = tmp_path / "track.csv"
    file.write_text("# x_m,y_m,w_tr_right_m,w_tr_left_m\n" + "\n".join(f"{k},{k * k},7.5,7.5" for k in range(9)))
    result = qtraj("route", file)
    assert result.exit_code == 2
    assert "is a shape, not a track" in result.stderr
    assert len(result.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.kml", b'<?xml version="1.0"?><kml><Document/></kml>'),
        ("a.xlsx", b"PK\x03\x04\xff\xfe"),
        ("a.parquet", b"PAR1\x00\x01"),
        ("a.json", b'[{"t": 1, "x": 2}]'),
        ("a.csv", "t,x,y,z,H\u00f6he\n1,2,3,4,5".encode("latin-1")),
    ],
)
def test_other_files_are_refused_with_advice(qtraj, tmp_path, name, data):
    (tmp_path / name).write_bytes(data)
    result = qtraj("route", tmp_path / name)
    assert result.exit_code == 2
    assert "export" in result.stderr or "CSV" in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert result.stderr.count(name) == 1


def test_utf_16_is_read(qtraj, tmp_path):
    rows = "\n".join(f"{t}\t{8 * t}\t{0.1 * t * t}\t0" for t in range(20))
    (tmp_path / "a.txt").write_text(f"t\tx\ty\tz\n{rows}\n", encoding="utf-16")
    (tmp_path / "a.csv").write_bytes((tmp_path / "a.txt").read_bytes())
    assert qtraj("route", tmp_path / "a.csv", "--out", tmp_path / "out").exit_code == 0
