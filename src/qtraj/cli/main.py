"""Define the entry point of the command line, which changes settings before it imports the commands."""

import atexit
import gc
import importlib.util
import io
import logging
import os
import sys
import warnings
from contextlib import suppress
from typing import NoReturn

from qtraj.cli import BAD_INPUT, INTERRUPTED

NEEDED = ("typer", "rich", "pydantic", "xarray", "h5netcdf", "matplotlib")
"""Packages that the command line needs in addition to the core of qtraj."""

NOISY = ("jax", "jaxlib", "xarray", "matplotlib", "mpl_toolkits", "h5netcdf", "pandas")
"""Packages whose warnings and log messages do not help a user of the command line."""

GC_THRESHOLDS = (100_000, 20, 100)
"""Thresholds of Python's garbage collector; with the defaults, garbage collection takes a tenth of the run time."""


def main() -> None:
    """Run the command line; if a package is missing, print how to install it and exit with code 2."""
    missing = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        sys.stderr.write(
            f"error: the command line needs packages that are not installed: {', '.join(missing)}. "
            "Install them with: pip install 'qtraj[all]'\n"
        )
        sys.exit(BAD_INPUT)
    gc.set_threshold(*GC_THRESHOLDS)
    atexit.register(gc.freeze)  # no garbage collection at the end of the process
    try:
        prepare()
        from qtraj.cli.app import app  # after the settings, because imports may run computations

        app(prog_name="qtraj")
    except KeyboardInterrupt:  # before a command starts; commands handle interrupts themselves
        sys.stderr.write("interrupted\n")
        _leave()
    except SystemExit as end:
        if end.code == INTERRUPTED:
            _leave()
        raise


def prepare() -> None:
    """Enable float64 and the compilation cache, and suppress the warnings of other packages."""
    import jax

    jax.config.update("jax_enable_x64", True)
    if not os.environ.get("JAX_PLATFORMS"):
        jax.config.update("jax_platforms", "cpu")  # problems are small, sequential and in float64
    # Compilation takes much longer than the computation, so LLVM does not optimise unless the user sets XLA_FLAGS.
    os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")
    _enable_cache(jax.config.jax_enable_compilation_cache)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without Greek letters prints question marks
    for name in NOISY:
        logging.getLogger(name).setLevel(logging.ERROR)
        warnings.filterwarnings("ignore", module=rf"{name}(\.|$)")


def _enable_cache(enabled: bool) -> None:
    """Store compiled code for the next run, if a writable folder exists.

    `JAX_ENABLE_COMPILATION_CACHE=0` disables the cache. If `JAX_COMPILATION_CACHE_DIR` is set, JAX uses that folder.
    """
    from qtraj.foundation.compilation_cache import enable_compilation_cache

    if enabled and not os.environ.get("JAX_COMPILATION_CACHE_DIR"):
        with suppress(ValueError):
            enable_compilation_cache()


def _leave() -> NoReturn:
    """Exit an interrupted process immediately.

    JAX threads may still be compiling or computing. A normal exit clears the caches of JAX, and these threads can then
    crash.
    """
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):
            stream.flush()
    os._exit(INTERRUPTED)
