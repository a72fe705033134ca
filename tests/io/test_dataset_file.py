"""Datasets as files: everything is restored, floats bit by bit, and other tools read them."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pandas
import pyarrow.parquet as pq
import pytest
import xarray

import qtraj as qt
from qtraj.foundation.extras import require_package
from qtraj.io import dataset_file
from qtraj.io.dataset import path_dataset

SOURCE = Path(__file__).parents[2] / "src"
SUFFIXES = [".nc", ".zarr", ".parquet", ".csv"]
FLAT = [".parquet", ".csv"]
SMALLEST, LARGEST = 5e-324, np.finfo(float).max
AWKWARD = [0.1, -0.0, 1 / 3, SMALLEST, LARGEST, np.nan, np.inf, -np.inf, 2**53 + 1.0, np.pi]
"""Numbers that a careless writer would change."""
EXACTLY = {} if tuple(map(int, pandas.__version__.split(".")[:2])) >= (3, 1) else {"float_precision": "round_trip"}
"""The option with which pandas reads every digit; since 3.1 it is the default."""


def helix(radius, duration):
    return qt.SpiralHelix([radius, 0.01], [0.2, 0.4], [1.0, 1 / 3], duration, qt.Placement())


@pytest.fixture(scope="module")
def paths():
    """A dataset like that of `qtraj tune`: two paths of different durations, a limit, a recording."""
    track = qt.Track([5.0, 6.0, 7.0, 8.0], np.arange(12.0).reshape(4, 3) / 7)
    both = {"before, 1": helix(10.0, 20.0), 'after "#2"\n<b>': helix(20.0, 10 / 3)}
    notes = {"title": "ω², a comma, and a #", "scenario_sha256": "bc9c8deead6c1bda"}
    return path_dataset(both, qt.Limits(curvature=1 / 22.5), track, samples=9, attributes=notes)


@pytest.fixture(scope="module")
def awkward():
    """Awkward numbers, values of all types, and a variable with components first."""
    n = len(AWKWARD)
    variables = {
        "x": ("time", np.array(AWKWARD), {"units": "m s-2", "limit": 1 / 3, "count": 7, "range": [0.1, 0.2]}),
        "single": (("component", "time"), np.linspace(0, 1 / 3, 2 * n, dtype=np.float32).reshape(2, n)),
        "grid": (("time", "row", "column"), np.arange(4.0 * n).reshape(n, 2, 2) / 3),
        "grid_0_0": ("time", np.arange(n, dtype=np.int64) - 2**62),
        "good": ("time", np.arange(n) % 2 == 0),
        "beside": (("other", "component"), np.array(AWKWARD).reshape(n // 2, 2)),
        "constant": ((), np.array(0.1)),
    }
    coordinates = {"time": ("time", np.arange(n) / 10, {"units": "s"}), "component": ["w", "x"]}
    return xarray.Dataset(variables, coordinates, {"source": "test", "nothing": "", "shape": np.array([1, 2])})


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("name", ["paths", "awkward"])
def test_everything_is_restored_bit_by_bit(name, suffix, request, tmp_path):
    dataset = request.getfixturevalue(name)
    qt.save_dataset(dataset, tmp_path / f"result{suffix}")
    again = qt.load_dataset(tmp_path / f"result{suffix}")
    xarray.testing.assert_identical(again, dataset)
    for key, variable in dataset.variables.items():
        assert again[key].dims == variable.dims
        if variable.dtype.kind in "fiub":
            assert again[key].dtype == variable.dtype, key
            assert again[key].values.tobytes() == variable.values.tobytes(), key
    assert [file.name for file in tmp_path.iterdir()] == [f"result{suffix}"]


@pytest.fixture(scope="module")
def batch():
    """Three unnamed paths at common instants, as `evaluate` returns them."""
    three = [helix(radius, 10.0) for radius in (10.0, 20.0, 40.0)]
    stacked = jax.tree.map(lambda *x: jnp.stack(x), *three)
    return qt.evaluate(stacked, np.linspace(0.0, 10.0, 5), outputs=("position", "curvature")).to_xarray()


@pytest.mark.parametrize("suffix", FLAT)
def test_rows_of_unnamed_paths_have_the_number_of_the_path(batch, suffix, tmp_path):
    """Other tools can group the rows, and `load_dataset` restores the dataset."""
    file = tmp_path / f"batch{suffix}"
    qt.save_dataset(batch, file)
    table = pandas.read_parquet(file) if suffix == ".parquet" else pandas.read_csv(file, comment="#", **EXACTLY)
    assert table["path"].tolist() == [0] * 5 + [1] * 5 + [2] * 5
    for k, rows in table.groupby("path"):
        one = batch.isel(path=k)
        assert rows["time"].tolist() == one["time"].values.tolist()
        assert rows["position_x"].tolist() == one["position"].values[:, 0].tolist()
        assert rows["curvature"].tolist() == one["curvature"].values.tolist()
    xarray.testing.assert_identical(qt.load_dataset(file), batch)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_units_conventions_and_provenance_are_in_the_file(paths, suffix, tmp_path):
    qt.save_dataset(paths, tmp_path / f"a{suffix}")
    again = qt.load_dataset(tmp_path / f"a{suffix}")
    assert again["rate"].attrs["units"] == "rad s-1"
    assert again["curvature"].attrs["limit"] == 1 / 22.5
    assert again.attrs["quaternion_convention"].startswith("scalar first, Hamilton")
    assert again.attrs["scenario_sha256"] == "bc9c8deead6c1bda"
    assert again.attrs["dtype"] == "float64"
    assert again.attrs["versions"].startswith(f"qtraj {qt.__version__}, jax ")


def test_xarray_reads_netcdf_and_zarr(paths, tmp_path):
    for suffix in (".nc", ".zarr"):
        qt.save_dataset(paths, tmp_path / f"a{suffix}")
        xarray.testing.assert_identical(xarray.load_dataset(tmp_path / f"a{suffix}"), paths)


def test_pandas_reads_the_table(paths, tmp_path):
    for suffix in FLAT:
        qt.save_dataset(paths, tmp_path / f"a{suffix}")
    frames = [
        pandas.read_parquet(tmp_path / "a.parquet"),
        pandas.read_csv(tmp_path / "a.csv", comment="#", **EXACTLY),
    ]
    for frame in frames:
        assert len(frame) == 2 * 9
        for k, name in enumerate(paths["path"].values):
            own = frame[frame["path"] == name]
            assert np.array_equal(own["time"], paths["time"][k])
            assert np.array_equal(own["position_z"], paths["position"][k, :, 2])
            assert np.array_equal(own["dcm_left_y"], paths["dcm"][k, :, 1, 1])
            assert set(own["duration"]) == {float(paths["duration"][k])}
        assert frame["defined"].dtype == bool
        assert not [name for name in frame.columns if name.startswith("recorded")]


@pytest.mark.parametrize("suffix", FLAT)
def test_a_batch_of_results_has_a_column_of_their_numbers(tmp_path, suffix):
    attitudes = jax.vmap(qt.EulerTurn([1.0, 0, 0, 0], [0.0, 1.0, 0, 0], qt.Quintic(duration=2.0)))(np.linspace(0, 2, 4))
    dataset = attitudes.to_xarray()
    qt.save_dataset(dataset, tmp_path / f"a{suffix}")
    read = pandas.read_parquet if suffix == ".parquet" else lambda file: pandas.read_csv(file, comment="#")
    assert list(read(tmp_path / f"a{suffix}")["batch"]) == [0, 1, 2, 3]
    assert qt.load_dataset(tmp_path / f"a{suffix}").identical(dataset)


KILLED = """
import os, signal, sys
import qtraj as qt
paths = qt.load_dataset("a.nc")
os.replace = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
qt.save_dataset(paths, sys.argv[1])
"""


@pytest.mark.skipif(not Path("/proc/sys/kernel/random/boot_id").exists(), reason="staging folders are swept on Linux")
@pytest.mark.parametrize("suffix", [".csv", ".zarr"])
def test_saving_after_a_killed_process_leaves_only_the_file(paths, tmp_path, suffix):
    """The process is killed after writing the temporary file, before moving it."""
    qt.save_dataset(paths, tmp_path / "a.nc")
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")} | {"PYTHONPATH": str(SOURCE)}
    done = subprocess.run([sys.executable, "-c", KILLED, f"b{suffix}"], cwd=tmp_path, env=environment)
    assert done.returncode == -signal.SIGKILL
    assert list(tmp_path.glob(f".qtraj-*/b{suffix}"))
    qt.save_dataset(paths, tmp_path / f"b{suffix}")
    assert sorted(os.listdir(tmp_path)) == ["a.nc", f"b{suffix}"]
    assert qt.load_dataset(tmp_path / f"b{suffix}").identical(paths)


KILLED_IN_BETWEEN = """
import os, signal, sys
import qtraj as qt
paths = qt.load_dataset("b.zarr")
def replace(old, new, truly=os.replace):
    if str(old).endswith("b.zarr") and str(new).endswith("b.zarr") and ".replaced" not in str(new):
        os.kill(os.getpid(), signal.SIGKILL)
    truly(old, new)
