"""A Griffe extension for the site: a table of the parameters of functions that have many."""

import re
from typing import Any

import griffe

LINE = "|---|---|---|---|"
MANY = 5
"""Functions with at least this number of parameters have a table."""
SECTION = re.compile(r"(?m)^Args:\n((?:[ \t]+.*\n?|\n)+)")
ENTRY = re.compile(r"(?m)^ {4}(\*{0,2}\w+)(?: \([^)]*\))?: +(.+(?:\n {8,}.+)*)")


class Parameters(griffe.Extension):
    """Adds the table after the first paragraph of the docstring; an `Args:` section becomes the table."""

    def on_function(self, *, func: griffe.Function, **_: Any) -> None:
        """Add the table to the docstring of a function, if it has many parameters or describes them one by one."""
        if func.docstring is None or (func.name.startswith("_") and func.name != "__init__"):
            return
        shown = [p for p in func.parameters if p.name not in ("self", "cls")]
        text, meanings = without_section(func.docstring.value)
        if len(shown) >= MANY or meanings:
            func.docstring.value = with_table(text, table(shown, meanings or sentences(text, shown)))


def without_section(text: str) -> tuple[str, dict[str, str]]:
    """Return a docstring without its `Args:` section, and the meanings of the parameters from this section."""
    section = SECTION.search(text)
    if section is None:
        return text, {}
    meanings = {name.lstrip("*"): " ".join(meaning.split()) for name, meaning in ENTRY.findall(section[1])}
    return text[: section.start()].rstrip() + "\n\n" + text[section.end() :].lstrip("\n"), meanings


def sentences(text: str, parameters: list[Any]) -> dict[str, str]:
    """Return, for each parameter, the first sentence of the docstring that begins with it or mentions it."""
    prose = " ".join(re.sub(r"(?ms)^(?:>>>|\*\*Raises).*", "", text).split())
    parts = re.split(r"(?<=[.;])\s+(?=[`A-Z])", prose)
    result = {}
    for parameter in parameters:
        name = f"`{parameter.name}`"
        named = [part for part in parts if part.startswith(name)] or [part for part in parts[1:] if name in part]
        if named:
            result[parameter.name] = named[0].partition(": - ")[0].rstrip(";")  # without the items of a list
    return result


def table(parameters: list[Any], meanings: dict[str, str]) -> str:
    """Return the table in Markdown: name, type, default, meaning."""
    rows = [["parameter", "type", "default", "meaning"]]
    for p in parameters:
        kind, default = (f"`{x}`" if x is not None else "" for x in (p.annotation, p.default))
        rows.append([f"`{p.name}`", kind, default, meanings.get(p.name, "")])
    head, *lines = (f"| {' | '.join(map(_cell, row))} |" for row in rows)
    return "\n".join([head, LINE, *lines])


def _cell(text: str) -> str:
    """Return a text whose bars do not end the cell; bars in code do not."""
    return re.sub(r"(`[^`]*`)|\|", lambda found: found[1] or r"\|", text)


def with_table(text: str, rows: str) -> str:
    """Insert the table after the first paragraph."""
    first, _, rest = text.partition("\n\n")
    return "\n\n".join(part for part in (first, rows, rest) if part)
