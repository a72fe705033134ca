"""Write several files into a folder: either all of them, each complete, or none."""

import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from qtraj.foundation.files import move, staging, sweep

Writer = Callable[[Path], None]


def check_folder(out: Path) -> None:
    """Raise an OSError if `write_all` cannot write into the folder `out`."""
    root = _existing(out)
    if not root.is_dir():
        raise NotADirectoryError(f"{root}: a folder to write into was expected, but this is a file")
    if not os.access(root, os.W_OK | os.X_OK):
        raise PermissionError(f"{root}: there is no permission to write into this folder")


def write_all(out: Path, writers: Mapping[str, Writer], obsolete: Iterable[Path] = ()) -> list[Path]:
    """Write one file for each item of `writers` (name, function that writes the file) into the folder `out`.

    The files are written into a hidden folder on the same file system, and moved to `out` when all of them are
    complete. Therefore an error in a writer or an interrupt leaves no files behind. If the process is killed, the next
    run removes the hidden folder. The files `obsolete` are removed after the new files have been moved to `out`. Other
    files in `out` are not changed.

    **Raises:** OSError if a file cannot be written.
    """
    check_folder(out)
    targets = [out / name for name in writers]
    if blocked := [target for target in targets if target.is_dir()]:
        raise IsADirectoryError(
            f"{blocked[0]}: this file cannot be written, because there is a folder with the same name"
        )
    root = _existing(out)
    if root == out.absolute():
        sweep(root.parent)  # an interrupted run staged its files in the parent if `out` did not exist yet
    with ExitStack() as stack:
        try:
            stage = stack.enter_context(staging(root))
        except OSError as error:
            raise OSError(f"{out}: this folder is not writable ({error.strerror})") from error
        for name, write in writers.items():
            write(stage / name)
        with _uninterrupted():
            out.mkdir(parents=True, exist_ok=True)
            for name in writers:
                move(stage / name, out / name)
            for file in obsolete:
                file.unlink(missing_ok=True)
    return targets


def _existing(folder: Path) -> Path:
    """Return the folder as an absolute path if it exists, otherwise its nearest existing parent."""
    folder = folder.absolute()
    return next(f for f in (folder, *folder.parents) if f.exists())


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Delay Ctrl-C until the end of the `with` block; in a thread other than the main thread, do nothing."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    pending: list[Any] = []
    previous_handler = signal.signal(signal.SIGINT, lambda number, frame: pending.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous_handler)
    if pending:
        raise KeyboardInterrupt
