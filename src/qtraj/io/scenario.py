"""Scenarios, what a command is to do, as TOML files."""

import hashlib
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from pydantic import ValidationError

from qtraj.foundation.untrusted import decoded, parse_toml, read_bytes
from qtraj.io.scenario_fault import explain
from qtraj.io.scenario_kind import is_recording, misplaced, recorded
from qtraj.io.scenario_part import Part
from qtraj.io.scenario_syntax import syntax_fault

DATA = Path(__file__).parent / "data"
DEFAULT = DATA / "default.toml"
"""Embedded, for `tune`: a recorded right-angle turn that a longer vehicle is to drive, with standing passengers."""
TURN = DATA / "turn.toml"
"""Embedded, for `turn`: a quarter turn of a spacecraft within limits of rate and acceleration."""
TRACK = DATA / "track.toml"
"""Embedded, for `track`: the same turn, followed from a wrong attitude by the law of the second paper."""

HASH_DIGITS = 16

S = TypeVar("S", bound=Part)


@dataclass(frozen=True)
class ScenarioFile(Generic[S]):
    """A scenario with the file it stands in; `hash` is the SHA-256 of the file's bytes, 16 hexadecimal digits."""

    file: Path
    scenario: S
    hash: str

    def beside(self, name: str) -> Path:
        """The file of this name, relative to the scenario's own folder."""
        return self.file.parent / name


def read_scenario(file: Path | str, model: type[S]) -> ScenarioFile[S]:
    """The scenario of a kind, such as `scenario_model.Scenario`, in a TOML file.

    **Raises:** OSError where the file cannot be read; ValueError with one message that names the file and, for bad
    syntax, line and column, else the key, what it holds and what was expected, or for which command the file is.
    """
    path = Path(file)
    content = read_bytes(path)
    if is_recording(path):
        raise ValueError(f"{path}: {recorded(path, model)}")
    data = _parse(path, content, model)
    try:
        scenario = model.model_validate(data)
    except ValidationError as error:
        other = misplaced(data, model)
        raise ValueError(explain(path, error, model) if other is None else f"{path}: {other}") from None
    return ScenarioFile(path, scenario, content_hash(content))


def content_hash(content: bytes) -> str:
    """The first 16 hexadecimal digits of the SHA-256 of a file's bytes."""
    return hashlib.sha256(content).hexdigest()[:HASH_DIGITS]


def _parse(path: Path, content: bytes, model: type[Part]) -> dict[str, object]:
    text = decoded(path, content)
    try:
        return parse_toml(text)
    except tomllib.TOMLDecodeError as error:
        if is_recording(path, text):
            raise ValueError(f"{path}: {recorded(path, model)}") from None
        raise ValueError(f"{path}: not valid TOML: {syntax_fault(text, error)}") from None
    except ValueError as error:
        raise ValueError(f"{path}: not a scenario: {error}") from None
