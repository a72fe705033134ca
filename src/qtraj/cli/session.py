"""What a run of the command line sets up once: precision, compilation cache, quiet libraries."""

import io
import logging
import os
import sys
import warnings
from contextlib import suppress

import jax

from qtraj.foundation.compilation_cache import enable_compilation_cache

NOISY = ("jax", "jaxlib", "xarray", "matplotlib", "mpl_toolkits", "h5netcdf", "pandas")
"""Packages whose warnings and log messages say nothing to a user of the command line."""


def prepare() -> None:
    """Switch on float64, cache compiled code from run to run, and keep other packages' noise off the terminal."""
    jax.config.update("jax_enable_x64", True)
    if not os.environ.get("JAX_PLATFORMS"):
        jax.config.update("jax_platforms", "cpu")  # one small problem: sequential, in float64
    # Compiling takes far longer here than what is compiled: leave out LLVM's optimisation, unless told otherwise.
    os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")
    _enable_cache()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without Greek shows question marks
    for name in NOISY:
        logging.getLogger(name).setLevel(logging.ERROR)
        warnings.filterwarnings("ignore", module=rf"{name}(\.|$)")


def _enable_cache() -> None:
    """Store what is compiled for the next run; without a folder for it, each run compiles.

    `JAX_ENABLE_COMPILATION_CACHE=0` switches this off, and a folder in `JAX_COMPILATION_CACHE_DIR` is left to JAX.
    """
    enabled = jax.config.jax_enable_compilation_cache  # type: ignore[attr-defined]
    if enabled and not os.environ.get("JAX_COMPILATION_CACHE_DIR"):
        with suppress(ValueError):
            enable_compilation_cache()
