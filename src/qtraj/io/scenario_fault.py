"""What is wrong with a scenario file, in one message: file, key, what was given and what was expected."""

import difflib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from qtraj.io.scenario_model import Scenario

LONGEST = 60
"""A value given is quoted up to so many characters."""

Location = Sequence[int | str]


def explain(file: Path | str, error: ValidationError) -> str:
    """The first fault that pydantic found, in the words of this project, and how many more there are."""
    faults = error.errors(include_url=False)
    first = min(faults, key=lambda fault: fault["type"] == "missing")  # a misspelt key before the key that it misses
    keys = {_dotted(_within(fault["loc"])) for fault in faults}
    more = f" (and {len(keys) - 1} more)" if len(keys) > 1 else ""
    return f"{file}: {_fault(dict(first))}{more}"


def _fault(fault: dict[str, Any]) -> str:
    where = _within(fault["loc"])
    if fault["type"] == "extra_forbidden":
        return _unknown(where)
    if fault["type"] == "value_error":
        return str(fault["ctx"]["error"])
    expected = _expected(where)
    if fault["type"] == "missing":
        return f"the key '{_dotted(where)}' is missing: expected {expected}"
    return f"the key '{_dotted(where)}' holds {_quoted(fault['input'])}, but expected {expected}"


def _unknown(where: Location) -> str:
    known = list(_model(where[:-1]).model_fields)
    near = difflib.get_close_matches(str(where[-1]), known, n=1)
    hint = f"did you mean '{near[0]}'?" if near else f"known here: {', '.join(known)}"
    return f"unknown key '{_dotted(where)}'; {hint}"


def _within(location: Location) -> Location:
    """A location without pydantic's own marks, such as the member of a union or '[key]'."""
    model: type[BaseModel] | None = Scenario
    kept: list[int | str] = []
    for step in location:
        if model is not None:
            kept.append(step)
            model = _table(model, step)
        elif isinstance(step, int) or (kept[-1] in ("columns", "purpose") and step != "[key]"):
            kept.append(step)
    return kept


def _dotted(location: Location) -> str:
    text = ""
    for step in location:
        text += f"[{step}]" if isinstance(step, int) else f".{step}" if text else step
    return text


def _model(location: Location) -> type[BaseModel]:
    model: type[BaseModel] = Scenario
    for step in location:
        model = _table(model, step) or model
    return model


def _table(model: type[BaseModel], key: int | str) -> type[BaseModel] | None:
    """The model of the table under a key; None for a plain value."""
    field = model.model_fields.get(str(key))
    if field is None:
        return None
    choices = [field.annotation, *get_args(field.annotation)]
    return next((c for c in choices if isinstance(c, type) and issubclass(c, BaseModel)), None)


def _expected(location: Location) -> str:
    """The description of the key at a location, or of the nearest key above it."""
    model: type[BaseModel] = Scenario
    description = "another value"
    for step in location:
        field = model.model_fields.get(str(step))
        if field is None:
            break
        description = field.description or description
        model = _table(model, step) or model
    return description


def _quoted(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= LONGEST else text[: LONGEST - 1] + "…"
