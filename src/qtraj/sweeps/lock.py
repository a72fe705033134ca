"""Let one process at a time write to a store, with a lock of the operating system.

The system releases the lock when the process ends, also if it is killed, so a lock is never left behind.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def locked(file: Path) -> Iterator[None]:
    """Hold the lock in `file` during the `with` block.

    On file systems without locks, the block runs without a lock: the shards of a store have the same content whoever
    computes them, and each file is replaced as a whole.

    **Raises:** ValueError if another process has the lock.
    """
    descriptor = os.open(file, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        if not _acquired(descriptor):
            raise ValueError(
                f"{file.parent.parent}: another process is computing this sweep. Wait until it ends, or pass another "
                "folder"
            )
        yield
    finally:
        os.close(descriptor)


def _acquired(descriptor: int) -> bool:
    """Return whether no other process has the lock; also true if the file system has no locks."""
    if sys.platform == "win32":
        import msvcrt

        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True
    import fcntl

    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return True
    return True
