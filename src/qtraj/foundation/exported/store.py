"""The programs of a folder: each read once, and those of the last run of a command before they are asked for."""

import importlib
import re
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path

from qtraj.foundation.exported.executable import Executable, read, write
from qtraj.foundation.files import write_atomically

UNUSED = 30 * 24 * 3600.0
"""Programs of other sources and versions are removed after so many seconds [s]."""

THREADS = 2
"""That load ahead; reading back what XLA has compiled leaves the interpreter to others, the rest does not."""

NAME = re.compile(r"[\w<>]{1,100}-[0-9a-f]{32}")


class Store:
    """Programs by name, in the files of a folder."""

    def __init__(self, folder: Path):
        self._folder = folder
        self._found: dict[str, Future[Executable | None]] = {}
        self._claiming = threading.Lock()
        self._making = threading.RLock()  # a function that is traced may call another one that is kept
        self._refused: set[str] = set()
        self._used: set[str] = set()

    def executable(self, name: str, make: Callable[[], bytes | None]) -> Executable | None:
        """The program of that name, which is made where there is none; None where it cannot be made."""
        found = self._loaded(name) or self._made(name, make)
        if found is not None:
            self._used.add(name)
        return found

    @contextmanager
    def ahead(self, command: str, load: bool = True) -> Iterator[None]:
        """Load what the last run of a command used, largest first, beside what is done here; note what is used here.

        What is loading is waited for in the end, for a thread in XLA's code must not outlive the interpreter.
        """
        importlib.import_module("jax.export")  # here, and not in several threads at once
        note = self._folder / f"{command}.used"
        before = _noted(note)
        largest_first = sorted(before, key=lambda name: _size(self._folder / name), reverse=True)
        pool = ThreadPoolExecutor(THREADS, thread_name_prefix="qtraj-programs")
        try:
            for name in largest_first if load else ():
                pool.submit(self._loaded, name)
            pool.shutdown(wait=False)  # threads end when there is no more to load
            yield
        finally:
            pool.shutdown(cancel_futures=True)
            if self._used and self._used != before:
                with suppress(OSError):
                    write_atomically(note, "\n".join(sorted(self._used)).encode())

    def _loaded(self, name: str) -> Executable | None:
        """The program of that name, loaded here or by who came first; None where there is none that can be loaded."""
        with self._claiming:
            found, mine = self._found.get(name), name not in self._found
            if found is None:
                found = self._found[name] = Future()
        if mine:
            try:
                content = read(self._folder / name)
                found.set_result(None if content is None else Executable(content))
            except Exception:  # whatever is wrong with what was kept: it is made anew
                found.set_result(None)
            except BaseException:
                found.set_result(None)  # or those who wait would do so for ever
                raise
        return found.result()

    def _made(self, name: str, make: Callable[[], bytes | None]) -> Executable | None:
        """The program of that name, made here or by who came first."""
        if name in self._refused:
            return None
        with self._making:
            if (found := self._loaded(name)) is not None:
                return found
            content = make()
            if content is None:
                self._refused.add(name)
                return None
            return self._add(name, content)

    def _add(self, name: str, content: bytes) -> Executable:
        """Take in a program; where it cannot be written, the next process traces anew."""
        found: Future[Executable | None] = Future()
        executable = Executable(content)
        found.set_result(executable)
        self._found[name] = found
        with suppress(OSError):
            if not self._folder.exists():
                self._folder.mkdir(parents=True)
                _remove_unused(self._folder.parent)
            write(self._folder / name, content)
        return executable


def _noted(note: Path) -> set[str]:
    """The names that were written there."""
    try:
        return {name for name in note.read_text(encoding="utf-8").split() if NAME.fullmatch(name)}
    except (OSError, UnicodeError):
        return set()


def _size(file: Path) -> int:
    try:
        return file.stat().st_size
    except OSError:
        return 0


def _remove_unused(folder: Path) -> None:
    """Remove the programs of other sources and versions to which none has been added for long."""
    for other in folder.iterdir():
        if other.is_dir() and time.time() - other.stat().st_mtime > UNUSED:
            shutil.rmtree(other, ignore_errors=True)
