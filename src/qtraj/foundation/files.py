"""Write files that are either complete or absent, even if the process is killed."""

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
    """Write a file that is either complete or absent, even if the process is interrupted or killed."""
    with staging(path.parent) as stage:
        staged = stage / "content"
        staged.write_bytes(content)
        os.chmod(staged, 0o644)
        move(staged, path)


@contextmanager
def staging(folder: Path) -> Iterator[Path]:
    """A new hidden folder in `folder`, for files that `move` puts in place once they are complete.

    It is removed at the end. Since a killed process cannot do that, each call first removes the staging folders of
    killed processes in `folder` (see `sweep`). A process owns its staging folder by a lock on a file in it, which the
    operating system releases when the process ends.

    **Raises:** OSError if `folder` cannot be written to.
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
    """Move a complete file or folder out of its staging folder to `target`, replacing an existing one.

    A folder cannot be replaced in one step, so the old one is first moved into the staging folder. If the process fails
    before the new one is in place, the old one is restored. If the process is killed, the next `sweep` of this folder
    restores it. After a restart of the machine, or without file locks, it stays in the staging folder, as `.replaced`.

    **Raises:** OSError if the move fails, for example of a file to the name of a folder.
    """
    if not (staged.is_dir() and target.is_dir()):
        os.replace(staged, target)
        return
    replaced = staged.parent / _REPLACED
    replaced.mkdir(exist_ok=True)
    os.replace(target, replaced / target.name)
    os.replace(staged, target)
    shutil.rmtree(replaced, ignore_errors=True)


def sweep(folder: Path) -> None:
    """Remove the staging folders in `folder` whose process was killed.

    Only this user's folders are removed, and only folders created since this machine started (their names contain the
    boot ID), because a lock is reliable only within one running kernel. Folders from other machines on a shared file
    system stay. Without file locks (Windows, some network file systems) nothing is removed.
    """
    prefix = _prefix()
    if prefix is None:
        return
    stages: list[Path] = []
    with suppress(OSError), os.scandir(folder) as entries:
        stages += [Path(e.path) for e in entries if e.name.startswith(prefix) and e.is_dir(follow_symlinks=False)]
    for stage in stages:
        with suppress(OSError):
            if stage.lstat().st_uid == os.geteuid():
                _remove_unowned(stage)


def _new_stage(folder: Path) -> tuple[Path, int | None]:
    """A staging folder and its acquired lock, or None in place of the lock if locks are not supported."""
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
        except OSError:  # this file system does not support locks
            os.close(lock)
            shutil.rmtree(stage, ignore_errors=True)
            break
        os.close(lock)  # another process took the lock first and removes the folder
    return Path(tempfile.mkdtemp(prefix=_NAME, dir=folder)), None


def _remove_unowned(stage: Path) -> None:
    try:
        lock = os.open(stage / _LOCK, os.O_RDWR | os.O_NOFOLLOW)
    except FileNotFoundError:
        os.rmdir(stage)  # fails unless it is empty; a process that was about to lock it creates another
        return
    try:
        if _acquire(lock, stage):
            _discard(stage)
    finally:
        os.close(lock)


def _acquire(lock: int, stage: Path) -> bool:
    """Acquire the lock; False if another process has it, or if the folder has been removed.

    **Raises:** OSError if the file system does not support locks.
    """
    if fcntl is None:
        raise OSError("this system does not support file locks")
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    with suppress(FileNotFoundError):
        return os.path.samestat(os.fstat(lock), os.lstat(stage / _LOCK))
    return False


def _discard(stage: Path) -> None:
    """Remove a staging folder; its lock is removed last, so that no other process considers the folder abandoned."""
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
    """The prefix of this kernel's staging folders; None if locks do not show whether a process is alive.

    Locks are reliable between processes of one running kernel, but not between machines that share a file system. So
    the prefix contains the boot ID, which Linux assigns at every start.
    """
    if fcntl is None:
        return None
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip().replace("-", "")
    except (OSError, ValueError):
        return None
    return f"{_NAME}{boot[:16]}-" if boot else None
