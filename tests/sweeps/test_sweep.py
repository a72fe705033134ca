"""Sweeps in this process: stores, failures, resumption, and stores of other sweeps."""

import errno
import filecmp
import json
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
import xarray

import qtraj as qt
from qtraj.sweeps import Column, Normal, Uniform, store
from qtraj.sweeps.lock import locked

GRID = {"a": np.linspace(0.0, 2.0, 9), "n": [1, 2, 3]}


def outputs(p):
    return {
        "sum": p["a"] + p["n"],
        "powers": np.array([p["a"], p["a"] ** 2]),
        "above": p["a"] > 1.0,
        "n_squared": p["n"] ** 2,
    }


def of_batch(p):
    return {
        "sum": p["a"] + p["n"],
        "powers": np.stack([p["a"], p["a"] ** 2], 1),
        "above": p["a"] > 1,
        "n_squared": p["n"] ** 2,
    }


def sweep(function, parameters, out, **options):
    return qt.sweep(function, parameters, out, **{"workers": 0, "shard": 4, **options})


def same(first, second):
    """Whether two folders contain the same files with the same bytes."""
    files = [sorted(f.relative_to(x) for x in [Path(y)] for f in x.rglob("*") if f.is_file()) for y in (first, second)]
    return files[0] == files[1] and all(filecmp.cmp(first / f, second / f, shallow=False) for f in files[0])


@pytest.mark.parametrize("batch", [False, True])
def test_the_store_is_a_dataset_with_units(tmp_path, batch):
    swept = sweep(of_batch if batch else outputs, GRID, tmp_path, batch=batch, units={"a": "m", "sum": "m s-1"})
    assert swept.successful
    assert swept.result == "27 of 27 points were computed, of which 0 failed."
    for dataset in (swept.to_xarray(), xarray.open_zarr(tmp_path, chunks=None)):
        a, n = (x.ravel() for x in np.meshgrid(GRID["a"], GRID["n"], indexing="ij"))
        assert set(dataset.coords) == {"a", "n"}
        np.testing.assert_array_equal(dataset["a"], a)
        np.testing.assert_array_equal(dataset["n"], n)
        np.testing.assert_array_equal(dataset["sum"], a + n)
        np.testing.assert_array_equal(dataset["powers"], np.stack([a, a**2], 1))
        np.testing.assert_array_equal(dataset["above"], a > 1)
        assert [dataset[x].dtype.kind for x in ("sum", "above", "n_squared", "status")] == ["f", "b", "i", "i"]
        assert dataset["sum"].attrs["units"] == "m s-1"
        assert dataset["a"].attrs["units"] == "m"
        assert dataset.attrs["source"].startswith("qtraj ")
        assert dataset["status"].attrs["flag_meanings"].split()[0] == "successful"
    assert swept.to_xarray(grid=True)["sum"].sel(a=2.0, n=3).item() == 5.0
    assert swept.parameters(26) == {"a": 2.0, "n": 3}


def test_points_that_fail_have_a_status_and_nan(tmp_path):
    def fails(p):
        if p["a"] == 1.0:
            raise ZeroDivisionError("no radius")
        return {"y": np.nan if p["a"] == 1.5 else p["a"], "k": 7, "failed": p["a"] == 0.5}

    swept = sweep(fails, {"a": [0.0, 0.5, 1.0, 1.5, 2.0]}, tmp_path)
    assert swept.successful
    assert swept.count_failed == 3
    assert swept.failed["a"].tolist() == [0.5, 1.0, 1.5]
    assert swept.failed["point"].tolist() == [1, 2, 3]
    assert swept.failed["status"].tolist() == ["failed", "raised_an_error", "not_a_number"]
    assert swept.failed["text"].tolist() == ["", "ZeroDivisionError: no radius", ""]
    np.testing.assert_array_equal(swept.to_xarray()["y"], [0.0, np.nan, np.nan, np.nan, 2.0])
    assert swept.to_xarray()["k"].values.tolist() == [7, 7, -1, 7, 7]
    assert swept.summary["y"].successes == 2
    assert swept.summary["y"].maximum.item() == 2.0


