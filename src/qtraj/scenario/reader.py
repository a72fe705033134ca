"""Read scenario files; an error is one message with the file, the key, its value, and the expected value."""

import copy
import difflib
import hashlib
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Generic, NamedTuple, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from qtraj.foundation.toml_fault import quoted, syntax_fault
from qtraj.foundation.untrusted import decoded, parse_json, parse_toml, read_bytes
from qtraj.io.recording import is_recording
from qtraj.scenario import KINDS

HASH_DIGITS = 16
LIKE = 0.7
"""Minimum similarity, from 0 to 1, of a suggested key; 'duration' and 'acceleration' have a similarity of 0.6."""

RECORDING_START = 2**16
"""Number of bytes at the start of a file by which a recording is recognised."""

S = TypeVar("S", bound=BaseModel)


@dataclass(frozen=True)
class ScenarioFile(Generic[S]):
    """A scenario and its file.

    `hash`: the first 16 hexadecimal digits of the SHA-256 of the file's bytes. `warnings`: messages about renamed keys.
    """

    file: Path
    scenario: S
    hash: str
    warnings: tuple[str, ...] = ()

    def beside(self, name: str) -> Path:
        """Return the path of the file with this name, relative to the folder of the scenario."""
        return self.file.parent / name

    def about(self) -> dict[str, str | None]:
        """Return file and hash of the scenario, its name and description, and the source of its recording."""
        names = {name: getattr(self.scenario, name, None) for name in ("name", "description")}
        names["source"] = getattr(getattr(self.scenario, "track", None), "source", None)
        return {"file": str(self.file), "sha256": self.hash} | {k: v and v.strip() for k, v in names.items()}

    def provenance(self) -> dict[str, str]:
        """Return the attributes of a dataset that describe its origin."""
        about = self.about()
        facts = {"title": about["name"], "recording": about["source"], "scenario_sha256": about["sha256"]}
        return {name: text for name, text in facts.items() if text} | {"scenario_file": self.file.name}


@dataclass(frozen=True)
class InputFile:
    """The content of a file, which is a scenario, a saved object or a recording.

    `data`: the parsed document; for a recording, a scenario with this recording. `hash`: as in `ScenarioFile`.
    """

    file: Path
    hash: str
    data: dict[str, Any]
    is_recording: bool = False

    @property
    def is_saved(self) -> bool:
        """Whether the file contains a saved object."""
        return "format" in self.data and "type" in self.data

    def without_scenario(self) -> ScenarioFile[Any]:
        """Return the file of a saved object."""
        return ScenarioFile(self.file, None, self.hash)

    def scenario(
        self,
        kind: str,
        limits: Mapping[str, float] = MappingProxyType({}),
        recording: bool = False,
        others: Iterable[str] = KINDS,
    ) -> ScenarioFile[Any]:
        """Return the file with its scenario; `limits` replace limits of the scenario, or are added to them.

        `kind`: the name of a kind in `qtraj.scenario.KINDS`. `recording`: whether a recording is allowed. `others`:
        other kinds, which an error message mentions if they have more of the keys.

        **Raises:** ValueError if the file is not a valid scenario of this kind: the message names the file and either
        the key with its value and the expected value, or the command that reads such a file.
        """
        entry = KINDS[kind]
        if self.is_saved or self.is_recording > recording:
            raise ValueError(f"{self.file}: {self._described()}")
        data = copy.deepcopy(self.data)
        renamed = {old: new for old, new in entry.renamed.items() if _rename(data, old.split("."), new)}
        if limits and isinstance(own := data.setdefault("limits", {}), dict):
            own |= limits
        try:
            scenario = entry.model.model_validate(data)
        except ValidationError as error:
            nearest = nearest_kind(data, (kind, *others))
            if nearest != kind:
                raise ValueError(f"{self.file}: this is a scenario for {KINDS[nearest].title}") from None
            text = explain(error, entry.model)
            for old, new in renamed.items():
                text = text.replace(new, old)  # show the names in the user's file
            raise ValueError(f"{self.file}: {text}") from None
        warnings = (f"{self.file}: '{old}' is now '{new}'" for old, new in renamed.items())
        return ScenarioFile(self.file, scenario, self.hash, tuple(warnings))

    def _described(self) -> str:
        """Return the message for a recording or a saved object that was passed instead of a scenario."""
        name = self.file.name
        if self.is_recording:
            return (
                "this is a recording, not a scenario: `qtraj route` and `qtraj retime` read recordings; for other "
                f'commands, write a .toml file with file = "{name}" under [track], and with [limits]'
            )
        return (
            f"this is a saved {self.data['type']}, not a scenario: `qtraj evaluate` and `qtraj retime` read saved "
            f"paths; to tune a path, write a scenario with path = '{name}' and [limits]; to simulate a program, write "
            f"a scenario with file = '{name}' in [program]"
        )


def read_scenario(file: Path | str | None, kind: str) -> ScenarioFile[Any]:
    """Read the scenario in a file, or the built-in scenario of its kind if `file` is None.

    **Raises:** The errors of `read_input` and `InputFile.scenario`.
    """
    return read_input(KINDS[kind].embedded if file is None else Path(file)).scenario(kind)


