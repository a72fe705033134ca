"""The entry point of the command line: what must happen before anything else is imported."""

import atexit
import gc
import importlib.util
import os
import sys
from contextlib import suppress
from typing import NoReturn

from qtraj.cli import BAD_INPUT, INTERRUPTED

NEEDED = ("typer", "rich", "pydantic", "xarray", "h5netcdf", "matplotlib")
"""What the command line needs beyond the core of qtraj."""

SELDOM = (100_000, 20, 100)
"""Thresholds of Python's garbage collector, which by default takes a tenth of a run to find modules and traces."""


def main() -> None:
    """Run the command line; exit with 2, saying what to install, where a package is missing."""
    missing = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        sys.stderr.write(
            f"error: the command line needs {', '.join(missing)}, which this environment lacks. "
            "Install it with: pip install 'qtraj[all]'\n"
        )
        sys.exit(BAD_INPUT)
    gc.set_threshold(*SELDOM)
    atexit.register(gc.freeze)  # a process that ends need not search for garbage once more
    try:
        from qtraj.cli.session import prepare

        prepare()
        from qtraj.cli.app import app  # after the settings, in case an import computes

        app(prog_name="qtraj")
    except KeyboardInterrupt:  # before a command has begun, which sees to it itself
        sys.stderr.write("interrupted\n")
        _leave()
    except SystemExit as end:
        if end.code == INTERRUPTED:
            _leave()
        raise


def _leave() -> NoReturn:
    """End an interrupted process at once.

    JAX's threads may still compile or compute. JAX clears its caches at the usual exit, under which they can crash.
    """
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):
            stream.flush()
    os._exit(INTERRUPTED)
