"""Read scenario files; an error is one message with the file, the key, its value, and the expected value."""

import difflib
import hashlib
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from qtraj.foundation.toml_fault import quoted, syntax_fault
from qtraj.foundation.untrusted import decoded, parse_toml, read_bytes
from qtraj.io.recording import is_recording
from qtraj.scenario import KINDS, Kind

HASH_DIGITS = 16
LIKE = 0.7
"""Minimum similarity, from 0 to 1, of a suggested key; 'duration' and 'acceleration' have a similarity of 0.6."""

PATHS = ("track", "start", "path")
"""Keys of which a path scenario contains at least one, although each of them is optional."""

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


def read_scenario(file: Path | str | None, kind: str) -> ScenarioFile[Any]:
    """Read the scenario in a TOML file, or the built-in scenario if `file` is None.

    `kind`: the name of a kind in `qtraj.scenario.KINDS`.

    **Raises:** OSError if the file cannot be read. ValueError if the file is not a valid scenario of this kind: the
    message names the file and either the line and column of a syntax error, or the key with its value and the expected
    value, or the command that reads such a file.
    """
    entry = KINDS[kind]
    path = entry.embedded if file is None else Path(file)
    content = read_bytes(path)
    if is_recording(path):
        raise ValueError(f"{path}: {_recorded(path, entry)}")
    data = _parse(path, content, entry)
    renamed = {old: new for old, new in entry.renamed.items() if _rename(data, old.split("."), new)}
    try:
        scenario = entry.model.model_validate(data)
    except ValidationError as error:
        text = _misplaced(data, entry) or explain(error, entry.model)
        for old, new in renamed.items():
            text = text.replace(new, old)  # show the names in the user's file
        raise ValueError(f"{path}: {text}") from None
    warnings = (f"{path}: '{old}' is now '{new}'" for old, new in renamed.items())
    return ScenarioFile(path, scenario, content_hash(content), tuple(warnings))


def saved_file(file: Path) -> ScenarioFile[Any]:
    """Return a saved document as a file without a scenario."""
    return ScenarioFile(file, None, content_hash(read_bytes(file)))


def content_hash(content: bytes) -> str:
    """Return the first 16 hexadecimal digits of the SHA-256 of a file's bytes."""
    return hashlib.sha256(content).hexdigest()[:HASH_DIGITS]


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


def _parse(path: Path, content: bytes, kind: Kind) -> dict[str, Any]:
    text = decoded(path, content)
    try:
        return parse_toml(text)
    except tomllib.TOMLDecodeError as error:
        if is_recording(path, text):
            raise ValueError(f"{path}: {_recorded(path, kind)}") from None
        raise ValueError(f"{path}: not valid TOML: {syntax_fault(text, error)}") from None
    except ValueError as error:
        raise ValueError(f"{path}: not a scenario: {error}") from None


def _misplaced(data: Mapping[str, Any], kind: Kind) -> str | None:
    """Return the message for a file that is a saved object or a scenario of another kind, otherwise None."""
    if "format" in data and "type" in data:
        return (
            f"this is a saved {data['type']}, not a scenario: for a saved program, use `qtraj simulate` with file = "
            "'its name' in [program]; for a saved path, use `qtraj evaluate`"
        )
    fitting = [other for other in KINDS.values() if _fits(data, other)]
    return None if kind in fitting or not fitting else f"this is a scenario for {fitting[0].title}"


def _fits(data: Mapping[str, Any], kind: Kind) -> bool:
    fields = kind.model.model_fields
    needed = {name for name, field in fields.items() if field.is_required()}
    whole = kind is not KINDS["path"] or any(name in data for name in PATHS)
    return whole and needed <= data.keys() <= fields.keys()


def _recorded(file: Path, kind: Kind) -> str:
    """Return the message for a recording that was passed instead of a scenario of this kind."""
    what, table = "this is a recording, not a scenario", f'file = "{file.name}" under [track]'
    if kind is KINDS["path"]:
        return f"{what}: write a .toml file with {table}, and with [limits]; `qtraj route` reads a whole recording"
    return f"{what}: to use it with {KINDS['path'].title}, write a .toml file with {table}"


class Place(NamedTuple):
    """The place of a fault: the keys, the model of the table with the last key, and the valid values of this key."""

    keys: Sequence[int | str]
    table: type[BaseModel]
    expected: str

    def __str__(self) -> str:
        text = ""
        for step in self.keys:
            text += f"[{step}]" if isinstance(step, int) else f".{step}" if text else step
        return text


def explain(error: ValidationError, root: type[BaseModel]) -> str:
    """Return the message for a validation error of a `root` model: the first error and a count of other faulty keys."""
    faults = error.errors(include_url=False)
    first = min(faults, key=lambda fault: fault["type"] == "missing")  # report a misspelt key before a missing key
    keys = {str(_place(fault["loc"], root)) for fault in faults}
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
        if isinstance(step, int):
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
