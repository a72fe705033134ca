"""What is wrong with a scenario file, in one message: file, key, what was given and what was expected."""

import difflib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

LONGEST = 60
"""A value given is quoted up to so many characters."""
LIKE = 0.7
"""Keys less alike than this, from 0 to 1, are not taken for one another: 'duration' is no 'acceleration' (0.6)."""

Location = Sequence[int | str]


def explain(file: Path | str, error: ValidationError, root: type[BaseModel]) -> str:
    """The first fault that pydantic found in a `root`, in the words of this project, and how many more there are."""
    faults = error.errors(include_url=False)
    first = min(faults, key=lambda fault: fault["type"] == "missing")  # a misspelt key before the key that it misses
    keys = {_dotted(_within(fault["loc"], root)) for fault in faults}
    more = f" (and {len(keys) - 1} more)" if len(keys) > 1 else ""
    return f"{file}: {_fault(dict(first), root)}{more}"


def _fault(fault: dict[str, Any], root: type[BaseModel]) -> str:
    where = _within(fault["loc"], root)
    if fault["type"] == "extra_forbidden":
        return _unknown(where, root)
    if fault["type"] == "value_error":
        text = str(fault["ctx"]["error"])
        return f"[{_dotted(where)}]: {text}" if where else text
    expected = _expected(where, root)
    if fault["type"] == "missing":
        return f"the key '{_dotted(where)}' is missing: expected {expected}"
    return f"the key '{_dotted(where)}' holds {quoted(fault['input'])}, but expected {expected}"


def _unknown(where: Location, root: type[BaseModel]) -> str:
    known = list(_model(where[:-1], root).model_fields)
    near = _near(str(where[-1]), known)
    hint = f"known here: {', '.join(known)}" if near is None else f"did you mean '{near}'?"
    return f"unknown key '{_dotted(where)}'; {hint}"


def _near(name: str, known: Sequence[str]) -> str | None:
    """The key that was probably meant: one that begins so, else one of similar letters."""
    begun = [key for key in known if key.startswith(name)]
    near = difflib.get_close_matches(name, begun or known, n=1, cutoff=0.0 if begun else LIKE)
    return near[0] if near else None


def _within(location: Location, root: type[BaseModel]) -> Location:
    """A location without pydantic's own marks, such as the member of a union or '[key]'."""
    model: type[BaseModel] | None = root
    kept: list[int | str] = []
    for step in location:
        if isinstance(step, int):
            kept.append(step)
        elif model is not None:
            kept.append(step)
            model = _table(model, step)
        elif kept[-1] in ("columns", "purpose", "bounds") and step != "[key]":
            kept.append(step)
    return kept


def _dotted(location: Location) -> str:
    text = ""
    for step in location:
        text += f"[{step}]" if isinstance(step, int) else f".{step}" if text else step
    return text


def _model(location: Location, root: type[BaseModel]) -> type[BaseModel]:
    model = root
    for step in location:
        model = _table(model, step) or model
    return model


def _table(model: type[BaseModel], key: int | str) -> type[BaseModel] | None:
    """The model of the table, or of each table of the array, under a key; None for a plain value."""
    field = model.model_fields.get(str(key))
    if field is None:
        return None
    choices = [field.annotation, *get_args(field.annotation)]
    choices += [inner for choice in choices for inner in get_args(choice)]
    return next((c for c in choices if isinstance(c, type) and issubclass(c, BaseModel)), None)


def _expected(location: Location, root: type[BaseModel]) -> str:
    """The description of the key at a location, or of the nearest key above it."""
    model = root
    description = "another value"
    for step in location:
        if isinstance(step, int):
            continue
        field = model.model_fields.get(step)
        if field is None:
            break
        description = field.description or description
        inner = _table(model, step)
        if inner is None:
            break  # what stands below a plain value, as in [tune.bounds], may have the name of a key beside it
        model = inner
    return description


def quoted(value: Any) -> str:
    """A value as Python writes it, cut where it is long."""
    text = repr(value)
    return text if len(text) <= LONGEST else text[: LONGEST - 1] + "…"
