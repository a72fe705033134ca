"""Define the entry point of the command line: check packages, change settings, and list the commands."""

import atexit
import functools
import gc
import importlib.util
import io
import logging
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any, NoReturn

from qtraj._version import __version__
from qtraj.cli import BAD_INPUT, INTERRUPTED
from qtraj.cli.interrupts import keep_interrupts

if TYPE_CHECKING:
    import typer

ABOUT = """Compute paths, slews and closed-loop motion of vehicles from boundary states, recordings and limits.

The exit code is 0 for success, 1 for violated limits or no convergence, and 2 for invalid input.

Results are also written if the exit code is 1.
"""

EXAMPLES = (
    "qtraj tune  (runs the built-in scenario, writes qtraj-out)",
    "qtraj report  (writes an HTML report of the results in qtraj-out)",
    "qtraj --install-completion  (installs tab completion)",
)
"""Examples in the help of the application."""

COMMANDS = ("tune", "evaluate", "route", "retime", "slew", "simulate", "sweep", "atlas", "report")
"""The commands; each command is a function in the module of the same name."""

OLD_NAMES = {"slew": "turn", "simulate": "track"}
"""The old names of commands, which are hidden aliases."""

NEEDED = ("typer", "rich", "pydantic", "xarray", "h5netcdf", "matplotlib", "plotly")
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
    from qtraj.cli.console import printing  # imported here, because it needs rich

    gc.set_threshold(*GC_THRESHOLDS)
    atexit.register(gc.freeze)  # no garbage collection at the end of the process
    keep_interrupts()
    try:
        prepare()
        with printing():
            application()(prog_name="qtraj")  # after the settings, because the imports of commands may run computations
    except KeyboardInterrupt:  # before a command starts; commands handle interrupts themselves
        sys.stderr.write("interrupted\n")
        _leave()
    except SystemExit as end:
        if end.code == INTERRUPTED:
            _leave()
        raise


@functools.cache
def application() -> "typer.Typer":
    """Return the application with all commands, with hidden aliases for the old names of commands."""
    import typer

    app = typer.Typer(
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )

    def print_version(requested: bool) -> bool:
        if requested:
            typer.echo(f"qtraj {__version__}")
            raise typer.Exit
        return requested

    shown = typer.Option(False, "--version", callback=print_version, is_eager=True, help="Print the version.")

    @app.callback(**_help(ABOUT, EXAMPLES))
    def root(version: bool = shown) -> None: ...

    for name in COMMANDS:
        command = getattr(importlib.import_module(f"qtraj.cli.{name}"), name)
        options = _help(command.__doc__, command.examples)
        app.command(name, **options)(command)
        if old_name := OLD_NAMES.get(name):
            app.command(old_name, hidden=True, **options)(_renamed(command, old_name))
    return app


def _renamed(command: Callable[..., None], old: str) -> Callable[..., None]:
    """Return the command with a warning about its `old` name."""
    from qtraj.cli.console import message
    from qtraj.cli.terminal import UNTIL

    @functools.wraps(command)
    def renamed(*args: object, **options: object) -> None:
        message("warning", f"`qtraj {old}` is now `qtraj {command.__name__}`; {UNTIL}")
        command(*args, **options)

    return renamed


def _help(docstring: str | None, examples: Sequence[str]) -> dict[str, Any]:
    """Return the help of a command, with each paragraph on one line, which the terminal wraps, and its examples."""
    paragraphs = (" ".join(paragraph.split()) for paragraph in (docstring or "").split("\n\n"))
    return {"help": "\n\n".join(paragraphs), "epilog": "\n\n".join(["Examples:", *examples])}


def prepare() -> None:
    """Enable float64 and the compilation cache, and suppress the warnings of other packages."""
    import jax

    jax.config.update("jax_enable_x64", True)
    if not os.environ.get("JAX_PLATFORMS"):
        jax.config.update("jax_platforms", "cpu")  # problems are small, sequential and in float64
    _enable_cache(jax.config.jax_enable_compilation_cache)  # type: ignore[attr-defined]
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
