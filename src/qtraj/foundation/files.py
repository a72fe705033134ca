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
    """Write a file so that it is either complete or absent, even if the process is interrupted or killed."""
    with staging(path.parent) as stage:
        staged = stage / "content"
        staged.write_bytes(content)
        os.chmod(staged, 0o644)
        move(staged, path)


@contextmanager
def staging(folder: Path) -> Iterator[Path]:
    """Create a hidden folder in `folder`, for files that `move` moves to their targets once they are complete.

    This staging folder is removed at the end of the `with` block. A process that is killed cannot remove it, so each
    call first removes the staging folders of killed processes in `folder` (see `sweep`). A process owns a staging
    folder while the process locks a file in the folder. The operating system releases the lock when the process ends.

    **Raises:** OSError if `folder` is not writable.
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
    """Move a complete file or folder from its staging folder to `target`, replacing an existing target.

    A folder cannot be replaced in one step, so an existing target folder is first moved into the staging folder. If the
    replacement then fails, the old folder is restored at the end of `staging`. If the process is killed, the next
    `sweep` restores the old folder. If the machine restarts before this `sweep`, or if file locks are not supported,
    the old folder remains in the subfolder `.replaced` of the staging folder.

    **Raises:** OSError if the move fails, for example if `staged` is a file and `target` is a folder.
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
    """Remove the staging folders of killed processes in `folder`.

    Only folders of this user are removed, and only folders that were created since this machine started, because a lock
    is reliable only within one running kernel. The names of staging folders contain the boot ID. Folders of other
    machines on a shared file system are kept. Without file locks (Windows, some network file systems) nothing is
    removed.
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
    """Create a staging folder and acquire its lock; the lock is None if locks are not supported."""
    prefix = _prefix()
    for _ in range(0 if prefix is None else 10):
        stage = Path(tempfile.mkdtemp(prefix=prefix, dir=folder))
        try:
            lock = os.open(stage / _LOCK, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
        except FileNotFoundError:
            continue  # another process removed the folder while it was empty
        try:
            if _acquire(lock, stage):
                return stage, lock
        except OSError:  # this file system does not support locks
            os.close(lock)
            shutil.rmtree(stage, ignore_errors=True)
            break
        os.close(lock)  # another process acquired the lock first and removes the folder
    return Path(tempfile.mkdtemp(prefix=_NAME, dir=folder)), None


def _remove_unowned(stage: Path) -> None:
    try:
        lock = os.open(stage / _LOCK, os.O_RDWR | os.O_NOFOLLOW)
    except FileNotFoundError:
        os.rmdir(stage)  # fails unless the folder is empty; the owner, if any, then creates another folder
        return
    try:
        if _acquire(lock, stage):
            _discard(stage)
    finally:
        os.close(lock)


def _acquire(lock: int, stage: Path) -> bool:
    """Acquire the lock; return False if another process owns the lock, or if the folder has been removed.

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
    """Remove a staging folder; the lock file is removed last, so that no other process considers the folder abandoned.

    A replaced folder is first moved back to its target if the target does not exist.
    """
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
    """Return the prefix for names of staging folders; None if locks do not show whether a process is still running.

    Locks are reliable between processes of one running kernel, but not between machines that share a file system.
    Therefore the prefix contains the boot ID, which changes at every boot.
    """
    if fcntl is None:
        return None
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip().replace("-", "")
    except (OSError, ValueError):
        return None
    return f"{_NAME}{boot[:16]}-" if boot else None
