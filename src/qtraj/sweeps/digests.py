"""Compute digests of functions and values, which change if a sweep would compute something else.

The digest of a function contains its compiled code, its defaults, the variables of its scope that it reads, and the
functions, classes and modules of the user that it uses. Installed packages count by their names only.
"""

import dataclasses
import datetime
import decimal
import enum
import fractions
import functools
import hashlib
import logging
import re
import sys
import types
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from qtraj.sweeps.code import file_of, global_names, imported, is_installed, is_installed_file, meaning

DIGITS = 16
"""Number of hexadecimal digits of a digest."""

_Seen = dict[int, tuple[int, Any]]
"""The objects that were visited: their numbers, and themselves, so that no other object gets the same id."""

_ATOMS = (str, bytes, bytearray, int, float, complex, Path, type(None), type(...), np.generic, np.dtype, range)
_ATOMS += (np.ufunc, fractions.Fraction, decimal.Decimal, datetime.timedelta, datetime.date, datetime.time, re.Pattern)
"""Types whose texts contain their whole content."""


def digest(value: Any) -> str:
    """Return a digest of a function, a number, a text, an array, or a collection of these.

    **Raises:** ValueError for an object whose content is unknown, because its digest would not be reproducible.
    """
    hashed = hashlib.sha256()
    for part in _parts(value, {}):
        hashed.update(len(part).to_bytes(8, "big") + part)
    return hashed.hexdigest()[:DIGITS]


def name_of(function: Any) -> str:
    """Return the qualified name of a function or of the class of a callable object."""
    while isinstance(function, functools.partial):
        function = function.func
    named = function if hasattr(function, "__qualname__") else type(function)
    return f"{named.__module__}.{named.__qualname__}"


def _parts(value: Any, seen: _Seen) -> Iterator[bytes]:
    if isinstance(value, enum.Enum):
        yield f"enum {type(value).__qualname__} {value.name}".encode()
        yield from _parts(value.value, seen)
    elif isinstance(value, _ATOMS):
        yield f"{type(value).__name__} {value!r}".encode()
    elif isinstance(value, np.ndarray | jax.Array):
        yield from _array(value, seen)
    elif isinstance(value, tuple | slice | set | frozenset):  # without numbers, because equal constants may be shared
        yield from _values(value, seen)
    elif id(value) in seen:
        yield f"known {seen[id(value)][0]}".encode()
    else:
        seen[id(value)] = len(seen), value
        yield from _compound(value, seen)


def _array(value: Any, seen: _Seen) -> Iterator[bytes]:
    array = np.asarray(jax.random.key_data(value) if _is_key(value) else value)
    if array.dtype.hasobject:
        yield f"objects {array.shape}".encode()
        yield from _several(array.ravel().tolist(), seen)
    else:
        yield f"array {array.shape} {array.dtype.str}".encode()
        yield np.ascontiguousarray(array).tobytes()


def _is_key(value: Any) -> bool:
    return isinstance(value, jax.Array) and jnp.issubdtype(value.dtype, jax.dtypes.prng_key)


def _values(value: Any, seen: _Seen) -> Iterator[bytes]:
    if isinstance(value, set | frozenset):
        yield f"set {sorted(map(digest, value))}".encode()
        return
    items = (value.start, value.stop, value.step) if isinstance(value, slice) else value
    yield f"{type(value).__name__} {len(items)}".encode()
    yield from _several(items, seen)


def _compound(value: Any, seen: _Seen) -> Iterator[bytes]:
    if isinstance(value, types.ModuleType):
        yield from _module(value, seen)
    elif isinstance(value, Mapping):
        yield f"mapping {len(value)}".encode()
        yield from _several((x for item in value.items() for x in item), seen)
    elif isinstance(value, list):
        yield f"list {len(value)}".encode()
        yield from _several(value, seen)
    elif isinstance(value, functools.partial):
        yield b"partial"
        yield from _several((value.func, value.args), seen)
        yield from _named_values(value.keywords, seen)
    elif isinstance(value, types.MethodType):
        yield b"method"
        yield from _several((value.__func__, value.__self__), seen)
    elif isinstance(value, types.FunctionType):
        yield from _function(value, seen)
    elif isinstance(value, type):
        yield from _class(value, seen)
    elif hasattr(value, "__wrapped__"):  # such as a function in jax.jit
        yield type(value).__name__.encode()
        yield from _parts(value.__wrapped__, seen)
    elif isinstance(value, logging.Logger):  # which does not change results
        yield f"logger {value.name}".encode()
    else:
        yield from _object(value, seen)


