"""Stored documents: Modules as TOML or JSON, exact in float64, without pickle.

A document is a table of the Module's fields with its class name under `type`; a field that is None is left out.
A class takes part by `@storable`; its fields must be arguments of its `__init__`.
"""

import dataclasses
import json
import os
import tempfile
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import jax
import numpy as np
import tomli_w

FORMAT = "qtraj/1"

_classes: dict[str, type] = {}

T = TypeVar("T")


def storable(cls: type[T]) -> type[T]:
    """Let `save` write and `load` read instances of this Module class."""
    _classes[cls.__name__] = cls
    return cls


def save(obj: Any, file: str | os.PathLike[str]) -> None:
    """Write `obj` to `file`, as TOML or JSON by the suffix; the file appears whole or not at all.

    **Raises:** ValueError for another suffix, or for a number that JSON cannot hold (NaN, infinity).
    """
    path = Path(file)
    write = _by_suffix(path, {".toml": tomli_w.dumps, ".json": _to_json})
    write_atomically(path, write({"format": FORMAT, **_encode(obj)}).encode())


def load(file: str | os.PathLike[str]) -> Any:
    """The object that `save` wrote to `file`.

    **Raises:** OSError where the file cannot be read; ValueError, naming the file, where it is no such document.
    """
    path = Path(file)
    read = _by_suffix(path, {".toml": tomllib.loads, ".json": json.loads})
    try:
        data = read(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path}: not valid {path.suffix[1:].upper()}: {error}") from error
    if not isinstance(data, dict) or data.pop("format", None) != FORMAT:
        raise ValueError(f"{path}: no qtraj document: the key 'format' must be {FORMAT!r}")
    try:
        return _decode(data)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from error


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file that is either complete or absent, also when the process is interrupted."""
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(content)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def _to_json(data: dict[str, Any]) -> str:
    try:
        return json.dumps(data, indent=2, allow_nan=False) + "\n"
    except ValueError as error:
        raise ValueError("JSON holds no NaN or infinity, and this object has one: save it as .toml instead") from error


def _by_suffix(path: Path, choices: dict[str, Callable[..., Any]]) -> Callable[..., Any]:
    try:
        return choices[path.suffix]
    except KeyError:
        raise ValueError(f"{path}: the file name must end in {' or '.join(choices)}") from None


def _encode(value: Any) -> Any:
    if type(value).__name__ in _classes:
        fields = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
        return {"type": type(value).__name__} | {k: _encode(v) for k, v in fields.items() if v is not None}
    if isinstance(value, jax.Array | np.ndarray | np.generic):
        return np.asarray(value).tolist()
    if isinstance(value, dict):
        return {k: _encode(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_encode(v) for v in value]
    if isinstance(value, bool | int | float | str):
        return value
    raise ValueError(f"a {type(value).__name__} cannot be stored; known are {', '.join(sorted(_classes))}")


def _decode(value: Any) -> Any:
    if isinstance(value, dict) and "type" in value:
        fields = {k: _decode(v) for k, v in value.items() if k != "type"}
        return _construct(value["type"], fields)
    if isinstance(value, dict):
        return {k: _decode(v) for k, v in value.items()}
    return value


def _construct(name: Any, fields: dict[str, Any]) -> Any:
    cls = _classes.get(name) if isinstance(name, str) else None
    if cls is None:
        raise ValueError(f"unknown type {name!r}; known are {', '.join(sorted(_classes))}")
    known = [f.name for f in dataclasses.fields(cls)]
    if unknown := sorted(set(fields) - set(known)):
        raise ValueError(f"{name} has no field {unknown[0]!r}; its fields are {', '.join(known)}")
    return cls(**fields)
