"""The entry point of the command line: what must happen before anything else is imported."""

import atexit
import gc
import importlib.util
import sys

NEEDED = ("typer", "rich", "pydantic", "xarray", "h5netcdf", "matplotlib")
"""What the command line needs beyond the core of qtraj."""

SELDOM = (100_000, 20, 100)
"""Thresholds of Python's garbage collector, which by default takes a tenth of a run to find modules and programs."""


def _command() -> str | None:
    """The command given; None where only help is wanted."""
    first = next((word for word in sys.argv[1:] if not word.startswith("-")), "")
    return first if first.isidentifier() and not {"-h", "--help"} & set(sys.argv) else None


def main() -> None:
    """Run the command line; exit with 2, saying what to install, where a package is missing."""
    missing = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        sys.stderr.write(
            f"error: the command line needs {', '.join(missing)}, which this environment lacks. "
            "Install it with: pip install 'qtraj[all]'\n"
        )
        sys.exit(2)
    gc.set_threshold(*SELDOM)
    atexit.register(gc.freeze)  # a process that ends need not search for garbage once more
    try:
        from qtraj.cli.session import prepare
        from qtraj.foundation.exported.kept import ahead

        prepare()
        with ahead(_command()):
            from qtraj.cli.app import app

            app(prog_name="qtraj")
    except KeyboardInterrupt:  # before a command has begun, which sees to it itself
        sys.stderr.write("interrupted\n")
        sys.exit(130)
