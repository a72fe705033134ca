"""Explain why a document does not match its pydantic model: the key, its value, and the expected value.

The valid values of a key are the `description` of its field in the model.
"""

import re
from collections.abc import Sequence
from typing import Any, NamedTuple, get_args, get_origin

from pydantic import BaseModel, ValidationError

from qtraj.foundation.suggestion import suggestion
from qtraj.foundation.toml_fault import quoted


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


def unknown_keys(error: ValidationError) -> int:
    """Return the number of keys that the model does not have."""
    return sum(fault["type"] == "extra_forbidden" for fault in error.errors(include_url=False))


def _fault(fault: dict[str, Any], root: type[BaseModel]) -> str:
    place = _place(fault["loc"], root)
    if fault["type"] == "extra_forbidden":
        return f"unknown key '{place}'; {suggestion(str(place.keys[-1]), list(place.table.model_fields))}"
    if fault["type"] == "literal_error" and fault["loc"][-1] == "[key]":
        known = re.findall(r"'([^']*)'", fault["ctx"]["expected"])
        return f"unknown key '{place}'; {suggestion(str(place.keys[-1]), known)}"
    if fault["type"] == "value_error":
        text = str(fault["ctx"]["error"])
        if not isinstance(fault["input"], dict):
            return f"the key '{place}': {text}"
        return f"[{place}]: {text}" if place.keys else text
    if fault["type"] == "missing":
        return f"the key '{place}' is missing: expected {place.expected}"
    return f"the key '{place}' has the value {quoted(fault['input'])}: expected {place.expected}"


def _place(location: Sequence[int | str], root: type[BaseModel]) -> Place:
    """Convert a location in pydantic's error to a place, without pydantic's own steps (union members, '[key]')."""
    place, model, entries = Place((), root, "another value"), root, False
    for step in location:
        if isinstance(step, int) and model is None:
            place = place._replace(entry=(*place.entry, step))
        elif isinstance(step, int):
            place = place._replace(keys=(*place.keys, step))
        elif model is not None:
            field = model.model_fields.get(step)
            place = Place((*place.keys, step), model, (field and field.description) or place.expected)
            choices = () if field is None else _choices(field.annotation)
            model = next((c for c in choices if isinstance(c, type) and issubclass(c, BaseModel)), None)
            entries = any(get_origin(choice) is dict for choice in choices)
        elif entries and step != "[key]":
            place, entries = place._replace(keys=(*place.keys, step)), False
    return place


def _choices(annotation: Any) -> list[Any]:
    """Return a type, its type arguments (members of a union, elements of a list), and the arguments of these types."""
    choices = [annotation, *get_args(annotation)]
    return choices + [inner for choice in choices for inner in get_args(choice)]
