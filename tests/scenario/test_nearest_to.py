"""Scenarios whose tuned path shall be near a saved path."""

import numpy as np
import pytest

import qtraj as qt
from qtraj.scenario.path import lay
from qtraj.scenario.reader import read_scenario
from qtraj.scenario.route import fit_recording, read_route

STATES = """
duration = 4.6
[start]
position = [20.0, 0.0, 0.0]
velocity = [1.0, 7.0, 0.3]
[end]
position = [0.0, 28.0, 1.5]
velocity = [-9.8, -1.0, 0.1]
[limits]
curvature = 0.048
"""
DRIVE = '[track]\nfile = "drive.csv"\n[limits]\nspeed = 30.0\n'
TIMES = np.arange(0.0, 12.0, 0.1)
POINTS = np.stack([8 * TIMES, 20 * np.sin(0.3 * TIMES), 0 * TIMES], axis=1)


@pytest.fixture
def folder(tmp_path):
    start, end = qt.BoundaryState([20.0, 0, 0], [1.0, 7, 0.3]), qt.BoundaryState([0.0, 28, 1.5], [-9.8, -1, 0.1])
    qt.SpiralHelix.hermite(start, end, 5.2).save(tmp_path / "path.toml")
    qt.fit_route(qt.Track(TIMES, POINTS + np.array([0.0, 0.2, 0.0]))).path.save(tmp_path / "route.json")
    rows = np.column_stack([TIMES, POINTS])
    np.savetxt(tmp_path / "drive.csv", rows, delimiter=",", header="t,x,y,z", comments="")
    return tmp_path


def scenario(folder, text):
    file = folder / "scenario.toml"
    file.write_text(text)
    return file


def test_a_path_between_states(folder):
    file = scenario(folder, STATES + '[tune]\nmotion = "hermite"\nstarts = 1\nnearest_to = "path.toml"\n')
    task = lay(read_scenario(file, "path"))
    found, plain = task.tuned(), qt.tune(task.start, task.end, task.limits, motion="hermite", duration=4.6, starts=1)
    target = qt.load(folder / "path.toml")
    expected = qt.tune(task.start, task.end, task.limits, motion="hermite", duration=4.6, starts=1, nearest_to=target)
    assert float(found.objective) == pytest.approx(float(expected.objective), rel=1e-9)
    assert abs(float(found.objective) - float(plain.objective)) > 1e-3


def test_a_recorded_drive(folder):
    task = fit_recording(read_route(scenario(folder, DRIVE + '[tune]\nnearest_to = "route.json"\n')))
    found = task.tuning(lambda *_: None)
    moved = np.asarray(found.displacement)[:, 1]
    assert moved[len(moved) // 2] == pytest.approx(0.2, abs=0.06)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ('nearest_to = "none.json"', "none.json"),
        ('nearest_to = "route.json"\nobjective = "fastest"', "belongs to objective='nearest'"),
    ],
)
def test_errors_name_the_cause(folder, table, message):
    file = scenario(folder, DRIVE + f"[tune]\n{table}\n")
    with pytest.raises((ValueError, OSError), match=message):
        fit_recording(read_route(file)).tuning(lambda *_: None)
