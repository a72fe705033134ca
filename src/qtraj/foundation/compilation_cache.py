"""Switch on JAX's persistent compilation cache, so that later processes load what one process compiled."""

import os
import sys
from pathlib import Path


def enable_compilation_cache(folder: str | os.PathLike[str] | None = None) -> Path:
    """Make JAX store compiled functions in `folder`, which is created if missing and returned.

    Later processes load them instead of compiling; they still trace. The default is `qtraj/jax` in the user's cache
    folder, as for the command line: `XDG_CACHE_HOME` or `LOCALAPPDATA` if set, else `~/Library/Caches` on
    macOS and `~/.cache` elsewhere. The folder may be deleted at any time. JAX runs the code it finds there, so only
    trusted users should have write access.

    Call it at the start, since functions that are already compiled are not stored. All others are
    stored, however quickly they compile. `JAX_ENABLE_COMPILATION_CACHE=0` in the environment still switches the cache
    off.

    **Raises:** ValueError if the folder cannot be created or written to, or is a file.
    """
    import jax  # imported here, so that importing this module is fast
    from jax.experimental.compilation_cache.compilation_cache import reset_cache

    path = default_folder() if folder is None else Path(folder).expanduser().absolute()
    try:
        path.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        raise ValueError(f"{path}: a folder for compiled code was expected, but this is a file") from error
    except OSError as error:
        raise ValueError(
            f"{path}: this folder for compiled code cannot be created ({error.strerror}). Pass a writable folder."
        ) from error
    if not os.access(path, os.W_OK | os.X_OK):
        raise ValueError(f"{path}: this folder for compiled code is not writable. Pass a writable folder.")
    jax.config.update("jax_compilation_cache_dir", str(path))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    reset_cache()  # otherwise JAX keeps using its first folder
    return path


def default_folder() -> Path:
    """The folder for compiled code in the user's cache folder.

    **Raises:** ValueError if the user has no home folder.
    """
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        base = os.environ.get(name)
        if base and Path(base).is_absolute():  # the XDG specification says to ignore relative paths
            return Path(base) / "qtraj" / "jax"
    try:
        home = Path.home()
    except RuntimeError as error:
        raise ValueError("there is no home folder in which to store compiled code. Pass a folder.") from error
    return (home / "Library" / "Caches" if sys.platform == "darwin" else home / ".cache") / "qtraj" / "jax"