def test_summaries_are_those_of_numpy(tmp_path):
    def two(p):
        return {"y": np.stack([p["x"], -p["x"]], 1), "z": p["x"] ** 2, "low": p["x"] < 0}

    parameters = {"x": Normal(0.5, 2.0)}
    options = {"samples": 5000, "batch": True, "shard": 700, "histograms": {"z": (0.0, 30.0, 3000), "y": (-9, 9)}}
    swept = sweep(two, parameters, tmp_path / "all", **options)
    without = sweep(two, parameters, tmp_path / "none", keep=False, **options)
    x = swept.to_xarray()["x"].values
    summary = without.summary
    assert set(without.to_xarray()) == {"status"}
    np.testing.assert_allclose(summary["y"].mean, [x.mean(), -x.mean()], atol=1e-12)
    np.testing.assert_array_equal(summary["y"].minimum, [x.min(), -x.max()])
    np.testing.assert_array_equal(summary["y"].maximum_point, [x.argmax(), x.argmin()])
    assert summary["low"].mean == pytest.approx((x < 0).mean(), abs=1e-14)
    assert without.parameters(summary["y"].maximum_point[0])["x"] == x.max()
    for share in (0.05, 0.5, 0.99):
        assert summary["z"].quantile(share) == pytest.approx(np.quantile(x**2, share), abs=0.03)
    np.testing.assert_allclose(summary["y"].quantile(0.25)[1], np.quantile(-x, 0.25), atol=0.04)
    assert json.dumps({k: v.mean.tolist() for k, v in summary.items()}) == json.dumps(
        {k: v.mean.tolist() for k, v in swept.summary.items()}
    )
    with pytest.raises(ValueError, match="quantiles need a histogram"):
        summary["low"].quantile(0.5)
    with pytest.raises(ValueError, match="a share from 0 to 1"):
        summary["z"].quantile(2.0)


def test_quantiles_outside_the_histogram_are_unknown(tmp_path):
    swept = sweep(lambda p: {"y": p["a"]}, {"a": [-5.0, 0.25, 0.45, 9.0]}, tmp_path, histograms={"y": (0.0, 1.0, 10)})
    y = swept.summary["y"]
    assert y.histogram.sum() == 4
    assert np.isnan(y.quantile(0.1))
    assert np.isnan(y.quantile(1.0))
    assert y.quantile(0.5) == pytest.approx(0.3)


class Counted:
    """A function that counts its points and raises an error once a file exists."""

    def __init__(self, folder):
        self.folder = folder

    def __call__(self, p):
        with (self.folder / "count").open("a") as file:
            file.write(f"{p['a']}\n")
        if (self.folder / "stop").exists() and p["a"] >= 1.0:
            raise KeyboardInterrupt
        return {"y": p["a"]}


def counts(folder):
    return (folder / "count").read_text().split()


def test_an_interrupted_sweep_is_completed_and_nothing_is_computed_twice(tmp_path):
    parameters, function = {"a": np.linspace(0.0, 2.0, 40)}, Counted(tmp_path)
    whole = sweep(lambda p: {"y": p["a"]}, parameters, tmp_path / "whole")
    (tmp_path / "stop").touch()
    with pytest.raises(KeyboardInterrupt):
        sweep(function, parameters, tmp_path / "out")
    (tmp_path / "stop").unlink()
    first = counts(tmp_path)
    assert 0 < len(first) < 40
    swept = sweep(function, parameters, tmp_path / "out")
    assert swept.successful
    again = counts(tmp_path)[len(first) :]
    assert again == [str(a) for a in parameters["a"][20:]]  # all shards before the one that was interrupted
    sweep(function, parameters, tmp_path / "out")
    assert len(counts(tmp_path)) == len(first) + len(again)
    np.testing.assert_array_equal(swept.to_xarray()["y"], whole.to_xarray()["y"])


