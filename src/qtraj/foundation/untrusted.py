"""Read untrusted files safely: content that is too large or too deeply nested is an error, never a crash."""

import gzip
import json
import re
import tomllib
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

MAX_SIZE = 2**30
"""[bytes] Maximum size of a file."""

MAX_DEPTH = 64
"""Maximum depth of nested tables and arrays."""

_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+"""
_DOTTED = re.compile(rf"^[ \t]*+\[{{0,2}}[ \t]*+(?:{_PART}\.[ \t]*+){{{MAX_DEPTH},}}", re.MULTILINE)
"""A dotted key at the beginning of a line: the parser takes minutes for very long ones."""

TOO_LONG = "it contains an integer with several thousand digits"

TOO_DEEP = f"its tables or arrays are nested deeper than {MAX_DEPTH} levels"


def read_bytes(path: Path) -> bytes:
    """The content of a file, decompressed if its name ends with .gz.

    **Raises:** OSError if it cannot be read; ValueError, naming it, if it exceeds `MAX_SIZE`, or is not a gzip file.
    """
    try:
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as stream:
            content = stream.read(MAX_SIZE + 1)
    except (gzip.BadGzipFile, EOFError, zlib.error):
        raise ValueError(f"{path}: not a complete gzip file, although its name ends with .gz") from None
    if len(content) > MAX_SIZE:
        raise ValueError(f"{path}: the file is larger than the maximum of {MAX_SIZE / 2**30:.3g} GiB")
    return content


def read_text(path: Path) -> str:
    """The content of a file in UTF-8, without a byte order mark.

    **Raises:** OSError if it cannot be read; ValueError, naming it, if it is too large or has another encoding.
    """
    return decoded(path, read_bytes(path))


def decoded(path: Path, content: bytes) -> str:
    """The text of a file in UTF-8, without a byte order mark.

    **Raises:** ValueError, naming the file, for another encoding.
    """
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: not a text file in UTF-8 (byte {error.start})") from None


def parse_json(text: str | bytes) -> Any:
    """The content of a JSON document.

    **Raises:** ValueError if it is not valid JSON, or is nested deeper than `MAX_DEPTH`.
    """
    return _parsed(json.loads, text)


def parse_toml(text: str) -> dict[str, Any]:
    """The content of a TOML document.

    **Raises:** tomllib.TOMLDecodeError, a ValueError, if it is not valid TOML; ValueError if it is nested deeper than
    `MAX_DEPTH`.
    """
    if _DOTTED.search(text):
        raise ValueError(TOO_DEEP)
    return _parsed(tomllib.loads, text)


def _parsed(parse: Callable[[Any], Any], text: str | bytes) -> Any:
    try:
        data = parse(text)
    except RecursionError:
        raise ValueError(TOO_DEEP) from None
    except ValueError as error:
        if type(error) is ValueError:  # a syntax error raises a subclass; `int` raises ValueError itself
            raise ValueError(TOO_LONG) from None
        raise
    if _is_deep(data):
        raise ValueError(TOO_DEEP)
    return data


def _is_deep(data: Any) -> bool:
    level = [data]
    for _ in range(MAX_DEPTH + 1):
        level = [inner for outer in level for inner in _inside(outer)]
        if not level:
            return False
    return True


def _inside(outer: Any) -> Any:
    values = outer.values() if isinstance(outer, dict) else outer if isinstance(outer, list) else ()
    return (value for value in values if isinstance(value, dict | list))
