"""Load the dataset of a report from the result of a command, which is a folder or a file."""

from dataclasses import dataclass
from pathlib import Path

import xarray

from qtraj.design.timing.outcome import Retimed
from qtraj.design.tuning.outcome import Tuned
from qtraj.io.dataset_file import SUFFIXES, load_dataset
from qtraj.io.stored import load
from qtraj.motion.programs.rotation_minimizing import Frame, name_of
from qtraj.path.frame_axes import NATURAL
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.trihedral import Upright
from qtraj.viz.drawable import drawable

DATASETS = ("paths.nc", "table.nc")
"""Names of the dataset files that the commands write to their output folders."""
TUNED = "tuning.toml"
DOCUMENTS = (".toml", ".json")


@dataclass(frozen=True)
class Source:
    """The file from which a report is made, its dataset, and the corresponding tuned result or None."""

    file: Path
    dataset: xarray.Dataset
    tuned: Tuned | None = None


def find(result: Path, frame: Frame | None = None) -> Source:
    """Load the dataset of a result, which is a folder, a dataset file, or a saved path.

    **Raises:** OSError if the file does not exist or cannot be read; ValueError with the name of the file if the file
    is not a result.
    """
    if not result.exists():
        raise FileNotFoundError(
            f"{result}: this file or folder does not exist; 'qtraj tune' writes results to qtraj-out"
        )
    if result.suffix in DOCUMENTS:
        return _saved(result, Upright() if frame is None else frame)
    file = _within(result) if is_folder(result) else result
    dataset = load_dataset(file)
    if frame is not None:
        _require_frame(file, dataset, frame)
    return Source(file, dataset, _tuning(file.parent / TUNED, dataset))


def is_folder(result: Path) -> bool:
    """Return whether a result is a folder of files, and not a Zarr store."""
    return result.is_dir() and result.suffix not in SUFFIXES


def _within(folder: Path) -> Path:
    """Return the file of the only dataset in a folder."""
    files = [folder / name for name in DATASETS if (folder / name).is_file()]
    if not files:
        names = ", ".join(DATASETS)
        raise ValueError(
            f"{folder}: this folder contains none of the files that qtraj writes to its --out folder: {names}"
        )
    if len(files) > 1:
        raise ValueError(f"{folder}: this folder contains several results: pass one of {', '.join(map(str, files))}")
    return files[0]


def _require_frame(file: Path, dataset: xarray.Dataset, frame: Frame) -> None:
    """Raise a ValueError if the attitudes in a dataset refer to another frame."""
    if "position" not in dataset:
        raise ValueError(f"{file}: --frame needs a path, but this result contains only attitudes")
    actual, requested = dataset.attrs.get("frame", NATURAL), name_of(frame)
    if actual != requested:
        raise ValueError(
            f"{file}: the attitudes in this dataset refer to the {actual} frame. Pass the saved path in the same "
            f"folder (path.toml, tuning.toml), or rerun the command that wrote the dataset with --frame {requested}"
        )


def _saved(file: Path, frame: Frame) -> Source:
    """Evaluate a saved path, or the path of a saved result of a tuning or retiming."""
    stored = load(file)
    tuned = stored if isinstance(stored, Tuned) else None
    if not isinstance(stored, AbstractHodograph | Tuned | Retimed):
        raise ValueError(
            f"{file}: a saved path, tuning or retiming was expected, but the file contains an object of type "
            f"{type(stored).__name__}. Pass the table.nc in the same folder."
        )
    dataset = drawable(stored, frame)
    return Source(file, dataset.assign_attrs(title=file.name), tuned)


def _tuning(file: Path, dataset: xarray.Dataset) -> Tuned | None:
    """Return the tuned result in the folder of a dataset if the tuned path is the path "after", otherwise None."""
    if not file.is_file() or "path" not in dataset.dims or "after" not in dataset["path"].values.tolist():
        return None
    try:
        tuned = load(file)
    except ValueError:  # a file that has this name, but was not written by qtraj
        return None
    duration = float(dataset["duration"].sel(path="after")) if "duration" in dataset else None
    return tuned if isinstance(tuned, Tuned) and float(tuned.path.duration) == duration else None