os.replace = replace
qt.save_dataset(paths, "b.zarr")
"""


@pytest.mark.skipif(not Path("/proc/sys/kernel/random/boot_id").exists(), reason="staging folders are swept on Linux")
def test_a_store_whose_replacement_was_killed_is_still_loaded(paths, tmp_path):
    qt.save_dataset(paths, tmp_path / "b.zarr")
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")} | {"PYTHONPATH": str(SOURCE)}
    done = subprocess.run([sys.executable, "-c", KILLED_IN_BETWEEN], cwd=tmp_path, env=environment)
    assert done.returncode == -signal.SIGKILL
    assert not (tmp_path / "b.zarr").exists()
    assert qt.load_dataset(tmp_path / "b.zarr").identical(paths)
    assert os.listdir(tmp_path) == ["b.zarr"]


def test_pyarrow_sees_the_units(paths, tmp_path):
    qt.save_dataset(paths, tmp_path / "a.parquet")
    schema = pq.read_schema(tmp_path / "a.parquet")
    assert schema.field("rate_up").metadata[b"units"] == b"rad s-1"
    assert json.loads(schema.metadata[b"qtraj"])["attributes"]["frame_convention"].startswith("upright frame")


def test_a_saved_path_can_be_read_as_a_recording(paths, tmp_path):
    path = paths.isel(path=0, drop=True)
    qt.save_dataset(path, tmp_path / "a.csv")
    track = qt.read_track(tmp_path / "a.csv")
    assert np.array_equal(track.positions, path["position"])
    assert np.array_equal(track.velocities, path["velocity"])
    assert np.array_equal(track.attitudes, path["quaternion"])


def test_a_table_of_evaluate_can_be_saved_directly(tmp_path):
    table = qt.evaluate(helix(10.0, 2.0), np.linspace(0, 2, 5), outputs=("position", "quaternion", "defined"))
    for suffix in SUFFIXES:
        qt.save_dataset(table, tmp_path / f"a{suffix}")
        xarray.testing.assert_identical(qt.load_dataset(tmp_path / f"a{suffix}"), table.to_xarray())


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_second_save_replaces_the_first(paths, awkward, suffix, tmp_path):
    for dataset in (paths, awkward):
        qt.save_dataset(dataset, tmp_path / f"a{suffix}")
    xarray.testing.assert_identical(qt.load_dataset(tmp_path / f"a{suffix}"), awkward)
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_failure_leaves_the_existing_file(paths, suffix, tmp_path, monkeypatch):
    qt.save_dataset(paths, tmp_path / f"a{suffix}")
    write = dataset_file._WRITERS[suffix]

    def half(dataset, file):
        write(dataset, file)
        raise KeyboardInterrupt

    monkeypatch.setitem(dataset_file._WRITERS, suffix, half)
    with pytest.raises(KeyboardInterrupt):
        qt.save_dataset(paths.isel(path=[0]), tmp_path / f"a{suffix}")
    assert [file.name for file in tmp_path.iterdir()] == [f"a{suffix}"]
    xarray.testing.assert_identical(qt.load_dataset(tmp_path / f"a{suffix}"), paths)


def test_a_folder_that_is_not_a_store_is_not_replaced(paths, tmp_path):
    (tmp_path / "a.zarr").mkdir()
    (tmp_path / "a.zarr" / "mine").write_text("")
    with pytest.raises(IsADirectoryError, match="is not a Zarr store"):
        qt.save_dataset(paths, tmp_path / "a.zarr")
    assert (tmp_path / "a.zarr" / "mine").exists()


def test_wrong_names_and_files_are_reported(paths, tmp_path):
    with pytest.raises(ValueError, match=r"must end in \.nc, \.zarr, \.parquet, \.csv"):
        qt.save_dataset(paths, tmp_path / "a.mat")
    with pytest.raises(FileNotFoundError, match="there is no such file"):
        qt.load_dataset(tmp_path / "a.nc")
    for suffix, fragment in ((".nc", "not a netCDF-4"), (".parquet", "not a Parquet"), (".csv", "no dataset header")):
        file = tmp_path / f"b{suffix}"
        file.write_text("x,y\n1,2\n")
        with pytest.raises(ValueError, match=fragment) as caught:
            qt.load_dataset(file)
        assert str(file) in str(caught.value)
    (tmp_path / "b.zarr").mkdir()
    with pytest.raises(ValueError, match=r"b\.zarr: not a Zarr store"):
        qt.load_dataset(tmp_path / "b.zarr")
    pandas.DataFrame({"x": [1.0]}).to_parquet(tmp_path / "c.parquet")
    with pytest.raises(ValueError, match=r"pandas\.read_parquet reads its columns"):
        qt.load_dataset(tmp_path / "c.parquet")


@pytest.mark.parametrize(
    ("part", "change", "fragment"),
    [
        (2, lambda table: table.rstrip("\n") + ",7\n", "row 10 has"),
        (2, lambda table: table.rstrip("\n").rpartition("\n")[0] + "\n", "do not match"),
        (2, lambda table: table.replace("0.1,", "a tenth,", 1), "does not match its header"),
        (0, lambda header: header.replace("{", "{{", 1), "header cannot be read"),
    ],
)
def test_a_damaged_csv_is_reported(awkward, part, change, fragment, tmp_path):
    file = tmp_path / "a.csv"
    qt.save_dataset(awkward, file)
    parts = list(file.read_text().partition("}}\n"))
    parts[part] = change(parts[part])
    file.write_text("".join(parts))
    with pytest.raises(ValueError, match=fragment) as caught:
        qt.load_dataset(file)
    assert str(file) in str(caught.value)


def test_values_that_a_table_cannot_store_are_reported(tmp_path):
    complex_values = xarray.Dataset({"z": ("time", np.array([1j]))}, {"time": [0.0]})
    strange = xarray.Dataset({"x": ("time", [1.0], {"note": object()})}, {"time": [0.0]})
    for suffix in FLAT:
        with pytest.raises(ValueError, match="'z' has complex128 values"):
            qt.save_dataset(complex_values, tmp_path / f"a{suffix}")
        with pytest.raises(ValueError, match="an attribute of x cannot be written"):
            qt.save_dataset(strange, tmp_path / f"a{suffix}")
        with pytest.raises(ValueError, match="an empty dataset"):
            qt.save_dataset(xarray.Dataset(), tmp_path / f"a{suffix}")
    assert list(tmp_path.iterdir()) == []


def test_a_store_that_would_unpickle_is_refused(paths, tmp_path):
    qt.save_dataset(paths, tmp_path / "a.zarr")
    file = tmp_path / "a.zarr" / "speed" / ".zarray"
    about = json.loads(file.read_text())
    file.write_text(json.dumps(about | {"filters": [{"id": "pickle", "protocol": 5}]}))
    with pytest.raises(ValueError, match="pickled objects"):
        qt.load_dataset(tmp_path / "a.zarr")


def test_a_missing_package_is_named_with_its_extra(paths, tmp_path, monkeypatch):
    with pytest.raises(ModuleNotFoundError, match=r"drawing needs no_such_package: pip install 'qtraj\[viz\]'"):
        require_package("no_such_package", "drawing", "viz")
    monkeypatch.setattr(
        dataset_file, "require_package", lambda package, purpose: require_package(f"missing_{package}", purpose)
    )
    with pytest.raises(ModuleNotFoundError, match=r"saving a dataset needs missing_xarray: pip install 'qtraj\[io\]'"):
        qt.save_dataset(paths, tmp_path / "a.parquet")
