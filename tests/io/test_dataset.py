"""Datasets of paths: complete, labelled, exact on disk, and equal to closed forms."""

import jax
import numpy as np
import pytest
import xarray
from scipy.spatial.transform import Rotation

import qtraj as qt
from qtraj.io.dataset import path_dataset
from qtraj.io.netcdf import write_netcdf
from qtraj.path.quantity import QUANTITIES

R, RATE, CLIMB, DURATION = 10.0, 0.4, 0.5, 20.0
SAMPLES = 65
ROUND_OFF = 1e-12

UNITS = {
    "position": "m",
    "velocity": "m s-1",
    "acceleration": "m s-2",
    "dcm": "1",
    "quaternion": "1",
    "gibbs": "1",
    "curvature": "m-1",
    "torsion": "m-1",
    "rate": "rad s-1",
    "angular_acceleration": "rad s-2",
    "lateral_acceleration": "m s-2",
    "slope": "1",
    "speed": "m s-1",
    "time": "s",
    "duration": "s",
    "progress": "1",
    "recorded_position": "m",
    "recorded_time": "s",
}


def helix(radius, duration):
    return qt.SpiralHelix([radius, 0.0], [0.2, RATE], [1.0, CLIMB], duration, qt.Placement())


@pytest.fixture(scope="module")
def dataset():
    paths = {"before": helix(R, DURATION), "after": helix(2 * R, DURATION / 2)}
    track = qt.Track([5.0, 6.0, 7.0, 8.0], np.arange(12.0).reshape(4, 3))
    limits = qt.Limits(curvature=0.05, acceleration=2.0)
    return path_dataset(paths, limits, track, samples=SAMPLES, attributes={"title": "helices"}, frame=qt.Natural())


def test_every_variable_has_its_unit(dataset):
    assert {name: dataset[name].attrs["units"] for name in UNITS} == UNITS
    assert all(v.attrs.get("units") and v.attrs.get("long_name") for v in dataset.data_vars.values())
    assert {q.variable for q in QUANTITIES.values() if not q.needs} <= set(dataset.data_vars)
    for name in ("quaternion_convention", "frame_convention", "rate_convention", "layout", "source"):
        assert dataset.attrs[name]
    assert dataset.attrs["title"] == "helices"


def test_each_path_has_its_own_time(dataset):
    assert dataset["time"].dims == ("path", "sample")
    for name, duration in (("before", DURATION), ("after", DURATION / 2)):
        path = dataset.sel(path=name)
        assert float(path["duration"]) == duration
        assert path["time"].values == pytest.approx(duration * dataset["progress"].values)


def test_a_helix_has_the_values_of_its_closed_form(dataset):
    path = dataset.sel(path="before")
    square = (R * RATE) ** 2 + CLIMB**2
    expected = {
        "curvature": R * RATE**2 / square,
        "torsion": CLIMB * RATE / square,
        "speed": np.sqrt(square),
        "lateral_acceleration": R * RATE**2,
        "longitudinal_acceleration": 0.0,
        "acceleration_magnitude": R * RATE**2,
        "slope": CLIMB / (R * RATE),
        "angular_rate": RATE,
        "angular_acceleration_magnitude": 0.0,
    }
    for name, value in expected.items():
        assert path[name].values == pytest.approx(np.full(SAMPLES, value), rel=ROUND_OFF, abs=ROUND_OFF)
    angle = 0.2 + RATE * path["time"].values
    assert path["position"].sel(world="x").values == pytest.approx(R * np.cos(angle))
    normal = path["dcm"].sel(body="normal").values
    assert normal == pytest.approx(np.stack([-np.cos(angle), -np.sin(angle), 0 * angle], axis=1), abs=ROUND_OFF)


def test_attitudes_agree_and_the_quaternion_is_continuous(dataset):
    for name in dataset["path"].values:
        path = dataset.sel(path=name)
        q = path["quaternion"].values
        assert np.all(np.sum(q[1:] * q[:-1], axis=1) > 0)
        assert q.min() < -0.5  # the helix rotates far enough for the sign to matter
        world = Rotation.from_quat(q, scalar_first=True).as_matrix()
        assert np.swapaxes(path["dcm"].values, 1, 2) == pytest.approx(world, abs=ROUND_OFF)
        assert path["gibbs"].values == pytest.approx(q[:, 1:] / q[:, :1], rel=1e-9)


def test_limits_and_recording_are_kept(dataset):
    assert dataset["curvature"].attrs["limit"] == 0.05
    assert dataset["acceleration_magnitude"].attrs["limit"] == 2.0
    assert {name for name in dataset.data_vars if "limit" in dataset[name].attrs} == {
        "curvature",
        "acceleration_magnitude",
    }
    assert dataset["recorded_time"].values.tolist() == [0, 1, 2, 3]
    assert np.array_equal(dataset["recorded_position"].values.ravel(), np.arange(12.0))


def test_a_file_restores_the_dataset(dataset, tmp_path):
    write_netcdf(dataset, tmp_path / "paths.nc")
    with xarray.open_dataset(tmp_path / "paths.nc") as again:
        xarray.testing.assert_identical(again.load(), dataset)
        for name in dataset.variables:
            assert again[name].values.tobytes() == dataset[name].values.tobytes() or dataset[name].dtype.kind in "UOT"


def test_the_numbers_are_those_of_the_library(dataset):
    path = helix(R, DURATION)
    times = dataset.sel(path="before")["time"].values
    rates = jax.jit(jax.vmap(lambda t: qt.trihedral(path, t).rate))(times)
    assert np.max(np.abs(rates - dataset.sel(path="before")["rate"].values)) < ROUND_OFF


def test_missing_paths_and_samples_are_refused():
    with pytest.raises(ValueError, match="expected at least one path"):
        path_dataset({})
    with pytest.raises(ValueError, match="at least 2 samples"):
        path_dataset({"a": helix(R, DURATION)}, samples=1)