def read_input(file: Path) -> InputFile:
    """Read a file and determine whether it is a recording; otherwise, parse its TOML or JSON.

    **Raises:** OSError if the file cannot be read; ValueError, which names the file, for a syntax error.
    """
    content = read_bytes(file)
    start = content[:RECORDING_START].decode(errors="replace")
    recording = is_recording(file, start)
    data = {"track": {"file": file.name}} if recording else _parsed(file, decoded(file, content))
    return InputFile(file, hashlib.sha256(content).hexdigest()[:HASH_DIGITS], data, recording)


def _rename(data: Any, old: Sequence[str], new: str) -> bool:
    """Rename a key within its table unless the new key exists too; return whether the key was renamed."""
    *tables, last = old
    new = new.rpartition(".")[2]
    for name in tables:
        data = data.get(name) if isinstance(data, dict) else None
    if not isinstance(data, dict) or last not in data or new in data:
        return False
    data[new] = data.pop(last)
    return True


def _parsed(file: Path, text: str) -> dict[str, Any]:
    is_json = file.suffix == ".json"
    try:
        data = parse_json(text) if is_json else parse_toml(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{file}: not valid TOML: {syntax_fault(text, error)}") from None
    except ValueError as error:
        raise ValueError(f"{file}: not {'valid JSON' if is_json else 'a scenario'}: {error}") from None
    if is_json and not (isinstance(data, dict) and "format" in data):
        raise ValueError(
            f"{file}: not a saved object, which has the keys 'format' and 'type'; scenarios are TOML files"
        )
    return data


def nearest_kind(data: Mapping[str, Any], kinds: Iterable[str]) -> str:
    """Return the kind of scenario with the fewest unknown keys in `data`; the first such kind if there are several."""
    return min(kinds, key=lambda kind: _count_unknown(data, KINDS[kind].model))


def _count_unknown(data: Mapping[str, Any], model: type[BaseModel]) -> int:
    try:
        model.model_validate(data)
    except ValidationError as error:
        return sum(fault["type"] == "extra_forbidden" for fault in error.errors(include_url=False))
    return 0


class Place(NamedTuple):
    """The place of a fault: the keys, the model of the table with the last key, and the valid values of this key.

    `entry`: the indices of a faulty entry in the value of the last key.
    """

    keys: tuple[int | str, ...]
    table: type[BaseModel]
    expected: str
    entry: tuple[int, ...] = ()

    def __str__(self) -> str:
        text = ""
        for step in self.keys + self.entry:
            text += f"[{step}]" if isinstance(step, int) else f".{step}" if text else step
        return text


def explain(error: ValidationError, root: type[BaseModel]) -> str:
    """Return the message for a validation error of a `root` model: the first error and a count of other faulty keys."""
    faults = error.errors(include_url=False)
    first = min(faults, key=lambda fault: fault["type"] == "missing")  # report a misspelt key before a missing key
    keys = {_place(fault["loc"], root).keys for fault in faults}
    more = f" (and {len(keys) - 1} more)" if len(keys) > 1 else ""
    return f"{_fault(dict(first), root)}{more}"


def _fault(fault: dict[str, Any], root: type[BaseModel]) -> str:
    place = _place(fault["loc"], root)
    if fault["type"] == "extra_forbidden":
        return f"unknown key '{place}'; {_hint(str(place.keys[-1]), list(place.table.model_fields))}"
    if fault["type"] == "value_error":
        text = str(fault["ctx"]["error"])
        return f"[{place}]: {text}" if place.keys else text
    if fault["type"] == "missing":
        return f"the key '{place}' is missing: expected {place.expected}"
    return f"the key '{place}' has the value {quoted(fault['input'])}: expected {place.expected}"


def _hint(name: str, keys: Sequence[str]) -> str:
    """Return a suggestion for the unknown key `name` in a table with other `keys`."""
    begun = [key for key in keys if key.startswith(name)]  # the user may have shortened or misspelt the key
    near = difflib.get_close_matches(name, begun or keys, n=1, cutoff=0.0 if begun else LIKE)
    return f"did you mean '{near[0]}'?" if near else f"the known keys are {', '.join(keys)}"


def _place(location: Sequence[int | str], root: type[BaseModel]) -> Place:
    """Return the place at a location, without the steps added by pydantic, such as the member of a union or '[key]'."""
    place, model = Place((), root, "another value"), root
    for step in location:
        if isinstance(step, int) and model is None:
            place = place._replace(entry=(*place.entry, step))
        elif isinstance(step, int):
            place = place._replace(keys=(*place.keys, step))
        elif model is not None:
            field = model.model_fields.get(step)
            place = Place((*place.keys, step), model, (field and field.description) or place.expected)
            model = _table(model, step)
        elif place.keys[-1] in ("columns", "purpose", "bounds") and step != "[key]":
            place = place._replace(keys=(*place.keys, step))
    return place


def _table(model: type[BaseModel], key: int | str) -> type[BaseModel] | None:
    """Return the model of the table at a key, or of each table if the key is an array; None if it is a plain value."""
    field = model.model_fields.get(str(key))
    if field is None:
        return None
    choices = [field.annotation, *get_args(field.annotation)]
    choices += [inner for choice in choices for inner in get_args(choice)]
    return next((c for c in choices if isinstance(c, type) and issubclass(c, BaseModel)), None)
