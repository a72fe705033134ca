"""Traced programs, kept in a folder from one process to the next.

JAX's own cache spares a process the compiling, but not the tracing, which takes several times as long as loading what
was compiled. So a kept function is traced once for all processes: its program is written as StableHLO (`jax.export`),
under a name made of all that it depends on, which is this package's source, the versions of what it is built on, the
platform, and the shapes, types and static parts of the arguments. Where no folder is set, within a trace, and for
arguments with parts that have no lasting name, such as a user's function, it is `equinox.filter_jit` of the function.
"""

import dataclasses
import functools
import hashlib
import importlib.metadata
import importlib.util
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import Tracer

from qtraj._version import __version__
from qtraj.foundation.files import write_atomically

BUILT_ON = ("jax", "jaxlib", "numpy", "equinox", "lineax", "optimistix", "diffrax")

UNPROMISED = ("lapack_dormqr_ffi", "lapack_sormqr_ffi")
"""Calls, of a least-squares solver, that may change with jaxlib, whose version is part of a program's name."""

P = ParamSpec("P")
R = TypeVar("R")

_folder: Path | None = None


def keep_in(folder: Path | None) -> None:
    """Keep traced programs in this folder, which is made when there is something to keep; None keeps none.

    For processes whose arguments are of this package's classes: of other classes the name is known, but no source.
    Without flatbuffers, the form of what `jax.export` writes, none are kept either.
    """
    global _folder
    _folder = folder if importlib.util.find_spec("flatbuffers") else None


def kept(*returns: type) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Compile a function of pytrees, as `equinox.filter_jit` does, and keep its programs.

    It returns arrays, in tuples, lists, dictionaries and the named tuples of these types.
    """

    def of(f: Callable[P, R]) -> Callable[P, R]:
        compiled = eqx.filter_jit(f)
        programs: dict[Path, Callable[..., Any]] = {}

        @functools.wraps(f)
        def call(*given: P.args, **named: P.kwargs) -> R:
            file = None if named else _file(f, given)
            if file is None:
                return compiled(*given, **named)
            if file not in programs:
                programs[file] = _program(f, given, file, returns) or compiled
            return programs[file](*given)

        return call

    return of


def _program(
    f: Callable[..., Any], given: tuple[Any, ...], file: Path, returns: tuple[type, ...]
) -> Callable[..., Any] | None:
    """The program of that file: read, or else traced and written; None where it cannot be."""
    from jax import export  # here, so that only those who keep programs load it

    for kind in returns:
        _make_known(kind)
    content = _read(file)
    if content is None:
        content = _traced(f, given)
        if content is None:
            return None
        _write(file, content)
    run = jax.jit(export.deserialize(bytearray(content)).call)
    return lambda *given: run(*jax.tree.leaves(eqx.filter(given, eqx.is_array)))


def _traced(f: Callable[..., Any], given: tuple[Any, ...]) -> bytes | None:
    """The program in the arrays of the arguments; None for one that `jax.export` refuses, as it does host callbacks."""
    from jax import export

    arrays, rest = eqx.partition(given, eqx.is_array)
    leaves, structure = jax.tree.flatten(arrays)
    of_leaves = jax.jit(lambda *x: f(*eqx.combine(jax.tree.unflatten(structure, x), rest)))
    unpromised = [export.DisabledSafetyCheck.custom_call(name) for name in UNPROMISED]
    exporting = export.export(of_leaves, disabled_checks=unpromised)
    try:
        return bytes(exporting(*leaves).serialize())
    except (ValueError, RuntimeError):
        return None


@functools.cache
def _make_known(kind: Any) -> None:
    """Tell `jax.export` the name of a type."""
    from jax import export

    export.register_namedtuple_serialization(kind, serialized_name=f"{kind.__module__}.{kind.__qualname__}")


def _read(file: Path) -> bytes | None:
    """What was written to a file, if it is there and whole."""
    try:
        content = file.read_bytes()
    except OSError:
        return None
    digest, program = content[:32], content[32:]
    return program if hashlib.sha256(program).digest() == digest else None


def _write(file: Path, program: bytes) -> None:
    """Where a program cannot be written, the next process traces anew."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(file, hashlib.sha256(program).digest() + program)
    except OSError:
        return


def _file(f: Callable[..., Any], given: tuple[Any, ...]) -> Path | None:
    """Where the program for these arguments is kept, or None where it cannot be."""
    if _folder is None:
        return None
    if any(isinstance(x, Tracer) for x in jax.tree.leaves(given)):
        return None
    try:
        described = "\n".join(_described(given))
    except TypeError:
        return None
    floats = jnp.result_type(float)  # what numbers without a type become
    text = f"{f.__module__}.{f.__qualname__}\n{jax.default_backend()}\n{floats}\n{described}"
    return _folder / _surroundings() / f"{f.__name__.strip('_')}-{hashlib.sha256(text.encode()).hexdigest()[:32]}"


def _described(x: Any) -> Iterator[str]:
    """All that a program depends on in its arguments, line by line.

    **Raises:** TypeError for a part that has no lasting name.
    """
    if eqx.is_array(x):
        yield f"{x.dtype}{x.shape}{getattr(x, 'weak_type', False)}"
    elif x is None or isinstance(x, bool | int | float | complex | str):
        yield f"{type(x).__name__} {x!r}"
    else:
        yield f"{type(x).__module__}.{type(x).__qualname__}("
        for key, part in _parts(x):
            yield key
            yield from _described(part)
        yield ")"


def _parts(x: Any) -> list[tuple[str, Any]]:
    if isinstance(x, tuple | list):
        return [("", part) for part in x]
    if isinstance(x, dict):
        return [(repr(key), part) for key, part in x.items()]
    if dataclasses.is_dataclass(x) and not isinstance(x, type):
        return [(field.name, getattr(x, field.name)) for field in dataclasses.fields(x)]
    raise TypeError(f"{x!r} has no lasting name")


@functools.cache
def _surroundings() -> str:
    """A digest of this package's version and source, and of the versions of what it is built on."""
    versions = [f"{name} {importlib.metadata.version(name)}\n" for name in BUILT_ON]
    digest = hashlib.sha256("".join([__version__, *versions]).encode())
    root = Path(__file__).parents[1]
    for file in sorted(root.rglob("*.py")):
        digest.update(f"{file.relative_to(root)}\n".encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()[:32]
