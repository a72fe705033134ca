"""Files that are either complete or absent, also where a process is killed while it writes."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

_NAME = ".qtraj-"
_LOCK = ".lock"
_REPLACED = ".replaced"


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file that is either complete or absent, also when the process is interrupted or killed."""
    with staging(path.parent) as stage:
        staged = stage / "content"
        staged.write_bytes(content)
        os.chmod(staged, 0o644)
        move(staged, path)


@contextmanager
def staging(folder: Path) -> Iterator[Path]:
    """A new hidden folder in `folder`, for files that `move` brings to their places once they are complete.

    It is removed at the end. A killed process cannot do that, so each call first removes what killed processes left in
    `folder` (see `sweep`). The folder belongs to its process by a lock on a file inside, which the operating system
    releases when the process ends, however it ends.

    **Raises:** OSError where `folder` cannot be written to.
    """
    sweep(folder)
    stage, lock = _new_stage(folder)
    try:
        yield stage
    finally:
        _discard(stage)
        if lock is not None:
            os.close(lock)


def move(staged: Path, target: Path) -> None:
    """Move a complete file or folder out of its staging folder to `target`, replacing what has this name there.

    A folder cannot be replaced in one step. The old one waits in the staging folder. If the process fails before the
    new one is in its place, the old one is put back. If the process is killed, the next `sweep` of this folder puts it
    back. After a restart of the machine, or without file locks, it stays in the staging folder, as `.replaced`.

    **Raises:** OSError where it cannot be moved, such as a file to the name of a folder.
    """
    if not (staged.is_dir() and target.is_dir()):
        os.replace(staged, target)
        return
    aside = staged.parent / _REPLACED
    aside.mkdir(exist_ok=True)
    os.replace(target, aside / target.name)
    os.replace(staged, target)
    shutil.rmtree(aside, ignore_errors=True)


def sweep(folder: Path) -> None:
    """Remove the staging folders in `folder` whose process was killed.

    Only this user's folders are removed, and only those whose lock this running kernel can decide on, which the name
    says: what another machine left on a shared file system stays, and so does what was left before a restart. Where
    there are no such locks (Windows, some network file systems), nothing is removed.
    """
    prefix = _prefix()
    if prefix is None:
        return
    left: list[Path] = []
    with suppress(OSError), os.scandir(folder) as entries:
        left += [Path(e.path) for e in entries if e.name.startswith(prefix) and e.is_dir(follow_symlinks=False)]
    for stage in left:
        with suppress(OSError):
            if stage.lstat().st_uid == os.geteuid():
                _remove_unowned(stage)


def _new_stage(folder: Path) -> tuple[Path, int | None]:
    """A staging folder with its lock, held; without one where locks are not to be had."""
    prefix = _prefix()
    for _ in range(0 if prefix is None else 10):
        stage = Path(tempfile.mkdtemp(prefix=prefix, dir=folder))
        try:
            lock = os.open(stage / _LOCK, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
        except FileNotFoundError:
            continue  # another process removed it while it was empty
        try:
            if _acquire(lock, stage):
                return stage, lock
        except OSError:  # this file system has no locks
            os.close(lock)
            shutil.rmtree(stage, ignore_errors=True)
            break
        os.close(lock)  # another process took the lock first and removes the folder
    return Path(tempfile.mkdtemp(prefix=_NAME, dir=folder)), None


def _remove_unowned(stage: Path) -> None:
    try:
        lock = os.open(stage / _LOCK, os.O_RDWR | os.O_NOFOLLOW)
    except FileNotFoundError:
        os.rmdir(stage)  # refused unless empty; a process about to lock it takes another
        return
    try:
        if _acquire(lock, stage):
            _discard(stage)
    finally:
        os.close(lock)


def _acquire(lock: int, stage: Path) -> bool:
    """Take the lock unless a process holds it; False, too, where the folder is gone by then.

    **Raises:** OSError where the file system has no locks.
    """
    if fcntl is None:
        raise OSError("this system has no locks on files")
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    with suppress(FileNotFoundError):
        return os.path.samestat(os.fstat(lock), os.lstat(stage / _LOCK))
    return False


def _discard(stage: Path) -> None:
    """Remove a staging folder, the lock last: until then no other process takes it for abandoned."""
    with suppress(OSError):
        for old in stage.glob(f"{_REPLACED}/*"):
            if not os.path.lexists(stage.parent / old.name):
                os.replace(old, stage.parent / old.name)
        for entry in stage.iterdir():
            if entry.is_dir() and not entry.is_symlink():
                shutil.rmtree(entry, ignore_errors=True)
            elif entry.name != _LOCK:
                entry.unlink(missing_ok=True)
        (stage / _LOCK).unlink(missing_ok=True)
        stage.rmdir()


def _prefix() -> str | None:
    """How this kernel's staging folders begin; None where a lock does not tell whether its process lives.

    A lock is certain among the processes of one running kernel. Between machines that share a file system it need not
    be, so the name holds the identity that Linux gives to every start of the system.
    """
    if fcntl is None:
        return None
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip().replace("-", "")
    except (OSError, ValueError):
        return None
    return f"{_NAME}{boot[:16]}-" if boot else None
