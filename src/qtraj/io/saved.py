"""Load saved documents that must contain a path or an attitude program."""

from pathlib import Path
from typing import Any

from qtraj.design.fitting.fitted import Fitted
from qtraj.design.timing.timing import RetimedPath
from qtraj.design.tuning.outcome import Tuned
from qtraj.foundation.outcome import AbstractOutcome
from qtraj.motion.attitude import AbstractProgram
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.spiral_helix import SpiralHelix


def saved_path(file: Path) -> SpiralHelix:
    """Load a saved path, or the path in a saved result of `tune` or `fit`.

    **Raises:** OSError if the file cannot be read; ValueError with the name of the file if it does not contain a
    spiral-helix.
    """
    from qtraj.io.stored import load  # imported here, because `stored` imports all classes that can be stored

    stored = load(file)
    path = stored.path if isinstance(stored, Tuned | Fitted) else stored
    if not isinstance(path, SpiralHelix):
        raise _unexpected(file, "path", stored)
    return path


def saved_hodograph(file: Path) -> AbstractHodograph:
    """Load a saved path of any class, or the path in a saved result; for a retimed path, return the original path.

    **Raises:** OSError if the file cannot be read; ValueError with the name of the file if it does not contain a path.
    """
    from qtraj.io.stored import load  # imported here, because `stored` imports all classes that can be stored

    stored = load(file)
    path = getattr(stored, "path", None) if isinstance(stored, AbstractOutcome) else stored
    path = path.path if isinstance(path, RetimedPath) else path
    if not isinstance(path, AbstractHodograph):
        raise _unexpected(file, "path", stored)
    return path


def saved_program(file: Path) -> AbstractProgram:
    """Load a saved attitude program.

    **Raises:** OSError if the file cannot be read; ValueError with the name of the file if it does not contain an
    attitude program.
    """
    from qtraj.io.stored import load  # imported here, because `stored` imports all classes that can be stored

    stored = load(file)
    if not isinstance(stored, AbstractProgram):
        raise _unexpected(file, "program", stored)
    return stored


def _unexpected(file: Path, what: str, stored: Any) -> ValueError:
    name = type(stored).__name__
    return ValueError(f"{file}: a saved {what} was expected, but the file contains an object of type {name}")
