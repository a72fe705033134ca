"""Which command a file belongs to, where it was given to another."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from qtraj.io.scenario_model import Scenario
from qtraj.io.scenario_part import Part
from qtraj.io.tracking_model import TrackingScenario
from qtraj.io.turn_model import TurnScenario

COMMANDS: dict[type[Part], str] = {
    Scenario: "`qtraj tune` and `qtraj evaluate`",
    TurnScenario: "`qtraj turn`",
    TrackingScenario: "`qtraj track`",
}
RECORDINGS = (".csv", ".tsv", ".tum")
"""How the names of recordings end; others, such as .txt, may be recordings by what they hold."""
FEWEST_COLUMNS = 4
"""Of a recording: a time and a position."""
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
PATHS = ("track", "start", "path")
"""A path scenario has one of these; no key of it must be there."""


def misplaced(data: Mapping[str, Any], model: type[Part]) -> str | None:
    """What a file is, and who reads it, where its first level shows that it is no scenario of this kind; else None."""
    if "format" in data and "type" in data:
        return (
            f"this is a saved {data['type']}, not a scenario: `qtraj track` follows a saved program, with file = "
            "'its name' in [program]; `qtraj evaluate` tabulates a saved path"
        )
    fitting = [other for other in COMMANDS if _fits(data, other)]
    if model in fitting or not fitting:
        return None
    return f"this is a scenario of {COMMANDS[fitting[0]]}"


def is_recording(file: Path, text: str = "") -> bool:
    """Whether a file is a recording by its name, or by its text: rows of numbers, with or without a header."""
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    rows = bool(lines) and "=" not in lines[0] and any(map(_is_row, lines[:2]))
    return file.suffix.lower() in RECORDINGS or rows


def recorded(file: Path, model: type[Part]) -> str:
    """What to do with a recording that was given in place of a scenario of this kind."""
    what, table = "this is a recording, not a scenario", f'file = "{file.name}" under [track]'
    if model is Scenario:
        return f"{what}: write a .toml file with {table}, and with [limits]"
    return f"{what}: {COMMANDS[Scenario]} read one, from a .toml file with {table}"


def _is_row(line: str) -> bool:
    cells = re.split(r"[,;\s]+", line.strip())
    return len(cells) >= FEWEST_COLUMNS and all(map(NUMBER.fullmatch, cells))


def _fits(data: Mapping[str, Any], model: type[Part]) -> bool:
    needed = {name for name, field in model.model_fields.items() if field.is_required()}
    whole = any(name in data for name in PATHS) if model is Scenario else True
    return whole and needed <= data.keys() <= model.model_fields.keys()
