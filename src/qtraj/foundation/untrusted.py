"""Reading files that may hold anything: what is too large or nested too deep is refused, and never a crash."""

import json
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

LARGEST = 2**30
"""[bytes] of a text file."""

DEEPEST = 64
"""Levels of tables and arrays inside one another."""

_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+"""
_DOTTED = re.compile(rf"^[ \t]*+\[{{0,2}}[ \t]*+(?:{_PART}\.[ \t]*+){{{DEEPEST},}}", re.MULTILINE)
"""A key at the beginning of a line that names tables in tables: the parser takes minutes for very long ones."""

TOO_DEEP = f"its tables or arrays are nested deeper than {DEEPEST} levels"


def read_bytes(path: Path) -> bytes:
    """The content of a file.

    **Raises:** OSError where it cannot be read; ValueError, naming it, where it is larger than `LARGEST`.
    """
    with path.open("rb") as stream:
        content = stream.read(LARGEST + 1)
    if len(content) > LARGEST:
        raise ValueError(f"{path}: the file is larger than {LARGEST / 2**30:.3g} GiB, the most that is read")
    return content


def read_text(path: Path) -> str:
    """The content of a file in UTF-8, without a byte order mark.

    **Raises:** OSError where it cannot be read; ValueError, naming it, where it is too large or another encoding.
    """
    return decoded(path, read_bytes(path))


def decoded(path: Path, content: bytes) -> str:
    """The text of a file in UTF-8, without a byte order mark (ValueError, naming the file, for other bytes)."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: not a text file in UTF-8 (byte {error.start})") from None


def parse_json(text: str | bytes) -> Any:
    """The content of a JSON text.

    **Raises:** ValueError where it is none, or is nested deeper than `DEEPEST`.
    """
    return _parsed(json.loads, text)


def parse_toml(text: str) -> dict[str, Any]:
    """The content of a TOML text.

    **Raises:** tomllib.TOMLDecodeError, a ValueError, where it is none; ValueError where it is nested deeper than
    `DEEPEST`.
    """
    if _DOTTED.search(text):
        raise ValueError(TOO_DEEP)
    return _parsed(tomllib.loads, text)


def _parsed(parse: Callable[[Any], Any], text: str | bytes) -> Any:
    try:
        data = parse(text)
    except RecursionError:
        raise ValueError(TOO_DEEP) from None
    if _is_deep(data):
        raise ValueError(TOO_DEEP)
    return data


def _is_deep(data: Any) -> bool:
    level = [data]
    for _ in range(DEEPEST + 1):
        level = [inner for outer in level for inner in _inside(outer)]
        if not level:
            return False
    return True


def _inside(outer: Any) -> Any:
    values = outer.values() if isinstance(outer, dict) else outer if isinstance(outer, list) else ()
    return (value for value in values if isinstance(value, dict | list))
