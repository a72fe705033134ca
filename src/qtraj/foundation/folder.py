"""Several files written into a folder at once: all of them whole, or none."""

import os
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from qtraj.foundation.files import move, staging, sweep

Writer = Callable[[Path], None]


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
