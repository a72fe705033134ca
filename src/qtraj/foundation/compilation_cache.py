"""JAX's persistent compilation cache: what one process compiles, later ones load."""

import os
import sys
from pathlib import Path


def enable_compilation_cache(folder: str | os.PathLike[str] | None = None) -> Path:
    """Make JAX store what it compiles in `folder`, which is made if missing and returned.

    Later processes load it and no longer compile; they still trace. The default is `qtraj/jax` in the user's cache
    folder, which the command line uses too: `XDG_CACHE_HOME` or `LOCALAPPDATA` where set, else `~/Library/Caches` on
    macOS and `~/.cache` elsewhere. The folder may be deleted at any time. JAX runs the code it finds there, so only
    trusted users should have write access.

    Call it at the start: what is already compiled is not stored. All functions are stored, also those that compile
    quickly. `JAX_ENABLE_COMPILATION_CACHE=0` in the environment still switches the cache off.

    **Raises:** ValueError where the folder cannot be made or written to, or is a file.
    """
    import jax  # here, so that importing this module costs nothing
    from jax.experimental.compilation_cache.compilation_cache import reset_cache

    path = default_folder() if folder is None else Path(folder).expanduser().absolute()
    try:
        path.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        raise ValueError(f"{path}: a folder for compiled code was expected, but this is a file") from error
    except OSError as error:
        raise ValueError(
            f"{path}: this folder for compiled code cannot be made ({error.strerror}). Pass one that can be written to."
        ) from error
    if not os.access(path, os.W_OK | os.X_OK):
        raise ValueError(f"{path}: this folder for compiled code cannot be written to. Pass one that can.")
    jax.config.update("jax_compilation_cache_dir", str(path))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    reset_cache()  # JAX otherwise keeps to the first folder that it used
    return path


def default_folder() -> Path:
    """The folder for compiled code in the user's cache folder.

    **Raises:** ValueError where the user has no home folder.
    """
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        base = os.environ.get(name)
        if base and Path(base).is_absolute():  # others are to be ignored, by the XDG specification
            return Path(base) / "qtraj" / "jax"
    try:
        home = Path.home()
    except RuntimeError as error:
        raise ValueError("there is no home folder to keep compiled code in. Pass the folder to use.") from error
    return (home / "Library" / "Caches" if sys.platform == "darwin" else home / ".cache") / "qtraj" / "jax"
