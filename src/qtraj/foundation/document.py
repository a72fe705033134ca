"""Save and load Modules as TOML or JSON documents, without loss of precision in float64 and without pickle.

A document is a table with the fields of the Module, and the name of its class under the key `type`. Fields that are
None are omitted. `@storable` registers a class. The fields of the class must be arguments of its `__init__`, unless
`@stored_as` defines other fields.
"""

import dataclasses
import inspect
import json
import math
import os
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import jax
import numpy as np

from qtraj.foundation.files import write_atomically
from qtraj.foundation.suggestion import nearest
from qtraj.foundation.untrusted import parse_json, parse_toml, read_text

FORMAT = "qtraj/1"

_NON_FINITE = {"NaN": math.nan, "Infinity": math.inf, "-Infinity": -math.inf}

Change = Callable[[dict[str, Any]], dict[str, Any]]
"""A function that converts the fields of an older document, before decoding, to the present fields."""

_classes: dict[str, type] = {}
_changes: dict[str, Change] = {}
_former: dict[str, str] = {}
_forms: dict[str, tuple[Callable[[Any], dict[str, Any]], Callable[..., Any]]] = {}

T = TypeVar("T")


def storable(cls: type[T]) -> type[T]:
    """Register a Module class, so that `save` and `load` support its instances; a class decorator.

    A document contains the name of the class and its fields, which must be arguments of its `__init__` (automatic for a
    Module without an own `__init__`). Fields may be numbers, texts, arrays, lists, tables and objects of classes that
    can be stored, but not functions. `load` creates objects only of registered classes, so the module with the class
    must be imported first.

    Args:
        cls: A subclass of `equinox.Module` or of a base class of qtraj, such as `AbstractProgram`.

    Returns:
        The class.

    Raises:
        TypeError: For anything that is not a class with fields.
        ValueError: If another class with the same name is registered.

    Example:
        >>> @storable
        ... class Spring(eqx.Module):
        ...     stiffness: float
        >>> save(Spring(3.0), "spring.toml")
        >>> load("spring.toml").stiffness
        3.0
    """
    if not (isinstance(cls, type) and dataclasses.is_dataclass(cls)):
        raise TypeError(f"storable registers classes with fields, such as subclasses of equinox.Module, but {cls!r}")
    _register(cls)
    return cls


def _register(cls: type) -> None:
    known = _classes.get(cls.__name__)
    if known is not None and (known.__module__, known.__qualname__) != (cls.__module__, cls.__qualname__):
        raise ValueError(
            f"a class named {cls.__name__} can already be stored ({known.__module__}.{known.__qualname__}), and "
            "documents contain only the name: choose another name"
        )
    _classes[cls.__name__] = cls


def formerly(name: str) -> Callable[[type[T]], type[T]]:
    """Return a class decorator that lets `load` read documents with `name`, a former name of the class."""

    def register(cls: type[T]) -> type[T]:
        _former[name] = cls.__name__
        return cls

    return register


def reads_older(change: Change) -> Callable[[type[T]], type[T]]:
    """Return a class decorator that lets `load` read documents of older versions; `change` converts their fields."""

    def register(cls: type[T]) -> type[T]:
        _changes[cls.__name__] = change
        return cls

    return register


def stored_as(fields: Callable[[Any], dict[str, Any]], build: Callable[..., Any]) -> Callable[[type[T]], type[T]]:
    """Return a class decorator that registers a class that is stored in another form.

    `save` stores the fields that `fields` returns, and `load` passes these fields to `build`.
    """

    def register(cls: type[T]) -> type[T]:
        _register(cls)
        _forms[cls.__name__] = (fields, build)
        return cls

    return register


def save(obj: Any, file: str | os.PathLike[str]) -> None:
    """Write `obj` to `file`, as TOML or JSON according to the suffix; a failure leaves no incomplete file.

    JSON has no NaN and no infinity, so these values are written as the strings "NaN", "Infinity" and "-Infinity".

    **Raises:** ValueError for any other suffix, or if the object contains a type that cannot be stored; OSError if the
    file cannot be written.
    """
    path = Path(file)
    write = _by_suffix(path, {".toml": _to_toml, ".json": _to_json})
    write_atomically(path, write({"format": FORMAT, **_encode(obj)}).encode())


