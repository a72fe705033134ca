"""Define the options of commands that read a recording; they replace keys of the table [track] of a scenario."""

import inspect
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import typer

PANEL = "How the recording is read"
"""The title of these options in the help."""

COLUMNS, UNITS = "NAME=COLUMN[,COLUMN…]", "NAME=UNIT"


def _option(metavar: str, text: str) -> Any:
    return typer.Option(None, metavar=metavar, help=text, rich_help_panel=PANEL)


OPTIONS: dict[str, tuple[Any, Any]] = {
    "columns": (
        list[str] | None,
        _option(
            COLUMNS, "Columns of time, position, velocity, attitude or rate, such as position=e,n,u. May be repeated."
        ),
    ),
    "units": (
        list[str] | None,
        _option(UNITS, "Units of time, position, velocity or rate, such as velocity=km/h. May be repeated."),
    ),
    "axes": (str | None, _option("AXES", "World axes: enu (z up), ned or camera.")),
    "rate": (float | None, _option("HZ", "Samples per second of a file without times.")),
    "times": (Path | None, _option("FILE", "A file with one time on a line, for a file without times.")),
    "duplicates": (str | None, _option("ROWS", "Which rows at one time count: first, last or mean.")),
    "quaternion": (str | None, _option("ORDER", "Order of quaternions whose names do not tell it: wxyz or xyzw.")),
    "segment": (int | None, _option("N", "Segment of a recording whose clock jumps back, or of a GPX file.")),
}
"""The type and the option of each key of [track]."""


def track_parameters() -> list[inspect.Parameter]:
    """Return the parameters of a command for these options."""
    return [
        inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD, default=option, annotation=kind)
        for name, (kind, option) in OPTIONS.items()
    ]


def collected(options: dict[str, Any]) -> dict[str, Any]:
    """Remove these options from the options of a command, and return those that were given as keys of [track].

    **Raises:** ValueError for an option that is not of the form NAME=VALUE.
    """
    given = {name: options.pop(name) for name in OPTIONS}
    given = {name: value for name, value in given.items() if value not in (None, [])}
    if "columns" in given:
        given["columns"] = {name: _names(text) for name, text in _pairs("columns", COLUMNS, given["columns"])}
    if "units" in given:
        given["units"] = dict(_pairs("units", UNITS, given["units"]))
    if "times" in given:
        given["times"] = str(given["times"].absolute())
    return given


def as_options(text: str) -> str:
    """Return a text for users of Python with its arguments as options of the command line."""
    text = re.sub(r"""units=\{"(\w+)": "?([^"}]+)"?\}""", r"--units \1=\2", text)
    return re.sub(r"\b(axes|quaternion|duplicates)='(\w+)'", r"--\1 \2", text)


def _pairs(option: str, form: str, texts: Sequence[str]) -> list[tuple[str, str]]:
    for text in texts:
        if not text.partition("=")[0].strip() or "=" not in text:
            raise ValueError(f"--{option} needs {form}, but {text!r} was given")
    return [(name.strip(), value.strip()) for name, _, value in (text.partition("=") for text in texts)]


def _names(text: str) -> list[str]:
    """Return the names between commas; an empty text omits the quantity."""
    return [name.strip() for name in text.split(",") if name.strip()]
