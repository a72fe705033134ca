"""The files of a result, written together into a folder."""

import numpy as np
import xarray
from matplotlib.figure import Figure

import qtraj as qt
from qtraj.foundation.folder import write_all
from qtraj.io.saved import saved_hodograph
from qtraj.motion.programs.slew_history import fine_times
from qtraj.viz import command_files, result_files

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


def test_a_slew_has_the_files_of_the_command(tmp_path):
    program = qt.EulerTurn([1.0, 0.0, 0.0, 0.0], [0.6, 0.0, 0.0, 0.8], qt.TimeOptimal(0.2, 0.1))
    table, drawn = (qt.slew_history(program, times, 2.0) for times in ([0.0, 1.0, 2.0], fine_times(program)))
    writers = command_files.slew_files(program, table, drawn, {"max_rate": 0.2}, 0.5, {"title": "A slew"})
    write_all(tmp_path, writers)
    assert list(writers) == ["program.toml", "table.nc", "table.csv", "slew.png", "slew.svg"]
    dataset = xarray.load_dataset(tmp_path / "table.nc")
    assert (dataset["angle_rate"].attrs["limit"], dataset["torque"].attrs["limit"]) == (0.2, 0.5)
    assert dataset.attrs["title"] == "A slew"


def test_a_loop_has_the_files_of_the_command(tmp_path):
    program = qt.EulerTurn([1.0, 0.0, 0.0, 0.0], [0.6, 0.0, 0.0, 0.8], qt.TimeOptimal(0.2, 0.1))
    actuator, times = qt.Actuator(0.5), np.linspace(0.0, 12.0, 5)
    start = np.array([0.995, 0.0, 0.0998, 0.0])
    history, verdict = qt.assess_loop(
        program, qt.AccelerationLaw(2.0, 1.0), start, np.zeros(4), times, actuator=actuator
    )
    writers = command_files.loop_files(history.at(times), verdict, actuator)
    write_all(tmp_path, writers)
    assert list(writers) == ["solution.toml", "table.nc", "table.csv", "simulation.png", "simulation.svg"]
    dataset = xarray.load_dataset(tmp_path / "table.nc")
    assert dataset["command"].attrs["limit"] == 0.5
    assert (dataset.attrs["closed_form"], dataset.attrs["saturation"]) == ("applies", "norm")
