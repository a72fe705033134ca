"""`qtraj retime` of curves without times: the centre line of a race track, GPX and GeoJSON, saved shapes, bad input."""

import json
import time

import numpy as np
import pytest
import xarray
from tests.io.test_gpx import COUNT, gpx, point, track
from tests.race_track import write_race_track

import qtraj as qt

RACE = {"speed": 60.0, "lateral_acceleration": 15.0, "longitudinal_acceleration": 8.0}
LIMITS = [text for name, value in RACE.items() for text in ("--limit", f"{name}={value}")]
MAX_CPU = 10.0
"""Seconds of CPU within which the lap of 2.3 km is read, timed, proved and written."""


@pytest.fixture(scope="module")
def race(qtraj, tmp_path_factory):
    folder = tmp_path_factory.mktemp("race")
    file, start = write_race_track(folder / "centre_line.csv"), time.process_time()
    result = qtraj("retime", file, *LIMITS, "--out", folder / "out", "--json")
    return result, json.loads(result.stdout), folder, time.process_time() - start


def test_race_track_is_timed_as_a_flying_lap(race):
    result, content, folder, seconds = race
    assert result.exit_code == 0, result.output
    assert seconds < MAX_CPU
    timed = qt.retime(qt.read_shape(folder / "centre_line.csv"), qt.Limits(**RACE))
    assert content["retimed"]["duration"] == pytest.approx(float(timed.duration))
    assert content["certificate"]["status"] == ["proved"] * 3
    start, end = content["retimed"]["end_speeds"]
    assert start == pytest.approx(end, rel=1e-9)
    assert content["shape"]["closed"] is True
    assert content["shape"]["length"] == pytest.approx(2300, abs=1)


def test_files_contain_only_the_retimed_path(race):
    _, content, folder, _ = race
    dataset = xarray.load_dataset(folder / "out" / "paths.nc")
    assert dataset["path"].values.tolist() == ["after"]
    timing = xarray.load_dataset(folder / "out" / "timing.nc")
    assert np.isnan(timing["duration"].sel(path="before"))
    assert timing["parameter"].attrs["units"] == "m"
    saved = qt.load(folder / "out" / "retimed.json")
    assert saved.of_shape
    assert float(saved.duration) == content["retimed"]["duration"]
    assert qt.certify(qt.load(folder / "out" / "path.json"), qt.Limits(**RACE)).holds


def test_text_names_the_lap_time(qtraj, tmp_path):
    file = write_race_track(tmp_path / "track.txt", count=60, length=300.0)
    result = qtraj("retime", file, *LIMITS, "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    for text in ("Shape", "closed curve of 300 m through 60 points", "lap time", "widths: w_tr_right_m, w_tr_left_m"):
        assert text in result.output
    assert "instead of" not in result.output
    standing = qtraj("retime", file, *LIMITS, "--start-speed", "0", "--out", tmp_path / "out2", "--json")
    assert json.loads(standing.stdout)["retimed"]["end_speeds"][0] == 0


def test_limit_on_the_shape_decides_the_exit_code(qtraj, tmp_path):
    file = write_race_track(tmp_path / "track.csv", count=60, length=300.0)
    good = qtraj("retime", file, *LIMITS, "--limit", "curvature=1", "--out", tmp_path / "good", "--json")
    assert good.exit_code == 0
    bad = qtraj("retime", file, *LIMITS, "--limit", "curvature=0.01", "--out", tmp_path / "bad", "--json")
    assert bad.exit_code == 1
    assert json.loads(bad.stdout)["certificate"]["status"] == ["proved", "proved", "proved", "broken"]


@pytest.mark.parametrize("kind", ["gpx", "geojson", "saved", "numbers", "columns"])
def test_other_files(qtraj, tmp_path, kind):
    x = np.linspace(0, 300, 60)
    points, options = np.stack([x, 20 * np.sin(x / 40)], axis=1), []
    file = tmp_path / f"line.{'json' if kind == 'saved' else 'geojson' if kind == 'geojson' else 'txt'}"
    if kind == "gpx":
        file = gpx(tmp_path, track([point(k, time=False) for k in range(COUNT)]))
    elif kind == "geojson":
        file.write_text(json.dumps({"type": "LineString", "coordinates": (points * 1e-5 + [9, 47]).tolist()}))
    elif kind == "saved":
        qt.Shape.through(points).save(file)
    elif kind == "numbers":
        np.savetxt(file, points)
    else:
        file = tmp_path / "line.csv"
        np.savetxt(file, 100 * points, delimiter=",", header="a,b", comments="")
        options = ["--columns", "position=a,b", "--units", "position=cm"]
    result = qtraj("retime", file, *LIMITS, *options, "--out", tmp_path / "out", "--json")
    assert result.exit_code == 0, result.output
    content = json.loads(result.stdout)
    assert content["shape"]["closed"] is False
    assert content["retimed"]["duration"] > 1
    if kind in ("saved", "numbers", "columns"):
        timed = qt.retime(qt.Shape.through(points), qt.Limits(**RACE))
        assert content["retimed"]["duration"] == pytest.approx(float(timed.duration), rel=1e-6)


@pytest.mark.parametrize(
    ("text", "arguments", "message"),
    [
        ("x,y\n0,0\n1,0\n0.5,0\n", LIMITS, "cusp"),
        ("x,y\n0,0\n1,a\n2,0\n", LIMITS, "column 'y'"),
        ("x,y\n0,0\n1,0\n2,1\n", [], "needs a limit that bounds the speed"),
        ("x,y\n0,0\n1,0\n2,1\n", ["--limit", "friction=0.9"], "needs a vehicle"),
        ("x,y\n0,0\n1,0\n2,1\n", [*LIMITS, "--duplicates", "first"], "--duplicates applies to recordings"),
        ("x,y\n0,0\n1,0\n2,1\n", [*LIMITS, "--segment", "4"], "segment=4"),
    ],
)
def test_bad_input(qtraj, tmp_path, text, arguments, message):
    file = tmp_path / "line.csv"
    file.write_text(text)
    result = qtraj("retime", file, *arguments, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert message in " ".join(result.output.split())
    assert not (tmp_path / "out").exists()


def test_points_with_times_are_still_a_recording(qtraj, tmp_path):
    t = np.arange(200) / 10
    rows = np.stack([t, 5 * t, 10 * np.sin(t / 3), 0 * t], axis=1)
    np.savetxt(tmp_path / "drive.csv", rows, delimiter=",", header="t,x,y,z", comments="")
    result = qtraj("retime", tmp_path / "drive.csv", *LIMITS, "--out", tmp_path / "out", "--json")
    content = json.loads(result.stdout)
    assert content["shape"] is None
    assert content["recording"] is not None
    np.savetxt(tmp_path / "line.csv", rows[:, 1:], delimiter=",", header="x,y,z", comments="")
    timed = qtraj("retime", tmp_path / "line.csv", *LIMITS, "--rate", "10", "--out", tmp_path / "out2", "--json")
    assert json.loads(timed.stdout)["recording"] is not None
