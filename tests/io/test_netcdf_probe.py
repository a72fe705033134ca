"""netCDF files are read by a child process first: what runs in it, what it refuses, and what is said if it fails."""

import os
import subprocess
import sys

import numpy as np
import pytest
import xarray

import qtraj as qt
from qtraj.io import netcdf
from qtraj.io.damaged import reading

SPARSE_LENGTH = 5 * 10**6  # 40 MB of float64, in a file of a few kB


@pytest.fixture
def file(tmp_path):
    """A small netCDF file."""
    path = qt.SpiralHelix([20.0], [0.0, 0.3], [0.0, 0.5], 10.0)
    qt.save_dataset(qt.evaluate(path, np.linspace(0.0, 10.0, 5)), tmp_path / "table.nc")
    return tmp_path / "table.nc"


def test_modules_in_the_current_folder_are_not_imported(file, monkeypatch):
    """Neither a module of the standard library nor qtraj itself is taken from there, also with an empty PYTHONPATH."""
    for name in ("json", "qtraj", "h5netcdf"):
        (file.parent / f"{name}.py").write_text("raise SystemExit('a module of the current folder was imported')")
    monkeypatch.chdir(file.parent)
    monkeypatch.setenv("PYTHONPATH", os.pathsep)
    assert qt.load_dataset(file).sizes["time"] == 5


def test_the_folder_of_qtraj_comes_after_those_of_the_user(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", "/one")
    assert netcdf._search_path()["PYTHONPATH"].split(os.pathsep)[0] == "/one"


def test_a_sparse_file_is_read(tmp_path):
    """Chunks that were never written take no space."""
    import h5netcdf

    with h5netcdf.File(tmp_path / "sparse.nc", "w") as content:
        content.dimensions = {"time": SPARSE_LENGTH}
        content.create_variable("x", ("time",), "f8", chunks=(10**6,), fillvalue=1.5)
    assert os.path.getsize(tmp_path / "sparse.nc") * 1032 < 8 * SPARSE_LENGTH
    assert netcdf.read_netcdf(tmp_path / "sparse.nc")["x"].size == SPARSE_LENGTH


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "was killed, perhaps because the memory"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGABRT)", "the HDF5 library crashed with SIGABRT"),
        ("import no_such_package", "the process for this failed .*No module named 'no_such_package'"),
        ("import sys; sys.stdout.write('truncated'); sys.exit(1)", r"not a netCDF-4 file \(truncated\)"),
    ],
)
def test_what_happened_to_the_child_process_is_said(file, monkeypatch, code, message):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True)
    monkeypatch.setattr(netcdf.subprocess, "run", lambda *_, **__: done)
    with pytest.raises(ValueError, match=message) as raised:
        qt.load_dataset(file)
    assert str(raised.value).startswith(f"{file}: ")


def test_a_file_that_may_not_be_read_is_not_called_damaged(file, monkeypatch):
    """Tests may run as root, who may read all files, so the permission is refused by a replacement."""

    def refused(self, *_):
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(netcdf.Path, "open", refused)
    with pytest.raises(PermissionError, match="Permission denied"):
        netcdf.read_netcdf(file)


def test_exhausted_memory_is_not_a_fault_of_the_file(file):
    """The child process reports it on stderr, so that the message does not call the file damaged."""
    code = (
        "import runpy, sys, h5netcdf\n"
        "def exhausted(*_): raise MemoryError('Unable to allocate 9 GiB')\n"
        f"h5netcdf.File, sys.argv = exhausted, ['probe', {str(file)!r}]\n"
        "runpy.run_module('qtraj.io.netcdf_probe', run_name='__main__')\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True)
    message = netcdf._failure(done)
    assert message.endswith("because the process for this failed (Unable to allocate 9 GiB)")


def test_a_slow_child_process_is_not_called_damaged(file, monkeypatch):
    monkeypatch.setattr(netcdf, "SECONDS", 0.01)
    with pytest.raises(ValueError, match="did not end within 0 s: the file is damaged, or the disk or the computer"):
        qt.load_dataset(file)


@pytest.mark.parametrize("error", [MemoryError(), PermissionError(13, "Permission denied"), OSError(5, "I/O error")])
def test_errors_of_the_system_are_not_called_damage(tmp_path, error):
    with pytest.raises(type(error)), reading(tmp_path, "a dataset"):
        raise error


def test_an_error_of_a_library_without_a_number_is_damage(tmp_path):
    with pytest.raises(ValueError, match=r"not a dataset \(file signature\)"), reading(tmp_path, "a dataset"):
        raise OSError("file signature")


def test_a_dataset_of_another_program_is_still_read(tmp_path):
    """Compressed zeros are much smaller than their content."""
    values = xarray.Dataset({"x": ("time", np.zeros(10**6))})
    values.to_netcdf(tmp_path / "zeros.nc", engine="h5netcdf", encoding={"x": {"zlib": True, "complevel": 9}})
    assert netcdf.read_netcdf(tmp_path / "zeros.nc")["x"].size == 10**6
