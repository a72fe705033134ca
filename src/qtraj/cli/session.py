"""Change the settings of a run of the command line: precision, compilation cache, warnings of other packages."""

import io
import logging
import os
import sys
import warnings
from contextlib import suppress

import jax

from qtraj.foundation.compilation_cache import enable_compilation_cache

NOISY = ("jax", "jaxlib", "xarray", "matplotlib", "mpl_toolkits", "h5netcdf", "pandas")
"""Packages whose warnings and log messages do not help a user of the command line."""


def prepare() -> None:
    """Enable float64 and the compilation cache, and suppress the warnings of other packages."""
    jax.config.update("jax_enable_x64", True)
    if not os.environ.get("JAX_PLATFORMS"):
        jax.config.update("jax_platforms", "cpu")  # problems are small, sequential and in float64
    # Compilation takes much longer than the computation, so LLVM does not optimise unless the user sets XLA_FLAGS.
    os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")
    _enable_cache()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without Greek letters prints question marks
    for name in NOISY:
        logging.getLogger(name).setLevel(logging.ERROR)
        warnings.filterwarnings("ignore", module=rf"{name}(\.|$)")


def _enable_cache() -> None:
    """Store compiled code for the next run, if a writable folder exists.

    `JAX_ENABLE_COMPILATION_CACHE=0` disables the cache. If `JAX_COMPILATION_CACHE_DIR` is set, JAX uses that folder.
    """
    enabled = jax.config.jax_enable_compilation_cache  # type: ignore[attr-defined]
    if enabled and not os.environ.get("JAX_COMPILATION_CACHE_DIR"):
        with suppress(ValueError):
            enable_compilation_cache()