def test_lost_and_damaged_shards_are_computed_again(tmp_path):
    sweep(outputs, GRID, tmp_path / "whole")
    shutil.copytree(tmp_path / "whole", tmp_path / "damaged")
    damaged = tmp_path / "damaged"
    (damaged / "sum/c/1").unlink()
    (damaged / "powers/c/3/0").write_bytes(b"\0" * (damaged / "powers/c/3/0").stat().st_size)
    (damaged / ".sweep/ledger/0/4").write_bytes(b"")  # as after a power failure
    (damaged / ".sweep/ledger/0/5").unlink()
    (damaged / ".sweep/staging/unfinished").write_bytes(b"x")
    assert not same(tmp_path / "whole", damaged)
    assert sweep(outputs, GRID, damaged).successful
    assert same(tmp_path / "whole", damaged)


def test_the_same_sweep_writes_the_same_bytes(tmp_path):
    parameters = {"a": Uniform(0.0, 2.0), "n": [1, 2]}
    for name in ("one", "two"):
        sweep(outputs, parameters, tmp_path / name, samples=13, design="latin")
    assert same(tmp_path / "one", tmp_path / "two")


FACTOR = 2.0


def scaled(p):
    return {"y": FACTOR * p["a"]}


OTHERS = [
    ({"seed": 1}, "the seed differs \\(0 there, 1 now\\)"),
    ({"parameters": {"a": Uniform(0, 3)}}, "the parameter 'a' differs"),
    ({"parameters": {"b": Uniform(0, 2)}}, "the order of the parameters differs \\(a there, b now\\)"),
    ({"samples": 5}, "the number of samples differs"),
    ({"design": "sobol"}, "the design of the samples differs"),
    ({"shard": 3}, "the number of points of a shard differs \\(4 there, 3 now\\)"),
    ({"keep": False}, "the argument 'keep' differs"),
    ({"units": {"y": "m"}}, "the argument 'units' differs"),
    ({"function": outputs}, "the name of the function differs"),
]


@pytest.mark.parametrize(("change", "message"), OTHERS)
def test_a_store_of_another_sweep_is_refused_by_name(tmp_path, change, message):
    given = {"function": scaled, "parameters": {"a": Uniform(0, 2)}, "samples": 6}
    sweep(out=tmp_path, **given)
    before = (tmp_path / "y/c/0").read_bytes()
    with pytest.raises(ValueError, match=f"this folder contains another sweep, because {message}"):
        sweep(out=tmp_path, **given | change)
    assert (tmp_path / "y/c/0").read_bytes() == before


def test_a_changed_constant_is_another_function(tmp_path, monkeypatch):
    sweep(scaled, {"a": [1.0]}, tmp_path)
    sweep(scaled, {"a": [1.0]}, tmp_path)
    monkeypatch.setattr(sys.modules[__name__], "FACTOR", 3.0)
    with pytest.raises(ValueError, match="because the function differs"):
        sweep(scaled, {"a": [1.0]}, tmp_path)


@pytest.mark.parametrize("version", ["qtraj", "Python", "JAX", "NumPy"])
def test_other_versions_are_refused(tmp_path, version):
    sweep(scaled, {"a": [1.0]}, tmp_path)
    file = tmp_path / ".sweep/identity.json"
    own = json.loads(file.read_text())
    own[f"the version of {version}"] = "0.0.1"
    file.write_text(json.dumps(own))
    with pytest.raises(ValueError, match=rf"the version of {version} differs \(0\.0\.1 there"):
        sweep(scaled, {"a": [1.0]}, tmp_path)


def late(value):
    return lambda p: value if p["a"] > 1.0 else {"y": 1.0}


