"""The files of a result, written together into a folder."""

import numpy as np
import xarray
from matplotlib.figure import Figure

import qtraj as qt
from qtraj.foundation.folder import write_all
from qtraj.io.saved import saved_hodograph
from qtraj.viz import result_files

PATH = qt.SpiralHelix([10.0], [0.0, 0.4], [0.0, 0.5], 2.0)


def test_each_function_writes_its_files(tmp_path):
    dataset = qt.evaluate(PATH, np.linspace(0.0, 2.0, 5)).to_xarray()
    writers = {
        **result_files.netcdf("paths.nc", dataset),
        **result_files.table(dataset),
        **result_files.documents({"path.json": PATH, "nothing.json": None}),
        **result_files.figure("figure", Figure()),
        **result_files.report(dataset),
    }
    written = [file.name for file in write_all(tmp_path / "out", writers)]
    expected = ["paths.nc", "table.nc", "table.csv", "path.json", "figure.png", "figure.svg", "report.html"]
    assert written == expected
    assert xarray.load_dataset(tmp_path / "out" / "table.nc").sizes["time"] == 5
    assert (tmp_path / "out" / "table.csv").read_text().startswith("time [s],")
    assert isinstance(saved_hodograph(tmp_path / "out" / "path.json"), qt.SpiralHelix)
