"""Load saved documents that must contain a path or a program."""

from pathlib import Path

from qtraj.design.fitting.fitted import Fitted
from qtraj.design.tuning.outcome import Tuned
from qtraj.motion.attitude import AbstractProgram
from qtraj.path.spiral_helix import SpiralHelix


def is_saved(file: Path) -> bool:
    """Whether a file is a stored document, of any kind, and not a scenario."""
    if file.suffix == ".json":
        return True
    lines = file.read_text(encoding="utf-8", errors="replace").splitlines()
    first = next((k for k, line in enumerate(lines) if line.lstrip().startswith("[")), len(lines))
    return any(line.split("=")[0].strip() == "format" for line in lines[:first])  # before the first table


def saved_path(file: Path) -> SpiralHelix:
    """The path in a saved document, or the path of a saved result of `tune` or `fit`.

    **Raises:** OSError, or ValueError naming the file if it does not contain a spiral-helix.
    """
    from qtraj.io.stored import load  # imported here, because it imports every class that can be stored

    stored = load(file)
    path = stored.path if isinstance(stored, Tuned | Fitted) else stored
    if not isinstance(path, SpiralHelix):
        raise ValueError(f"{file}: a saved path was expected, but the file contains a {type(stored).__name__}")
    return path


def saved_program(file: Path) -> AbstractProgram:
    """The attitude program in a saved document.

    **Raises:** OSError, or ValueError naming the file if it does not contain a program.
    """
    from qtraj.io.stored import load  # imported here, because it imports every class that can be stored

    stored = load(file)
    if not isinstance(stored, AbstractProgram):
        raise ValueError(f"{file}: a saved program was expected, but the file contains a {type(stored).__name__}")
    return stored
