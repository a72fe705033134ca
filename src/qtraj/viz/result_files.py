"""Write results to a folder: datasets, tables, saved objects, figures and reports (extras `io` and `viz`).

Each function returns writers by file name, for `qtraj.foundation.folder.write_all`, which writes all files or none.
"""

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray

from qtraj.foundation import document
from qtraj.foundation.folder import Writer

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REPORT = "report.html"
"""The file name of the report in a folder of results; the report shows the main dataset of the folder."""

DATASETS = ("paths.nc", "table.nc")
"""The file names of the datasets that a report of a folder shows."""


def documents(objects: Mapping[str, Any]) -> dict[str, Writer]:
    """Return writers of objects by file name, as files that `qtraj.load` reads; None is omitted."""
    return {name: partial(document.save, thing) for name, thing in objects.items() if thing is not None}


def netcdf(name: str, dataset: xarray.Dataset) -> dict[str, Writer]:
    """Return the writer of a dataset as netCDF."""
    from qtraj.io.netcdf import write_netcdf

    return {name: partial(write_netcdf, dataset)}


def table(
    dataset: xarray.Dataset, name: str = "table", headers: Mapping[str, Sequence[str]] | None = None
) -> dict[str, Writer]:
    """Return writers of a dataset as netCDF and of its variables over `time` as CSV.

    `headers` are the columns of the CSV file; by default, each component of each variable over `time` is a column.
    """
    from qtraj.io.instants_csv import csv_headers, write_csv

    over_time = dataset[[variable for variable, x in dataset.data_vars.items() if x.dims[:1] == ("time",)]]
    headers = csv_headers(over_time) if headers is None else headers
    columns = {column: dataset[column].values for column in headers}
    return netcdf(f"{name}.nc", dataset) | {f"{name}.csv": partial(write_csv, columns, headers)}


def figure(name: str, drawn: "Figure") -> dict[str, Writer]:
    """Return writers of a figure as PNG and SVG."""
    from qtraj.viz.style import save

    return {f"{name}.{suffix}": partial(save, drawn) for suffix in ("png", "svg")}


def report(dataset: xarray.Dataset) -> dict[str, Writer]:
    """Return the writer of the HTML report on a dataset of paths or attitudes.

    The writer raises ModuleNotFoundError if plotly is missing.
    """

    def write(file: Path) -> None:
        from qtraj.viz.report.page import report_page

        file.write_text(report_page(dataset), encoding="utf-8", newline="\n")

    return {REPORT: write}


def obsolete_files(folder: Path, writers: Mapping[str, Writer], optional: Iterable[str] = ()) -> list[Path]:
    """Return the files of an earlier run in a folder that would not match the files that `writers` will write.

    If a dataset of an earlier run will be replaced, these are the files named in `optional` and the report of the
    folder, otherwise none. Files that `writers` will write, folders and links are omitted.
    """
    if not any(name in writers and (folder / name).is_file() for name in DATASETS):
        return []
    files = [folder / name for name in (*optional, REPORT) if name not in writers]
    return [file for file in files if file.is_file() and not file.is_symlink()]
