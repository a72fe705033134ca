"""Switch on JAX's persistent compilation cache, so that a process loads functions that another process compiled."""

import os
from pathlib import Path


def enable_compilation_cache(folder: str | os.PathLike[str] | None = None) -> Path:
    """Make JAX store compiled functions in `folder`, which is created if it does not exist, and return the folder.

    Later processes load these functions instead of compiling them, but still trace them. The default folder, which the
    command line also uses, is `jax` in the cache folder of qtraj, as determined by platformdirs: on Linux, for example,
    `qtraj` in `$XDG_CACHE_HOME` or in `~/.cache`. You may delete this folder at any time. JAX runs the code that is
    stored in it, so only trusted users should have write access.

    Call this function at the start of the process, because functions that are already compiled are not stored. All
    functions that are compiled later are stored, even if they compile quickly. The environment variable
    `JAX_ENABLE_COMPILATION_CACHE=0` switches the cache off.

    **Raises:** ValueError if the folder cannot be created, is not writable, or is a file.
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
    reset_cache()  # otherwise JAX would continue to use the folder of the first compilation
    return path


def default_folder() -> Path:
    """Return the folder for compiled code in the user's cache folder.

    **Raises:** ValueError if the user has no home folder.
    """
    from platformdirs import user_cache_path  # imported here, so that importing this module is fast

    path = user_cache_path("qtraj", appauthor=False)
    if not path.is_absolute():
        raise ValueError("there is no home folder in which to store compiled code. Pass a folder.")
    return path / "jax"
