"""The form of a result: how its arrays stand in tuples, dictionaries, named tuples and modules, as JSON.

A program returns its arrays one after the other, so it can be loaded before the types are known that hold them.
"""

import dataclasses
from collections.abc import Iterable, Iterator
from typing import Any

import equinox as eqx

ARRAY = "array"

PLAIN = (str, int, float, bool, type(None))
"""What static fields may hold: JSON gives it back as it was."""


def form_of(x: Any, kinds: Iterable[type]) -> tuple[Any, list[Any]]:
    """The form of a pytree, and its arrays: these named tuples and modules, and what Python comes with.

    **Raises:** TypeError for a part of another kind, a key that is no text, and a static field that is not `PLAIN`.
    """
    if x is None:
        return None, []
    if hasattr(x, "dtype"):
        return ARRAY, [x]
    if type(x) not in (tuple, list, dict, *kinds):
        raise TypeError(f"a program returns {type(x).__name__}, which is not among the kinds that it may return")
    parts, static = _fields(x)
    if any(type(key) is not str for key in parts) or any(type(value) not in PLAIN for value in static.values()):
        raise TypeError(f"a program returns {x!r}, whose keys or static fields JSON does not give back as they were")
    forms, arrays = {}, []
    for key, part in parts.items():
        forms[key], some = form_of(part, kinds)
        arrays += some
    return [_name(type(x)), forms, static], arrays


def filled(form: Any, arrays: Iterator[Any], kinds: Iterable[type]) -> Any:
    """The pytree of a form with these arrays."""
    if form is None:
        return None
    if form == ARRAY:
        return next(arrays)
    name, forms, static = form
    kind = {_name(kind): kind for kind in (tuple, list, dict, *kinds)}[name]
    parts = {key: filled(part, arrays, kinds) for key, part in forms.items()}
    if kind is dict:
        return parts
    if not issubclass(kind, eqx.Module):
        return getattr(kind, "_make", kind)(parts.values())
    made = object.__new__(kind)  # as JAX does: what was given once is neither converted nor checked again
    for field, value in (parts | static).items():
        object.__setattr__(made, field, value)
    return made


def _fields(x: Any) -> tuple[dict[Any, Any], dict[str, Any]]:
    """The parts by their keys, and the static ones."""
    if isinstance(x, dict):
        return x, {}
    if isinstance(x, tuple | list):
        return {str(k): part for k, part in enumerate(x)}, {}
    parts: dict[bool, dict[str, Any]] = {False: {}, True: {}}
    for field in dataclasses.fields(x):
        parts[bool(field.metadata.get("static"))][field.name] = getattr(x, field.name)
    return parts[False], parts[True]


def _name(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"
