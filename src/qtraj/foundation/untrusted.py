"""Read untrusted files safely: content that is too large or too deeply nested raises a ValueError."""

import gzip
import json
import os
import re
import stat
import tomllib
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

MAX_SIZE = 2**30
"""Maximum size of a file [bytes]."""

MAX_DEPTH = 64
"""Maximum nesting depth of tables and arrays."""

_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+"""
_DOTTED = re.compile(rf"^[ \t]*+\[{{0,2}}[ \t]*+(?:{_PART}\.[ \t]*+){{{MAX_DEPTH},}}", re.MULTILINE)
"""Pattern of a dotted key with more than `MAX_DEPTH` components at the beginning of a line.

The parser needs minutes for very long dotted keys, so these keys are rejected before parsing.
"""

TOO_LONG = "it contains an integer with several thousand digits"

TOO_DEEP = f"its tables or arrays are nested deeper than {MAX_DEPTH} levels"


def read_bytes(path: Path) -> bytes:
    """Read the content of a file, and decompress the content if the name of the file ends with .gz.

    **Raises:** OSError if the file cannot be read; ValueError with the name of the file if the content is larger than
    `MAX_SIZE`, or if the name ends with .gz but the file is not a complete gzip file; also for pipes and devices.
    """
    require_regular(path)
    try:
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as stream:
            content = stream.read(MAX_SIZE + 1)
    except (gzip.BadGzipFile, EOFError, zlib.error):
        raise ValueError(f"{path}: not a complete gzip file, although its name ends with .gz") from None
    if len(content) > MAX_SIZE:
        raise ValueError(f"{path}: the file is larger than the maximum of {MAX_SIZE / 2**30:.3g} GiB")
    return content


def require_regular(path: Path) -> None:
    """Raise a ValueError if `path` is a pipe or a device, which may never end.

    **Raises:** OSError if the file does not exist.
    """
    mode = os.stat(path).st_mode
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise ValueError(f"{path}: this is a pipe or a device; write its content into a file first")


def read_text(path: Path) -> str:
    """Read a text file in UTF-8, without its byte order mark.

    **Raises:** the same errors as `read_bytes`; ValueError with the name of the file if the content is not in UTF-8.
    """
    return decoded(path, read_bytes(path))


def decoded(path: Path, content: bytes) -> str:
    """Decode the `content` of a text file in UTF-8, without its byte order mark.

    **Raises:** ValueError with the name of the file if the content is not in UTF-8.
    """
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: not a UTF-8 text file (invalid byte at offset {error.start})") from None


def parse_json(text: str | bytes) -> Any:
    """Parse a JSON document.

    **Raises:** ValueError if the document is not valid JSON, is nested deeper than `MAX_DEPTH`, or contains an integer
    with several thousand digits.
    """
    return _parsed(json.loads, text)


def parse_toml(text: str) -> dict[str, Any]:
    """Parse a TOML document.

    **Raises:** tomllib.TOMLDecodeError, a subclass of ValueError, if the document is not valid TOML; ValueError if it
    is nested deeper than `MAX_DEPTH` or contains an integer with several thousand digits.
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
        # For a syntax error the parsers raise a subclass of ValueError; `int` raises ValueError for too many digits.
        if type(error) is ValueError:
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
