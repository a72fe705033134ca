"""Define the entry point of the command line, which imports the commands after changing settings."""

import atexit
import gc
import importlib.util
import os
import sys
from contextlib import suppress
from typing import NoReturn

from qtraj.cli import BAD_INPUT, INTERRUPTED

NEEDED = ("typer", "rich", "pydantic", "xarray", "h5netcdf", "matplotlib")
"""Packages that the command line needs in addition to the core of qtraj."""

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
        from qtraj.cli.session import prepare

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


def _leave() -> NoReturn:
    """Exit an interrupted process immediately.

    JAX threads may still be compiling or computing. A normal exit clears the caches of JAX, and these threads can then
    crash.
    """
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):
            stream.flush()
    os._exit(INTERRUPTED)