def load(file: str | os.PathLike[str]) -> Any:
    """Load the object that `save` wrote to `file`.

    If JAX's 64-bit mode is not enabled, a warning says that numbers are rounded to float32.

    **Raises:** OSError if the file cannot be read; ValueError with the name of the file if the suffix is neither .toml
    nor .json, or the content is not a valid document.
    """
    path = Path(file)
    read = _by_suffix(path, {".toml": parse_toml, ".json": parse_json})
    text = read_text(path)
    try:
        data = read(text)
    except ValueError as error:
        raise ValueError(f"{path}: not valid {path.suffix[1:].upper()}: {error}") from error
    if not isinstance(data, dict) or data.pop("format", None) != FORMAT:
        raise ValueError(f"{path}: not a qtraj document: the key 'format' must be {FORMAT!r}")
    if not jax.config.read("jax_enable_x64"):
        warnings.warn(
            f"{path}: the stored float64 numbers are rounded to float32. "
            "Call jax.config.update('jax_enable_x64', True) first to keep full precision.",
            stacklevel=2,
        )
    try:
        found = _decode(data)
        with np.errstate(all="ignore"):
            for text in (repr, str):  # they use the values, so that a value of a wrong type is found here
                text(found)
    except Exception as error:  # a class may raise any error for values of a wrong type
        reason = str(error) if isinstance(error, TypeError | ValueError) else f"a value has a wrong type ({error})"
        raise ValueError(f"{path}: {reason}") from error
    return found


def _to_toml(data: dict[str, Any]) -> str:
    import tomli_w  # imported here, because only saving needs it

    return tomli_w.dumps(data)


def _to_json(data: dict[str, Any]) -> str:
    return _indented(data) + "\n"


def _indented(value: Any, margin: str = "\n") -> str:
    """Return `value` as JSON, with one line for each key and for each innermost list, such as the row of an array."""
    inner = margin + "  "
    if isinstance(value, dict) and value:
        return "{" + ",".join(f"{inner}{json.dumps(k)}: {_indented(v, inner)}" for k, v in value.items()) + margin + "}"
    if isinstance(value, list) and any(isinstance(x, dict | list) for x in value):
        return "[" + ",".join(inner + _indented(x, inner) for x in value) + margin + "]"
    try:
        return json.dumps(value, allow_nan=False)
    except ValueError:
        return json.dumps([_as_string(x) for x in value] if isinstance(value, list) else _as_string(value))


def _as_string(value: Any) -> Any:
    """Return NaN and infinities as strings, other values unchanged."""
    if isinstance(value, float) and not math.isfinite(value):
        return "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"
    return value


def _by_suffix(path: Path, choices: dict[str, Callable[..., Any]]) -> Callable[..., Any]:
    try:
        return choices[path.suffix]
    except KeyError:
        raise ValueError(f"{path}: the file name must end in {' or '.join(choices)}") from None


def _encode(value: Any) -> Any:
    if _classes.get(type(value).__name__) is type(value):
        form = _forms.get(type(value).__name__)
        fields = form[0](value) if form else {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
        return {"type": type(value).__name__} | {k: _encode(v) for k, v in fields.items() if v is not None}
    if isinstance(value, jax.Array | np.ndarray | np.generic):
        return np.asarray(value).tolist()
    if isinstance(value, dict):
        return {k: _encode(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_encode(v) for v in value]
    if isinstance(value, bool | int | float | str):
        return value
    raise ValueError(
        f"type {type(value).__name__} cannot be stored; paths, programs, laws, limits, tracks, vehicles and results of "
        "qtraj can, and own classes that are registered with @qtraj.storable"
    )


def _decode(value: Any) -> Any:
    if isinstance(value, dict) and "type" in value:
        name, fields = value["type"], {k: v for k, v in value.items() if k != "type"}
        if isinstance(name, str):
            name = _former.get(name, name)
            fields = _changes[name](fields) if name in _changes else fields
        return _construct(name, {k: _decode(v) for k, v in fields.items()})
    if isinstance(value, dict):
        return {k: _decode(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_decode(v) for v in value]
    return _NON_FINITE.get(value, value) if isinstance(value, str) else value


def _construct(name: Any, fields: dict[str, Any]) -> Any:
    cls = _classes.get(name) if isinstance(name, str) else None
    if cls is None:
        near = nearest(name, sorted(_classes)) if isinstance(name, str) else ""
        raise ValueError(
            f"unknown type {name!r:.80}; {f'did you mean {near!r}? If' if near else 'if'} it is an own class, "
            "import the module that registers it with @qtraj.storable first"
        )
    build = _forms[name][1] if name in _forms else cls
    parameters = inspect.signature(build).parameters
    names = [*parameters] if name in _forms else [f.name for f in dataclasses.fields(cls)]
    if unknown := sorted(set(fields) - set(names)):
        raise ValueError(f"{name} has no field {unknown[0]!r}; its fields are {', '.join(names)}")
    required = [p.name for p in parameters.values() if p.default is p.empty and p.kind is not p.VAR_KEYWORD]
    if missing := [field for field in required if field not in fields]:
        raise ValueError(f"{name} lacks the field {missing[0]!r}; its required fields are {', '.join(required)}")
    return build(**fields)