WRONG = [
    ({"z": 1.0}, "the function returned 'z', which it did not return for the first points"),
    ({}, "must return a dictionary"),
    ({"y": 1.0, "z": 2.0}, "the function returned 'z'"),
    ({"y": np.zeros(2)}, r"the output 'y' has the shape \(2,\), but \(\) was expected"),
    ({"y": "fast"}, "the output 'y' must be a number"),
    ({"y": 1j}, "the output 'y' must be a number"),
    (3.0, "must return a dictionary"),
    ({"y": 1.0, "failed": 2.0}, "the output 'failed' must be"),
]


@pytest.mark.parametrize(("value", "message"), WRONG)
def test_other_outputs_at_one_point_are_an_error_and_the_rest_is_kept(tmp_path, value, message):
    parameters = {"a": [0.0, 0.1, 0.2, 0.3, 2.0, 0.4, 0.5, 0.6, 0.7]}
    with pytest.raises(ValueError, match=rf"{message}.*the parameters of this point are a = 2"):
        sweep(late(value), parameters, tmp_path)
    status = xarray.open_zarr(tmp_path, chunks=None)["y"].values
    np.testing.assert_array_equal(status, [1, 1, 1, 1, np.nan, np.nan, np.nan, np.nan, 1])


def test_an_error_at_all_points_is_an_error_of_the_function(tmp_path):
    def wrong(p):
        return {"y": p["b"]}

    with pytest.raises(ValueError, match=r"at all of the first points; at the first, {'a': 1.0}, it is KeyError: 'b'"):
        sweep(wrong, {"a": [1.0, 2.0]}, tmp_path)


def test_shards_that_raise_are_tried_again_and_reported(tmp_path):
    def fragile(p):
        with (tmp_path / "calls").open("a") as file:
            file.write("x")
        if len(p["a"]) > 1 and p["a"][0] == 4.0:
            raise RuntimeError("singular")
        return {"y": p["a"]}

    swept = sweep(fragile, {"a": np.arange(10.0)}, tmp_path / "out", batch=True, retries=1)
    assert not swept.successful
    assert swept.done == 6
    [error] = swept.errors
    assert (error.first, error.stop, error.parameters) == (4, 8, {"a": 4.0})
    assert "points 4 to 7 (from a = 4): RuntimeError: singular" in swept.result
    assert len((tmp_path / "calls").read_text()) == 1 + 3 + 1  # the first point, three shards, one retry


def test_a_full_disk_is_an_error_and_the_next_run_completes(tmp_path, monkeypatch):
    write, written = store.write_whole, []

    def fills(file, *arguments, **options):
        written.append(file)
        if len(written) > 30:
            raise OSError(errno.ENOSPC, "No space left on device", str(file))
        write(file, *arguments, **options)

    sweep(outputs, GRID, tmp_path / "whole")
    monkeypatch.setattr(store, "write_whole", fills)
    with pytest.raises(OSError, match="No space left on device: all finished shards are in the store"):
        sweep(outputs, GRID, tmp_path / "out")
    monkeypatch.undo()
    assert sweep(outputs, GRID, tmp_path / "out").successful
    assert same(tmp_path / "whole", tmp_path / "out")


def test_a_second_client_is_refused(tmp_path):
    sweep(scaled, {"a": [1.0]}, tmp_path)
    with (
        locked(tmp_path / ".sweep/lock"),
        pytest.raises(ValueError, match="another process is computing this sweep"),
    ):
        sweep(scaled, {"a": [1.0]}, tmp_path)
    assert sweep(scaled, {"a": [1.0]}, tmp_path).successful


def test_the_lock_of_a_killed_process_does_not_block(tmp_path):
    code = f"""
import os, signal
from pathlib import Path
from qtraj.sweeps.lock import locked
with locked(Path({str(tmp_path / "lock")!r})):
    os.kill(os.getpid(), signal.SIGKILL)
"""
    assert subprocess.run([sys.executable, "-c", code], timeout=120, check=False).returncode == -9
    with locked(tmp_path / "lock"):
        pass


