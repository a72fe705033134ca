"""Names of columns: separate the unit from the name, and find the columns that have common names."""

import re
from collections.abc import Sequence
from functools import lru_cache

from qtraj.io.track.column_units import NOT_SUFFIXES, SPELLINGS, Unit, unit_of
from qtraj.io.track.known_names import COMMON, FLAT, GLOBAL, IMPLIED, MORE, PREFIXES

_BRACKET = re.compile(r"[\[(]\s*([^\])]*?)\s*[\])]")
_SEPARATOR = re.compile(r"[\s_./\-\[\]]+")
_UNIT_IN_BRACKETS = re.compile(r"\s*[\[(](?!\d+[\])]).*$")

_remembered = lru_cache(maxsize=1024)
"""A few hundred choices of names are looked for in each header and in the first lines of a file."""


@_remembered
def squeezed(name: str) -> str:
    """Return a name in lower case, without the unit in brackets and without separators."""
    return _SEPARATOR.sub("", _base(name).lower())


def bracketed(name: str) -> list[str]:
    """Return the texts in brackets in a column name."""
    return _BRACKET.findall(name)


def unit_in(name: str) -> tuple[str, Unit] | None:
    """Return the unit in a column name and its text: in brackets, as in `x [km]`, or at the end, as in `x_km`."""
    for text in bracketed(name):
        if unit := unit_of(text):
            return text, unit
    if text := IMPLIED.get(squeezed(name)):
        return text, SPELLINGS[text]
    words, count = _words(name)
    text = "_".join(words[len(words) - count :])
    unit = _suffix(text) if count else None
    return (text, unit) if unit else None


def plain(header: Sequence[str]) -> dict[str, str]:
    """Map names without units and separators, in lower case, to the column names; the first of equal names counts."""
    forms = (squeezed, _without_unit, _without_prefix, _with_unit)
    result: dict[str, str] = {}
    for form in forms:
        for name in header:
            result.setdefault(form(name), name)
    return result


def find(choices: Sequence[str], header: Sequence[str]) -> tuple[str, ...] | None:
    """Return the columns of the first choice, such as "x,y,z", of which the header has all names, otherwise None."""
    known = plain(header)
    for choice in choices:
        names = [squeezed(name) for name in choice.split(",")]
        if all(name in known for name in names):
            return _alike(names, header) or tuple(known[name] for name in names)
    return None


def _alike(names: Sequence[str], header: Sequence[str]) -> tuple[str, ...] | None:
    """Return columns with these names that have the same prefix, such as `local` of `local_x` and `local_y`."""
    by_prefix: dict[tuple[str, ...], dict[str, str]] = {}
    for name in header:
        by_prefix.setdefault(_prefix(name), {}).update(plain([name]))
    for same in by_prefix.values():
        if all(name in same for name in names):
            return tuple(same[name] for name in names)
    return None


def is_one_of(choices: Sequence[str], names: Sequence[str]) -> bool:
    """Return whether the names, in this order, are one of the choices."""
    return any(find([choice], names) == tuple(names) for choice in choices if choice.count(",") == len(names) - 1)


def names_columns(header: Sequence[str]) -> bool:
    """Return whether a row names the columns of a time and a position."""
    if len(header) < 3:
        return False
    place = (*COMMON["position"], *MORE["position"], *GLOBAL, *FLAT)
    return find((*COMMON["time"], *MORE["time"]), header) is not None and find(place, header) is not None


def _base(name: str) -> str:
    """Return a name without its unit in brackets; a number in brackets is an index and stays."""
    return _UNIT_IN_BRACKETS.sub("", name).strip()


@_remembered
def _words(name: str) -> tuple[tuple[str, ...], int]:
    """Return the words of a name, and the number of words at its end that are a unit."""
    words = tuple(word for word in _SEPARATOR.split(_base(name).lower()) if word)
    for count in range(min(2, len(words) - 1), 0, -1):
        if _suffix("_".join(words[-count:])):
            return words, count
    return words, 0


def _suffix(text: str) -> Unit | None:
    return None if text in NOT_SUFFIXES else unit_of(text)


def _without_unit(name: str) -> str:
    words, count = _words(name)
    return "".join(words[: len(words) - count])


def _without_prefix(name: str) -> str:
    words, count = _words(name)
    return "".join(words[len(_prefix(name)) : len(words) - count])


def _with_unit(name: str) -> str:
    """Return a name without its prefix, but with its unit, such as `stampsecs` for `header.stamp.secs`."""
    words, _ = _words(name)
    return "".join(words[len(_prefix(name)) :])


@_remembered
def _prefix(name: str) -> tuple[str, ...]:
    """Return the words at the start of a name that do not change its meaning."""
    words, count = _words(name)
    rest = words[: len(words) - count]
    length = next((k for k, word in enumerate(rest[:-1]) if word not in PREFIXES), max(len(rest) - 1, 0))
    return rest[:length]
