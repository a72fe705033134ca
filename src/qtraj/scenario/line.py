"""Read curves without times as the input of `qtraj retime`: files of points, and saved shapes."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from qtraj.design.limits import Limits
from qtraj.foundation.untrusted import read_bytes
from qtraj.io.input_file import HASH_DIGITS, read_input
from qtraj.io.shape.shape_file import ShapeRead, read_line
from qtraj.io.shape.untimed import is_untimed
from qtraj.io.track.limit_columns import LimitColumn
from qtraj.path.quantity import quantity
from qtraj.path.shape import Shape
from qtraj.scenario.reader import ScenarioFile

OPTIONS = ("columns", "units", "axes", "segment")
"""Options of recordings that apply to curves without times, too."""


def line_in(file: Path, options: Mapping[str, Any]) -> ScenarioFile[None] | None:
    """Return the curve without times in a file, or None if the file contains something else.

    `options`: the user's options of a recording.

    **Raises:** OSError if the file cannot be read; ValueError, which names the file, for a curve that is not valid, or
    an option that applies only to recordings.
    """
    if is_untimed(file, options):
        if wrong := [name for name in options if name not in OPTIONS]:
            raise ValueError(
                f"{file}: --{wrong[0]} applies to recordings, but this file contains points without times: omit the "
                "option, or pass --rate or --times"
            )
        found = read_line(file, **options)
    elif file.suffix in (".json", ".toml") and read_input(file).data.get("type") == Shape.__name__:
        from qtraj.io.stored import load  # imported here, because `stored` imports all classes that can be stored

        shape = load(file)
        found = ShapeRead(shape, (f"saved shape: {str(shape).removeprefix('Shape(').removesuffix(')')}",))
    else:
        return None
    key = hashlib.sha256(read_bytes(file)).hexdigest()[:HASH_DIGITS]
    return ScenarioFile(file, None, key, line=found)


def limits_of_line(limits: Mapping[str, Any]) -> Limits:
    """Return the limits of the command line; a curve without times has no vehicle.

    **Raises:** ValueError for a limit that needs a vehicle.
    """
    if needs := [name for name in limits if quantity(name).needs]:
        raise ValueError(
            f"a limit on {needs[0]} needs a vehicle, which a file of points does not have: limit lateral_acceleration "
            "and longitudinal_acceleration instead, or call qtraj.retime in Python with Limits(..., vehicle=...)"
        )
    require_no_columns(limits, "a file of points")
    return Limits(**limits, vehicle=None)


def require_no_columns(limits: Mapping[str, Any], what: str) -> None:
    """Raise a ValueError for a limit in a column of a recording, because `what` is no recording."""
    for name, limit in limits.items():
        if isinstance(limit, LimitColumn):
            raise ValueError(
                f"--limit {name}=column:{limit.column} needs a recording, but {what} was given: write steps, such as "
                f"--limit {name}=VALUE,VALUE@DISTANCE"
            )
