"""Traced programs, kept in a folder from one process to the next.

JAX's own cache spares a process the compiling, but not the tracing, which takes several times as long as loading what
was compiled. So a kept function is traced once for all processes: its program is written as StableHLO (`jax.export`),
under a name made of what it depends on: this package's source, the versions of what it is built on, JAX's settings, the
platform, and the shapes, types and static parts of the arguments. Where no folder is set, within a trace, on devices
chosen by hand, and for arguments with parts that have no lasting name, such as a user's function, it is
`equinox.filter_jit` of the function, but for the weak types of results, which are lost.
"""

import dataclasses
import functools
import hashlib
import importlib.metadata
import importlib.util
import os
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from qtraj._version import __version__
from qtraj.foundation.files import write_atomically

BUILT_ON = ("jax", "jaxlib", "numpy", "equinox", "lineax", "optimistix", "diffrax")

SETTINGS = (
    "jax_default_matmul_precision",
    "jax_default_prng_impl",
    "jax_numpy_dtype_promotion",
    "jax_numpy_rank_promotion",
)
"""Of JAX, on which tracing depends, besides the precision."""

UNPROMISED = ("lapack_dormqr_ffi", "lapack_sormqr_ffi")
"""Calls, of a least-squares solver, that may change with jaxlib, whose version is part of a program's name."""

UNUSED = 30 * 24 * 3600.0
"""Programs of other sources and versions are removed after so many seconds [s]."""

P = ParamSpec("P")
R = TypeVar("R")

_folder: Path | None = None
_one_at_a_time = threading.Lock()


def keep_in(folder: Path | None) -> None:
    """Keep traced programs in this folder, which is made when there is something to keep; None keeps none.

    To be called before what is kept is imported, for the source is looked at here; and by processes whose arguments are
    of this package's classes: of other classes the name is known, but no source. Without flatbuffers, the form of what
    `jax.export` writes, none are kept either.
    """
    global _folder
    surroundings = _surroundings() if importlib.util.find_spec("flatbuffers") else None
    _folder = None if folder is None or surroundings is None else folder / surroundings


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
            with _one_at_a_time:
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

    def call(*given: Any) -> Any:
        # What such a program returns is committed to its device, for which whatever takes it would be compiled again.
        return jax.tree.map(
            lambda x: jax.device_put(np.asarray(x)), run(*jax.tree.leaves(eqx.filter(given, eqx.is_array)))
        )

    return call


def _traced(f: Callable[..., Any], given: tuple[Any, ...]) -> bytes | None:
    """The program in the arrays of the arguments; None for one that `jax.export` refuses, as it does some calls."""
    from jax import export

    arrays, rest = eqx.partition(given, eqx.is_array)
    leaves, structure = jax.tree.flatten(arrays)
    of_leaves = jax.jit(lambda *x: f(*eqx.combine(jax.tree.unflatten(structure, x), rest)))
    of_leaves.trace(*leaves)  # an error of the function itself is no refusal
    unpromised = [export.DisabledSafetyCheck.custom_call(name) for name in UNPROMISED]
    try:
        exported = export.export(of_leaves, disabled_checks=unpromised)(*leaves)
    except (ValueError, RuntimeError):
        return None
    return bytes(exported.serialize())


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
        if not file.parent.exists():
            file.parent.mkdir(parents=True)
            _remove_unused(file.parents[1])
        write_atomically(file, hashlib.sha256(program).digest() + program)
    except OSError:
        return


def _remove_unused(folder: Path) -> None:
    """Remove the programs of other sources and versions to which none has been added for long."""
    for other in folder.iterdir():
        if other.is_dir() and time.time() - other.stat().st_mtime > UNUSED:
            shutil.rmtree(other, ignore_errors=True)


def _file(f: Callable[..., Any], given: tuple[Any, ...]) -> Path | None:
    """Where the program for these arguments is kept, or None where it cannot be."""
    config: Any = jax.config
    if _folder is None or config.jax_disable_jit or config.jax_default_device is not None:
        return None
    given_arrays = [x for x in jax.tree.leaves(given) if isinstance(x, jax.Array)]
    if any(isinstance(x, Tracer) or x.devices() != {jax.devices()[0]} for x in given_arrays):
        return None
    try:
        described = "\n".join(_described(given))
    except TypeError:
        return None
    settings = [str(getattr(config, name, None)) for name in SETTINGS]
    floats = str(jnp.result_type(float))  # what numbers without a type become
    of = (f"{f.__module__}.{f.__qualname__}", jax.default_backend(), os.environ.get("EQX_ON_ERROR", ""))
    text = "\n".join([*of, *settings, floats, described])
    return _folder / f"{f.__name__.strip('_')}-{hashlib.sha256(text.encode()).hexdigest()[:32]}"


def _described(x: Any, static: bool = False) -> Iterator[str]:
    """All that a program depends on in its arguments, line by line; of arrays that are none of its arguments nothing.

    **Raises:** TypeError for a part that has no lasting name.
    """
    if eqx.is_array(x) and not static:
        yield f"{x.dtype}{x.shape}{getattr(x, 'weak_type', False)}"
    elif x is None or (isinstance(x, bool | int | float | complex | str) and not isinstance(x, np.generic)):
        yield f"{type(x).__name__} {x!r}"
    else:
        yield f"{type(x).__module__}.{type(x).__qualname__}("
        for key, part, still in _parts(x):
            yield key
            yield from _described(part, static or still)
        yield ")"


def _parts(x: Any) -> list[tuple[str, Any, bool]]:
    """The parts of a pytree: their keys, themselves, and whether they are static."""
    if isinstance(x, tuple | list):
        return [("", part, False) for part in x]
    if isinstance(x, dict):
        return [(repr(key), part, False) for key, part in x.items()]
    if isinstance(x, eqx.Module):
        fields = dataclasses.fields(x)
        return [(field.name, getattr(x, field.name), bool(field.metadata.get("static"))) for field in fields]
    raise TypeError(f"{x!r} has no lasting name")


def _surroundings() -> str | None:
    """A digest of this package's version and source, and of the versions of what it is built on; None if unknown."""
    try:
        versions = [f"{name} {importlib.metadata.version(name)}" for name in BUILT_ON]
    except importlib.metadata.PackageNotFoundError:
        return None
    root = Path(__file__).parents[1]
    states = [(file.relative_to(root), file.stat()) for file in sorted(root.rglob("*.py"))]
    sources = [f"{file} {state.st_size} {state.st_mtime_ns}" for file, state in states]
    return hashlib.sha256("\n".join([__version__, *versions, *sources]).encode()).hexdigest()[:32]
