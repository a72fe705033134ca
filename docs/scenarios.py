"""Writes docs/scenarios.md, the reference of all keys of scenario files, from the models that read them.

Run it from the folder of the project:  .venv/bin/python docs/scenarios.py
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from qtraj.scenario import KINDS

FIRST = ("name", "description", "angles")
"""Keys of the whole scenario, wherever a model has them."""

PAGE = Path(__file__).with_suffix(".md")

COMMANDS: dict[str, type[BaseModel]] = {kind.title: kind.model for kind in KINDS.values()}
"""The heading of each chapter, and the model of its scenario."""

INTRODUCTION = """# Scenarios

A scenario is a TOML file that says what a command is to do. These are all its keys; a dash as default means that a key
may be left out. A key that is not listed is refused, and so is a value of another kind; the message names the key and
what was expected. Files are named relative to the scenario. Numbers are in SI units; in scenarios of `qtraj slew` and
`qtraj simulate` every angle, also in rates and accelerations, is in the unit that `angles` names. Complete scenarios
are in the folder `examples`, and those that run without an argument in `src/qtraj/io/data`. The old name of a key,
`[program.turn]` for `[program.slew]`, is read until 1.0, with a warning.

This page is written by `docs/scenarios.py` from the models that read the files; change those, not this page.
"""


class Table(NamedTuple):
    """A table of a scenario: the ways it may be headed, what it is for, and its model."""

    headers: tuple[str, ...]
    model: type[BaseModel]


def page() -> str:
    """The whole page."""
    parts = [INTRODUCTION]
    known: dict[type[BaseModel], str] = {}
    for heading, model in COMMANDS.items():
        parts += [f"## {heading}\n", *_about(model), _keys(model)]
        for table in _tables(model):
            title = ", ".join(f"`{header}`" for header in table.headers)
            parts.append(f"### {title}\n")
            if table.model in known:
                parts.append(f"As {known[table.model]} above.\n")
                continue
            known[table.model] = f"{title} of {heading}"
            parts += [*_about(table.model), _keys(table.model)]
    return "\n".join(parts)


def _about(model: type[BaseModel]) -> list[str]:
    """What a model says of itself, a paragraph to an entry."""
    lines = [line.strip() for line in (model.__doc__ or "").strip().splitlines()]
    return [f"{paragraph}\n" for paragraph in " ".join(line or "\n" for line in lines).split(" \n ")]


def _tables(model: type[BaseModel], under: str = "") -> Iterator[Table]:
    """The tables below a model, neighbours of one kind together, each followed by its own."""
    found: dict[type[BaseModel], list[str]] = {}
    for name, field in model.model_fields.items():
        if (inner := _inner(field.annotation)) is not None:
            bare = f"{under}{name}"
            found.setdefault(inner, []).append(f"[[{bare}]]" if get_origin(field.annotation) is list else f"[{bare}]")
    for inner, headers in found.items():
        yield Table(tuple(headers), inner)
        if len(headers) == 1:
            yield from _tables(inner, f"{headers[0].strip('[]')}.")


def _inner(annotation: Any) -> type[BaseModel] | None:
    """The model of the table under a key; None for a plain value."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next(filter(None, map(_inner, get_args(annotation))), None)


def _keys(model: type[BaseModel]) -> str:
    rows = ["| key | meaning | value | default |", "|---|---|---|---|"]
    for name, field in sorted(model.model_fields.items(), key=lambda item: item[0] not in FIRST):
        cells = (f"`{name}`", _cell(field.title), _cell(field.description), _default(field))
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join(rows) + "\n"


def _cell(text: str | None) -> str:
    return (text or "").replace("|", "\\|").replace("] [", "] \\[")  # the second bracket is a unit, no link


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "must be given"
    value = field.get_default(call_default_factory=True)
    if value is None or value == [] or value == {} or isinstance(value, BaseModel):
        return "–"
    return f"`{json.dumps(value)}`"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
