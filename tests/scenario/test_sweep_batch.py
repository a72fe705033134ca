"""Points of a sweep that are computed as one batch: against points that are read one by one."""

import numpy as np
import pytest

from qtraj.scenario import sweep, sweep_batch
from qtraj.scenario.sweep import read_sweep
from qtraj.sweeps.results import NoValidPointError

TURN = """
duration = 4.0
[start]
position = [12.0, 0.0, 0.0]
velocity = [0.0, 5.0, 0.0]
[end]
position = [0.0, 12.0, 0.0]
velocity = [-5.0, 0.0, 0.0]
[limits]
curvature = 0.15
lateral_acceleration = 2.5
[tune]
motion = "hermite"
starts = 1
"""
VEHICLE = "[vehicle]\nmass = 9000.0\n"
COUNT = 9


@pytest.fixture
def function(tmp_path):
    """Return the function of a sweep over parameters with these names."""

    def made(names, run="evaluate", text=TURN, more=""):
        file = tmp_path / "scenario.toml"
        swept = "".join(f"{name} = {{values = [5.0]}}\n" for name in names)
        file.write_text(f'{text}[sweep]\nrun = "{run}"\n{more}{swept}')
        return read_sweep(file).function

    return made


def points_of(**ranges):
    rng = np.random.default_rng(3)
    return {name.replace("__", "."): rng.uniform(*x, COUNT) for name, x in ranges.items()}


def one_by_one(function, points, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(sweep, "FEW", COUNT + 1)
        return function(points)


def compare(found, expected, rtol=1e-9):
    assert found.keys() == expected.keys()
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, rtol=rtol, atol=rtol, err_msg=name)


CASES = {
    "evaluate": points_of(start__speed=(4, 6), end__position__y=(9, 15), duration=(3, 5)),
    "certify": points_of(start__velocity__x=(-1, 1), limits__lateral_acceleration=(1.5, 4), limits__speed=(4, 8)),
    "tune": points_of(start__speed=(4.5, 5.5), limits__curvature=(0.1, 0.2), end__speed=(4, 6)),
}


@pytest.mark.parametrize("run", CASES)
def test_a_batch_has_the_outputs_of_single_points(function, monkeypatch, run):
    points = CASES[run]
    own = function(points, run)
    monkeypatch.setattr(sweep.ScenarioFunction, "_one_by_one", None)  # nothing is left to the reader
    found = own(points)
    monkeypatch.undo()
    compare(found, one_by_one(own, points, monkeypatch), 1e-6 if run == "tune" else 1e-9)


def test_vehicles_of_a_batch(function, monkeypatch):
    points = points_of(vehicle__mass=(8e3, 12e3), vehicle__drag_area=(0, 6), limits__power=(1e4, 1e5))
    own = function(points, "certify", f"{TURN.replace('[tune]', f'power = 1e5{chr(10)}[tune]')}{VEHICLE}")
    compare(own(points), one_by_one(own, points, monkeypatch))


@pytest.mark.parametrize("run", ["evaluate", "certify"])
def test_points_that_are_not_valid_and_those_without_a_path_fail(function, monkeypatch, run):
    points = points_of(limits__curvature=(0.1, 0.2), start__position__x=(10, 14))
    points["limits.curvature"][2] = -1.0
    points["start.position.x"][5] = 0.0  # on the axis
    points["limits.curvature"][7] = np.nan
    own = function(points, run)
    found = own(points)
    assert np.flatnonzero(found["failed"]).tolist() == [2, 5, 7]
    good = ~found["failed"]
    expected = one_by_one(own, points, monkeypatch)
    compare({k: x[good] for k, x in found.items()}, {k: x[good] for k, x in expected.items()})
    assert (expected["failed"] == found["failed"]).all()


def test_if_no_point_has_a_path_the_message_is_that_of_a_point(function):
    points = {"start.position.x": np.zeros(COUNT)}
    with pytest.raises(NoValidPointError, match="axis"):
        function(points)(points)


def test_angles_that_are_too_large_are_left_to_the_reader(function):
    points = {"limits.steering_angle": np.array([0.1, 4.0])}
    assert not sweep_batch.valid_rows(points).any()
    assert sweep_batch.valid_rows({"limits.steering_angle": np.array([0.1, 0.4])}).all()


@pytest.mark.parametrize("name", ["tune.starts", "turns", "limits.keep_out", "vehicle.bank", "placement.origin.x"])
def test_other_keys_are_left_to_the_reader(name):
    assert not sweep_batch.supports({name: np.zeros(3), "start.speed": np.ones(3)})


@pytest.mark.parametrize("names", [("start.speed", "start.velocity.x"), ("start.velocity.x", "start.speed")])
def test_a_speed_and_a_component_of_one_velocity_have_the_states_of_single_points(function, names):
    """A speed scales the velocity of the scenario, not that of the first point."""
    rng = np.random.default_rng(5)
    points = {name: rng.uniform(1.0, 5.0, COUNT) for name in names}
    own = function(points)
    found = own(points)
    assert not sweep_batch.supports(points)
    assert sweep_batch.supports({"start.speed": points["start.speed"], "end.velocity.x": points["start.velocity.x"]})
    for k in (0, COUNT - 1):
        alone = own({name: x[k : k + 1] for name, x in points.items()})
        compare({name: x[k : k + 1] for name, x in found.items()}, alone)
