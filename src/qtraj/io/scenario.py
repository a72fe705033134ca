"""Scenarios: a path, its limits and what tuning is to do, as a TOML file."""

import hashlib
import tomllib
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from qtraj.io.scenario_fault import explain
from qtraj.io.scenario_model import Scenario

DEFAULT = Path(__file__).parent / "data" / "default.toml"
"""The embedded scenario: a recorded right-angle turn that a longer vehicle is to drive, with standing passengers."""

HASH_DIGITS = 16


@dataclass(frozen=True)
class ScenarioFile:
    """A scenario with the file it stands in; `hash` is the SHA-256 of the file's bytes, 16 hexadecimal digits."""

    file: Path
    scenario: Scenario
    hash: str

    def beside(self, name: str) -> Path:
        """The file of this name, relative to the scenario's own folder."""
        return self.file.parent / name


def read_scenario(file: Path | str) -> ScenarioFile:
    """The scenario in a TOML file.

    **Raises:** OSError where the file cannot be read; ValueError with one message that names the file and, for bad
    syntax, line and column, else the key, what it holds and what was expected.
    """
    path = Path(file)
    content = path.read_bytes()
    data = _parse(path, content)
    try:
        scenario = Scenario.model_validate(data)
    except ValidationError as error:
        raise ValueError(explain(path, error)) from None
    return ScenarioFile(path, scenario, content_hash(content))


def content_hash(content: bytes) -> str:
    """The first 16 hexadecimal digits of the SHA-256 of a file's bytes."""
    return hashlib.sha256(content).hexdigest()[:HASH_DIGITS]


def _parse(path: Path, content: bytes) -> dict[str, object]:
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: not a text file in UTF-8 (byte {error.start})") from None
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError(f"{path}: not a scenario: its tables or arrays are nested too deep") from None
    except tomllib.TOMLDecodeError as error:
        lines = text.splitlines() or [""]
        end = f"at line {len(lines)}, column {len(lines[-1]) + 1}, the end of the file"
        message = str(error).replace("at end of document", end)
        raise ValueError(f"{path}: not valid TOML: {message}") from None
