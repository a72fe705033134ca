"""Create the output that commands have in common: the first keys of the JSON, and files of tables and figures."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from qtraj._version import __version__
from qtraj.foundation.folder import Writer, check_folder, write_all
from qtraj.foundation.plain import plain
from qtraj.foundation.record import Record
from qtraj.scenario.reader import ScenarioFile

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

__all__ = ["check_folder", "header", "provenance", "result_writers", "table_writers", "tabular", "write_all"]


def header(command: str, loaded: ScenarioFile[Any]) -> dict[str, Any]:
    """Return the first keys of a command's JSON output: the version, the command and the scenario.

    For a scenario with a recording, the keys include the source of the recording.
    """
    scenario = loaded.scenario
    about = {name: getattr(scenario, name, None) for name in ("name", "description")}
    about["source"] = getattr(getattr(scenario, "track", None), "source", None)
    facts = {"file": str(loaded.file), "sha256": loaded.hash} | {k: v and v.strip() for k, v in about.items()}
    return {"qtraj": __version__, "command": command, "scenario": facts}


def provenance(loaded: ScenarioFile[Any]) -> dict[str, str]:
    """Return the attributes of a dataset that describe its origin."""
    about = header("", loaded)["scenario"]
    facts = {"title": about["name"], "recording": about["source"], "scenario_sha256": about["sha256"]}
    return {name: text for name, text in facts.items() if text} | {"scenario_file": loaded.file.name}


def tabular(record: Record) -> dict[str, Any]:
    """Return the `units` and the `columns` of a record over instants, with the names of the quantities as keys."""
    columns = plain(record)
    return {"units": columns.pop("units"), "columns": {name: columns[name] for name in record.everything()}}


def result_writers(dataset: "xarray.Dataset", figure: "Figure", name: str) -> dict[str, Writer]:
    """Return writers of a dataset over instants (table.nc, table.csv), and of the figure (`name`.png, `name`.svg)."""
    from qtraj.io.instants_csv import csv_headers
    from qtraj.viz.figures import save

    files = (f"{name}.png", f"{name}.svg")
    return table_writers(dataset, csv_headers(dataset)) | {file: partial(save, figure) for file in files}


def table_writers(dataset: "xarray.Dataset", headers: Mapping[str, Sequence[str]]) -> dict[str, Writer]:
    """Return writers of table.nc, with the whole dataset, and of table.csv, with the columns named in `headers`."""
    from qtraj.io.dataset import write_netcdf
    from qtraj.io.instants_csv import write_csv

    columns = {column: dataset[column].values for column in headers}
    return {"table.nc": partial(write_netcdf, dataset), "table.csv": partial(write_csv, columns, headers)}
