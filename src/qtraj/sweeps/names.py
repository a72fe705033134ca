"""Check the names of parameters and outputs, which are names of folders of the store."""

import re
from collections.abc import Iterable

RESERVED = ("point", "status", "failed", "zarr.json")
"""Names in the store and in the results of functions that have a meaning of their own."""

LONGEST = 200
"""Maximum length of a name in bytes."""

_NAME = re.compile(r"[^\W\d][\w.\-]*")


def require_name(name: object, what: str) -> None:
    """Raise a ValueError for a name that cannot be a name in the store; `what` has it, such as "a parameter"."""
    if not isinstance(name, str) or not _NAME.fullmatch(name) or name.startswith("__"):
        raise ValueError(
            f"the name of {what} must be a string of letters, digits, '_', '.' and '-', starting with a letter or one "
            f"'_', but {_shown(name)} was given"
        )
    if len(name.encode()) > LONGEST:
        raise ValueError(f"the name of {what} must have at most {LONGEST} bytes, but {_shown(name)} is longer")
    if name in RESERVED:
        raise ValueError(f"the name '{name}' is reserved: choose another name for {what}")


def require_distinct(names: Iterable[str]) -> None:
    """Raise a ValueError for names that differ only in their case, which are one folder on some systems."""
    known: dict[str, str] = {}
    for name in names:
        other = known.setdefault(name.casefold(), name)
        if other != name:
            raise ValueError(f"the names '{other}' and '{name}' differ only in their case: rename one of them")


def _shown(name: object) -> str:
    text = repr(name)
    return text if len(text) <= LONGEST else f"{text[:LONGEST]} …"
