"""Read the input file of a command, and determine what the file contains."""

import hashlib
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from qtraj.foundation.toml_fault import syntax_fault
from qtraj.foundation.untrusted import decoded, parse_json, parse_toml, read_bytes
from qtraj.io.track.other_formats import require_known_format
from qtraj.io.track.recording import is_recording

HASH_DIGITS = 16
OTHER = ". If the file is a recording, export it as a table (CSV) or as GPX"
"""The last sentence of the message about a file that is neither a scenario nor a recording."""

RECORDING_START = 2**16
"""Number of bytes at the start of a file by which a recording is recognised."""


@dataclass(frozen=True)
class InputFile:
    """The content of a file, which is a scenario, a saved object or a recording.

    `hash`: the first 16 hexadecimal digits of the SHA-256 of the file's bytes. `data`: the parsed document; for a
    recording, a scenario with this recording.
    """

    file: Path
    hash: str
    data: dict[str, Any]
    is_recording: bool = False

    @property
    def is_saved(self) -> bool:
        """Whether the file contains a saved object."""
        return "format" in self.data and "type" in self.data


def read_input(file: Path) -> InputFile:
    """Read a file; if it is not a recording, parse its TOML or JSON.

    **Raises:** OSError if the file cannot be read; ValueError, which names the file, for a syntax error.
    """
    content = read_bytes(file)
    recording = is_recording(file, content[:RECORDING_START])
    if not recording and file.suffix != ".json":  # a saved object is JSON
        require_known_format(file, content)
    data = {"track": {"file": file.name}} if recording else _parsed(file, _text(file, content))
    return InputFile(file, hashlib.sha256(content).hexdigest()[:HASH_DIGITS], data, recording)


def with_track(given: InputFile, track: Mapping[str, Any]) -> InputFile:
    """Return the input with these keys in its table [track].

    **Raises:** ValueError if there are keys, but the input has no recording.
    """
    if not track:
        return given
    own = given.data.get("track")
    if given.is_saved or not isinstance(own, dict):
        raise ValueError(
            f"{given.file}: --{next(iter(track))} applies to recordings, but this file has no table [track]: omit the "
            "option"
        )
    return replace(given, data=given.data | {"track": own | dict(track)})


def _text(file: Path, content: bytes) -> str:
    try:
        return decoded(file, content)
    except ValueError as error:
        raise ValueError(f"{error}{OTHER}") from None


def _parsed(file: Path, text: str) -> dict[str, Any]:
    is_json = file.suffix == ".json"
    try:
        data = parse_json(text) if is_json else parse_toml(text)
    except tomllib.TOMLDecodeError as error:
        other = "" if file.suffix == ".toml" else OTHER
        raise ValueError(f"{file}: not valid TOML: {syntax_fault(text, error)}{other}") from None
    except ValueError as error:
        raise ValueError(f"{file}: not {'valid JSON' if is_json else 'a scenario'}: {error}") from None
    if is_json and not (isinstance(data, dict) and "format" in data):
        raise ValueError(
            f"{file}: not a saved object, because the key 'format' is missing; a scenario must be a TOML file{OTHER}"
        )
    return data
