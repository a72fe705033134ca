"""What the commands put out alike: the head of their JSON, tables and figures as files, files all at once."""

import os
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from qtraj._version import __version__
from qtraj.foundation.files import move, staging, sweep
from qtraj.foundation.plain import plain
from qtraj.foundation.record import Record
from qtraj.scenario.reader import ScenarioFile

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

Writer = Callable[[Path], None]


def header(command: str, given: ScenarioFile[Any]) -> dict[str, Any]:
    """The first keys of a command's JSON: the version, the command, and which scenario it was.

    `source` is that of its recording, where it has one.
    """
    scenario = given.scenario
    source = getattr(getattr(scenario, "track", None), "source", None)
    about = {"name": scenario.name, "description": scenario.description, "source": source}
    known = {"file": str(given.file), "sha256": given.hash} | {k: v and v.strip() for k, v in about.items()}
    return {"qtraj": __version__, "command": command, "scenario": known}


def provenance(given: ScenarioFile[Any]) -> dict[str, str]:
    """Attributes of a dataset that say where it comes from."""
    about = header("", given)["scenario"]
    known = {"title": about["name"], "recording": about["source"], "scenario_sha256": about["sha256"]}
    return {name: text for name, text in known.items() if text} | {"scenario_file": given.file.name}


def tabular(record: Record) -> dict[str, Any]:
    """A record over instants as `units` and `columns`, by the names of its quantities."""
    columns = plain(record)
    return {"units": columns.pop("units"), "columns": {name: columns[name] for name in record.everything()}}


def result_writers(dataset: "xarray.Dataset", figure: "Figure", name: str) -> dict[str, Writer]:
    """A dataset over instants as table.nc and table.csv, and its figure `name` as PNG and SVG."""
    from qtraj.io.dataset import write_netcdf
    from qtraj.io.instants_csv import csv_headers, write_csv
    from qtraj.viz.figures import save

    headers = csv_headers(dataset)
    columns = {column: dataset[column].values for column in headers}
    return {
        "table.nc": lambda file: write_netcdf(dataset, file),
        "table.csv": lambda file: write_csv(columns, headers, file),
        f"{name}.png": lambda file: save(figure, file),
        f"{name}.svg": lambda file: save(figure, file),
    }


def check_folder(out: Path) -> None:
    """Raise an OSError now where `write_all` could not write later."""
    root = _existing(out)
    if not root.is_dir():
        raise NotADirectoryError(f"{root}: a folder to write into was expected, but this is a file")
    if not os.access(root, os.W_OK | os.X_OK):
        raise PermissionError(f"{root}: this folder may not be written to")


def write_all(out: Path, writers: Mapping[str, Writer]) -> list[Path]:
    """Write every file by name into the folder `out`, each of them whole.

    They are written into a hidden folder of the same file system and moved only when all are complete, so that an
    error or an interrupt while writing leaves nothing, and the next run removes what a killed one left. Files of other
    names in `out` stay as they are.

    **Raises:** OSError where something cannot be written.
    """
    check_folder(out)
    targets = [out / name for name in writers]
    if blocked := [target for target in targets if target.is_dir()]:
        raise IsADirectoryError(f"{blocked[0]}: a file is to be written here, but there is a folder of this name")
    root = _existing(out)
    if root == out.absolute():
        sweep(root.parent)  # where an earlier run staged, if `out` was not there yet
    with ExitStack() as stack:
        try:
            stage = stack.enter_context(staging(root))
        except OSError as error:
            raise OSError(f"{out}: nothing can be written there ({error.strerror})") from error
        for name, write in writers.items():
            write(stage / name)
        with _uninterrupted():
            out.mkdir(parents=True, exist_ok=True)
            for name in writers:
                move(stage / name, out / name)
    return targets


def _existing(folder: Path) -> Path:
    """The folder itself, or the nearest one above it that exists."""
    folder = folder.absolute()
    return next(f for f in (folder, *folder.parents) if f.exists())


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Let Ctrl-C wait until the block is done."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    waiting: list[Any] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: waiting.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if waiting:
        raise KeyboardInterrupt