ARGUMENTS = [
    ({"function": 3}, "function must be callable"),
    ({"out": None}, "out must be the name of a folder"),
    ({"shard": 0}, "shard must be a whole number, at least 1"),
    ({"retries": -1}, "retries must be a whole number"),
    ({"workers": 1.5}, "workers must be a whole number"),
    ({"client": object(), "workers": 2}, "client and workers were both given"),
    ({"histograms": {"y": (1.0, 0.0)}}, "the histogram of 'y' must be"),
    ({"histograms": {"z": (0.0, 1.0)}}, "the histogram of 'z' is unknown; did you mean|the known outputs are y"),
    ({"parameters": {"a": np.arange(3e6)}, "shard": 1}, "a store has at most 1000000"),
    ({"parameters": {"y": [1.0]}, "function": lambda p: {"y": 1.0}}, "the output 'y' has the name of a parameter"),
    ({"function": lambda p: {"status": 1.0}}, "the name 'status' is reserved: choose another name for an output"),
    ({"function": lambda p: {"zarr.json": 1.0}}, "the name 'zarr.json' is reserved"),
    ({"function": lambda p: {"y\n": 1.0}}, "the name of an output must be a string of letters"),
    ({"function": lambda p: {"Y": 1.0, "y": 1.0}}, "the names 'Y' and 'y' differ only in their case"),
    ({"function": lambda p: {"A": 1.0}}, "the names 'a' and 'A' differ only in their case"),
    ({"function": lambda p: {"y" * 300: 1.0}}, "the name of an output must have at most 200 bytes"),
    ({"parameters": {"a\\..": [1.0]}}, "the name of a parameter must be a string of letters"),
    ({"function": lambda p: {"failed": True}}, "no output except 'failed'"),
]


@pytest.mark.parametrize(("change", "message"), ARGUMENTS)
def test_faults(tmp_path, change, message):
    given = {"function": scaled, "parameters": {"a": [1.0]}, "out": tmp_path / "out", **change}
    with pytest.raises(ValueError, match=message):
        sweep(**given)


