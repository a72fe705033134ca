"""The programs of a folder: each read once, and those of the last run of a command before they are asked for."""

import shutil
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

from qtraj.foundation.files import write_atomically
from qtraj.foundation.programs.program import Program, read, write

UNUSED = 30 * 24 * 3600.0
"""Programs of other sources and versions are removed after so many seconds [s]."""

THREADS = 2
"""That load ahead; reading back what XLA has compiled leaves the interpreter to others, the rest does not."""


class Store:
    """Programs by name, in the files of a folder."""

    def __init__(self, folder: Path):
        self._folder = folder
        self._found: dict[str, Future[Program | None]] = {}
        self._claiming, self._making = threading.Lock(), threading.Lock()
        self._refused: set[str] = set()
        self._used: set[str] = set()

    def program(self, name: str, make: Callable[[], bytes | None]) -> Program | None:
        """The program of that name, which is made where there is none; None where it cannot be made."""
        found = self._read(name) or self._made(name, make)
        if found is not None:
            self._used.add(name)
        return found

    @contextmanager
    def ahead(self, command: str) -> Iterator[None]:
        """Load what the last run of a command used, largest first, beside what is done here; note what is used here.

        A run that used nothing else leaves the note as it is.
        """
        note = self._folder / f"{command}.used"
        before = _noted(note)
        pool = ThreadPoolExecutor(THREADS, thread_name_prefix="qtraj-programs")
        for name in sorted(before, key=lambda name: -_size(self._folder / name)):
            pool.submit(self._read, name)
        try:
            yield
        finally:
            pool.shutdown(cancel_futures=True)
            if not self._used <= set(before):
                _try(lambda: write_atomically(note, "\n".join(sorted(self._used)).encode()))

    def _read(self, name: str) -> Program | None:
        """The program of that name, loaded here or by who came first; None where there is no such file."""
        with self._claiming:
            taken = name in self._found
            found = self._found.setdefault(name, Future())
        if not taken:
            try:
                content = read(self._folder / name)
                found.set_result(None if content is None else Program(content))
            except BaseException as error:
                found.set_exception(error)
        return found.result()

    def _made(self, name: str, make: Callable[[], bytes | None]) -> Program | None:
        """The program of that name, made here or by who came first."""
        with self._making:
            found = self._read(name)
            if found is not None or name in self._refused:
                return found
            content = make()
            if content is None:
                self._refused.add(name)
                return None
            return self._add(name, content)

    def _add(self, name: str, content: bytes) -> Program:
        """Take in a program; where it cannot be written, the next process traces anew."""
        program = Program(content)
        self._found[name] = Future()
        self._found[name].set_result(program)
        _try(lambda: self._write(name, content))
        return program

    def _write(self, name: str, content: bytes) -> None:
        if not self._folder.exists():
            self._folder.mkdir(parents=True)
            _remove_unused(self._folder.parent)
        write(self._folder / name, content)


def _noted(note: Path) -> list[str]:
    """The names that were written there."""
    try:
        return note.read_text(encoding="utf-8").split()
    except (OSError, UnicodeError):
        return []


def _size(file: Path) -> int:
    return file.stat().st_size if file.exists() else 0


def _try(write: Callable[[], None]) -> None:
    try:
        write()
    except OSError:
        return


def _remove_unused(folder: Path) -> None:
    """Remove the programs of other sources and versions to which none has been added for long."""
    for other in folder.iterdir():
        if other.is_dir() and time.time() - other.stat().st_mtime > UNUSED:
            shutil.rmtree(other, ignore_errors=True)
