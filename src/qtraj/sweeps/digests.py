"""Compute digests of functions and values, which change if a sweep would compute something else.

The digest of a function contains its source, its defaults, the variables of its scope that it reads, and the functions
of the user's own modules that it calls. Installed packages count by their versions only.
"""

import dataclasses
import functools
import hashlib
import inspect
import sys
import sysconfig
import types
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

DIGITS = 16
"""Number of hexadecimal digits of a digest."""

_INSTALLED = tuple(str(Path(sysconfig.get_path(name)).resolve()) for name in ("stdlib", "purelib", "platlib"))
_OWN = str(Path(__file__).parents[1].resolve())


def digest(value: Any) -> str:
    """Return a digest of a function, a number, a text, an array, or a collection of these.

    **Raises:** ValueError for an object whose content is unknown, because its digest would not be reproducible.
    """
    hashed = hashlib.sha256()
    for part in _parts(value, set()):
        hashed.update(len(part).to_bytes(8, "big") + part)
    return hashed.hexdigest()[:DIGITS]


def name_of(function: Any) -> str:
    """Return the qualified name of a function or of the class of a callable object."""
    while isinstance(function, functools.partial):
        function = function.func
    named = function if hasattr(function, "__qualname__") else type(function)
    return f"{named.__module__}.{named.__qualname__}"


def _parts(value: Any, seen: set[int]) -> Iterator[bytes]:
    if isinstance(value, str | bytes | int | float | complex | Path | type(None) | np.generic | np.dtype):
        yield f"{type(value).__name__} {value!r}".encode()
    elif isinstance(value, np.ndarray | jax.Array):
        array = np.asarray(jax.random.key_data(value) if _is_key(value) else value)
        if array.dtype.hasobject:
            yield from _parts(array.tolist(), seen)
            return
        yield f"array {array.shape} {array.dtype.str}".encode()
        yield np.ascontiguousarray(array).tobytes()
    elif id(value) in seen:
        yield b"known"
    else:
        seen.add(id(value))
        yield from _compound(value, seen)


def _is_key(value: Any) -> bool:
    return isinstance(value, jax.Array) and jnp.issubdtype(value.dtype, jax.dtypes.prng_key)


def _compound(value: Any, seen: set[int]) -> Iterator[bytes]:
    if isinstance(value, types.ModuleType):
        yield f"module {value.__name__}".encode()
    elif isinstance(value, Mapping):
        yield f"mapping {len(value)}".encode()
        yield from _several([x for item in value.items() for x in item], seen)
    elif isinstance(value, list | tuple):
        yield f"{type(value).__name__} {len(value)}".encode()
        yield from _several(value, seen)
    elif isinstance(value, set | frozenset):
        yield f"set {sorted(map(digest, value))}".encode()
    elif isinstance(value, functools.partial):
        yield b"partial"
        yield from _several((value.func, value.args, value.keywords), seen)
    elif isinstance(value, types.MethodType):
        yield from _several((value.__func__, value.__self__), seen)
    elif isinstance(value, types.FunctionType):
        yield from _function(value, seen)
    elif hasattr(value, "__wrapped__"):  # such as a function in jax.jit
        yield type(value).__name__.encode()
        yield from _parts(value.__wrapped__, seen)
    elif isinstance(value, type | types.BuiltinFunctionType | np.ufunc):
        yield from _named(value)
    else:
        yield from _object(value, seen)


def _several(values: Any, seen: set[int]) -> Iterator[bytes]:
    for value in values:
        yield from _parts(value, seen)


def _function(function: types.FunctionType, seen: set[int]) -> Iterator[bytes]:
    yield f"function {function.__qualname__}".encode()
    if _is_installed(function):
        yield str(function.__module__).encode()
        yield from _several([cell.cell_contents for cell in function.__closure__ or ()], seen)
        return
    yield _source(function)
    yield from _several((function.__defaults__, function.__kwdefaults__), seen)
    read = inspect.getclosurevars(function)
    for name, value in sorted({**read.nonlocals, **read.globals}.items()):
        yield name.encode()
        yield from _parts(value, seen)


def _named(value: Any) -> Iterator[bytes]:
    yield f"name {getattr(value, '__module__', '')}.{getattr(value, '__qualname__', value)}".encode()
    if isinstance(value, type) and not _is_installed(value):
        yield _source(value)


def _object(value: Any, seen: set[int]) -> Iterator[bytes]:
    """Yield the class and the fields of an object, or the leaves of a pytree."""
    yield from _named(type(value))
    if dataclasses.is_dataclass(value):
        yield from _parts(
            {field.name: getattr(value, field.name) for field in dataclasses.fields(value) if field.compare}, seen
        )
    elif hasattr(value, "__dict__"):
        yield from _parts(vars(value), seen)
    else:
        raise ValueError(
            f"the function of the sweep reads {value!r}, whose content is unknown, so changes would pass unnoticed: "
            "create this object inside the function, or pass numbers instead"
        )


def _source(thing: Any) -> bytes:
    try:
        return inspect.getsource(thing).encode()
    except (OSError, TypeError):  # typed at a prompt
        code = getattr(thing, "__code__", None)
        return b"" if code is None else digest(_code(code)).encode()


def _code(code: types.CodeType) -> tuple[Any, ...]:
    """Return what a compiled function does, with the functions inside it."""
    constants = [_code(x) if isinstance(x, types.CodeType) else x for x in code.co_consts]
    return code.co_code, constants, code.co_names


def _is_installed(thing: Any) -> bool:
    """Return whether a function or a class is from Python, qtraj or another installed package."""
    module = sys.modules.get(getattr(thing, "__module__", None) or "")
    file = getattr(module, "__file__", None)
    if file is None:
        return getattr(thing, "__module__", "") not in ("__main__", None)
    return str(Path(file).resolve()).startswith((_OWN, *_INSTALLED))