def test_a_folder_with_other_files_is_refused_and_unchanged(tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(ValueError, match="this folder contains other files"):
        sweep(scaled, {"a": [1.0]}, tmp_path)
    assert [x.name for x in tmp_path.iterdir()] == ["thesis.txt"]
    with pytest.raises(ValueError, match="a folder for the store was expected, but this is a file"):
        sweep(scaled, {"a": [1.0]}, tmp_path / "thesis.txt")


def test_progress(tmp_path):
    reports = []
    sweep(scaled, {"a": np.arange(8.0)}, tmp_path, progress=reports.append)
    assert reports[0].total == 8
    assert "per second" in reports[0].text


def test_a_table_is_part_of_the_sweep(tmp_path):
    sweep(scaled, {"a": Column([1.0, 2.0])}, tmp_path)
    with pytest.raises(ValueError, match="the parameter 'a' differs"):
        sweep(scaled, {"a": Column([1.0, 3.0])}, tmp_path)


def test_importing_qtraj_does_not_import_dask():
    code = (
        "import sys, qtraj; qtraj.sweep, qtraj.sweeps.Uniform; print([m for m in ('dask', 'zarr') if m in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_a_removed_folder_leaves_no_columns(tmp_path):
    for values in ([1.0, 2.0, 3.0], [4.0, 5.0, 6.0]):
        swept = sweep(scaled, {"a": Column(values)}, tmp_path / "out")
        assert swept.to_xarray()["a"].values.tolist() == values
        shutil.rmtree(tmp_path / "out")


@dataclass
class Unnoticed:
    """A function with a number that is not part of its digest."""

    k: float = field(compare=False)

    def __call__(self, p):
        return {"y": self.k}


def test_each_run_has_its_own_plan(tmp_path):
    for k in (1.0, 7.0):
        swept = sweep(Unnoticed(k), {"a": [1.0]}, tmp_path / "out")
        assert swept.to_xarray()["y"].values.tolist() == [k]
        shutil.rmtree(tmp_path / "out")


def test_a_function_that_fails_at_once_leaves_the_folder_to_the_corrected_one(tmp_path):
    for values in ([1.0, 2.0], [3.0, 4.0, 5.0]):
        with pytest.raises(ValueError, match="raises an error at all of the first points"):
            sweep(lambda p: {"y": p["typo"]}, {"a": Column(values)}, tmp_path)
    assert sweep(scaled, {"a": Column([1.0, 2.0])}, tmp_path).to_xarray()["y"].values.tolist() == [2.0, 4.0]


def test_only_the_units_of_this_sweep_are_part_of_it(tmp_path):
    sweep(scaled, {"a": [1.0]}, tmp_path, units={"y": "m"})
    assert sweep(scaled, {"a": [1.0]}, tmp_path, units={"y": "m", "other": "s"}).successful
    sweep(outputs, GRID, tmp_path / "long", units={"a": "m" * 400})
    with pytest.raises(ValueError, match=r"the argument 'units' differs \({'a': 'm{20,100} … there, ") as caught:
        sweep(outputs, GRID, tmp_path / "long", units={"a": "s" * 400})
    assert len(str(caught.value)) < 600


def test_the_quantile_zero_is_in_the_first_bin_with_points(tmp_path):
    swept = sweep(lambda p: {"y": p["a"]}, {"a": [0.42, 0.45, 0.75]}, tmp_path, histograms={"y": (0.0, 1.0, 10)})
    assert swept.summary["y"].quantile(0) == pytest.approx(0.4)
    assert swept.summary["y"].quantile(1) == pytest.approx(0.8)


@pytest.mark.parametrize("content", [b"[]", b'"x"', b'{"the seed": 0, ', b"\xff\xfe"])
def test_a_damaged_identity_is_named(tmp_path, content):
    sweep(scaled, {"a": [1.0]}, tmp_path)
    (tmp_path / ".sweep/identity.json").write_bytes(content)
    with pytest.raises(ValueError, match=r"identity.json: this file of a sweep is damaged .*; remove the folder"):
        sweep(scaled, {"a": [1.0]}, tmp_path)


def test_damaged_and_lost_entries_are_computed_again(tmp_path):
    sweep(outputs, GRID, tmp_path / "whole")
    shutil.copytree(tmp_path / "whole", tmp_path / "damaged")
    ledger = tmp_path / "damaged/.sweep/ledger"
    entry = json.loads((ledger / "0/3").read_text())
    for changed in ({"fingerprint": entry["fingerprint"]}, entry | {"checksums": 3}, entry | {"failed": "none"}, []):
        (ledger / "0/3").write_text(json.dumps(changed))
        assert sweep(outputs, GRID, tmp_path / "damaged").successful
        assert same(tmp_path / "whole", tmp_path / "damaged")
    shutil.rmtree(ledger)
    assert sweep(outputs, GRID, tmp_path / "damaged").successful
    assert same(tmp_path / "whole", tmp_path / "damaged")


def test_files_that_a_killed_zarr_has_left_are_removed(tmp_path):
    sweep(scaled, {"a": [1.0]}, tmp_path / "whole")
    shutil.copytree(tmp_path / "whole", tmp_path / "killed")
    (tmp_path / "killed/.sweep/schema.json").unlink()
    for name in ("zarr.json.1.partial", "y/zarr.json.2.partial"):
        (tmp_path / "killed" / name).touch()
    assert sweep(scaled, {"a": [1.0]}, tmp_path / "killed").successful
    assert same(tmp_path / "whole", tmp_path / "killed")


def test_a_shard_has_at_most_all_points(tmp_path):
    sweep(scaled, {"a": [1.0, 2.0]}, tmp_path, shard=10**12)
    assert (tmp_path / "y/c/0").stat().st_size == 16
