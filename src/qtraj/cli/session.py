"""What a run of the command line sets up once: precision, compilation cache, quiet libraries."""

import io
import logging
import os
import sys
import warnings
from pathlib import Path

import jax

from qtraj.foundation.exported.kept import keep_in

NOISY = ("jax", "jaxlib", "xarray", "matplotlib", "mpl_toolkits", "h5netcdf", "pandas")
"""Packages whose warnings and log messages say nothing to a user of the command line."""


def prepare() -> None:
    """Switch on float64, keep programs from run to run, and keep other packages' noise off the terminal."""
    jax.config.update("jax_enable_x64", True)
    if not os.environ.get("JAX_PLATFORMS"):
        jax.config.update("jax_platforms", "cpu")  # one small problem: sequential, in float64
    # Compiling takes far longer here than what is compiled: leave out LLVM's optimisation, unless told otherwise.
    os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")
    _keep_programs()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without Greek shows question marks
    for name in NOISY:
        logging.getLogger(name).setLevel(logging.ERROR)
        warnings.filterwarnings("ignore", module=rf"{name}(\.|$)")


def cache_folder() -> Path:
    """The user's cache folder for qtraj: XDG_CACHE_HOME or LOCALAPPDATA where set, else the platform's own."""
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        folder = os.environ.get(name)
        if folder and Path(folder).is_absolute():
            return Path(folder) / "qtraj"
    home = Path.home()
    return (home / "Library" / "Caches" if sys.platform == "darwin" else home / ".cache") / "qtraj"


def _keep_programs() -> None:
    """A second run need neither trace nor compile again; where no folder can be made, each run does.

    JAX_ENABLE_COMPILATION_CACHE=0 switches both off.
    """
    if not jax.config.jax_enable_compilation_cache:  # type: ignore[attr-defined]
        return
    try:
        folder = cache_folder()
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):  # Path.home() knows none
        return
    if not os.access(folder, os.W_OK | os.X_OK):
        return
    keep_in(folder / "programs")
    if os.environ.get("JAX_COMPILATION_CACHE_DIR"):
        return
    jax.config.update("jax_compilation_cache_dir", str(folder / "jax"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