def _several(values: Iterable[Any], seen: _Seen) -> Iterator[bytes]:
    for value in values:
        yield from _parts(value, seen)


def _named_values(values: Mapping[str, Any], seen: _Seen) -> Iterator[bytes]:
    yield str(len(values)).encode()
    for name, value in sorted(values.items()):
        yield name.encode()
        yield from _parts(value, seen)


def _name(value: Any) -> bytes:
    return f"name {getattr(value, '__module__', '')}.{getattr(value, '__qualname__', value)}".encode()


def _function(function: types.FunctionType, seen: _Seen) -> Iterator[bytes]:
    code = function.__code__
    scope = dict(zip(code.co_freevars, map(_content, function.__closure__ or ()), strict=True))
    yield f"function {code.co_qualname}".encode()
    if is_installed(function):
        yield str(function.__module__).encode()
        yield from _named_values({k: x for k, x in scope.items() if type(x) is not object}, seen)
        return
    yield from _parts(meaning(code), seen)
    yield from _parts(function.__defaults__, seen)
    yield from _named_values(function.__kwdefaults__ or {}, seen)
    known = function.__globals__
    yield from _named_values({name: known[name] for name in global_names(code) if name in known} | scope, seen)
    for name in imported(code):
        yield from _source(name, file_of(name))


def _content(cell: Any) -> Any:
    try:
        return cell.cell_contents
    except ValueError:  # a variable without a value
        return None


def _module(module: types.ModuleType, seen: _Seen) -> Iterator[bytes]:
    """Yield the source of a module of the user and of those that it uses, or the variables of one without a file."""
    file = getattr(module, "__file__", None)
    yield from _source(module.__name__, file)
    if is_installed(module) or module.__name__ == "__main__":
        return
    variables = {name: x for name, x in vars(module).items() if not name.startswith("__")}
    if file is None:
        yield from _named_values(variables, seen)
        return
    used = (x if isinstance(x, types.ModuleType) else sys.modules.get(_module_of(x)) for x in variables.values())
    yield from _named_values({x.__name__: x for x in used if x is not None}, seen)


def _module_of(thing: Any) -> str:
    return str(getattr(thing, "__module__", "")) if isinstance(thing, type | types.FunctionType) else ""


def _source(module: str, file: str | None) -> Iterator[bytes]:
    yield f"module {module}".encode()
    if file is not None and module != "__main__" and not is_installed_file(file) and Path(file).is_file():
        yield Path(file).read_bytes()


def _class(cls: type, seen: _Seen) -> Iterator[bytes]:
    """Yield the functions and the attributes of a class of the user and of its bases."""
    yield _name(cls)
    if is_installed(cls):
        return
    yield from _several(cls.__mro__[1:], seen)
    for name, value in sorted(vars(cls).items()):
        if _has_content(name, value):
            yield name.encode()
            yield from _several(_members(value), seen)


def _has_content(name: str, value: Any) -> bool:
    """Return whether an attribute of a class may change results; others describe the class, such as `__slots__`."""
    is_function = callable(value) or isinstance(value, classmethod | staticmethod | property)
    return is_function if name.startswith("__") else name != "_abc_impl"


def _members(value: Any) -> Iterator[Any]:
    """Yield the functions in an attribute of a class, or the attribute itself."""
    if isinstance(value, property):
        yield from (value.fget, value.fset)
    elif isinstance(value, types.MemberDescriptorType | types.GetSetDescriptorType):
        return  # a slot, whose value is in the object
    else:
        inner = (getattr(value, name, None) for name in ("__func__", "func", "method"))
        yield next((x for x in inner if isinstance(x, types.FunctionType)), value)


def _object(value: Any, seen: _Seen) -> Iterator[bytes]:
    """Yield the class and the fields of an object, or the name of a function that was not written in Python."""
    yield from _parts(type(value), seen)
    if hasattr(value, "__qualname__"):
        yield _name(value)
    if dataclasses.is_dataclass(value):
        compared = [field.name for field in dataclasses.fields(value) if field.compare]
        yield from _named_values({name: getattr(value, name) for name in compared}, seen)
    elif hasattr(value, "__dict__"):
        yield from _named_values(vars(value), seen)
    elif not hasattr(value, "__qualname__"):
        raise ValueError(
            f"the function of the sweep reads {value!r}, whose content is unknown, so changes would pass unnoticed: "
            "create this object inside the function, or pass numbers instead"
        )
