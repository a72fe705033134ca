"""What a traced program depends on, as a name."""

import dataclasses
import hashlib
import importlib.metadata
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from qtraj._version import __version__

BUILT_ON = ("jax", "jaxlib", "numpy", "equinox", "lineax", "optimistix", "diffrax")

SETTINGS = (
    "jax_default_matmul_precision",
    "jax_default_prng_impl",
    "jax_numpy_dtype_promotion",
    "jax_numpy_rank_promotion",
)
"""Of JAX, on which tracing depends, besides the precision."""


def name_of(f: Callable[..., Any], given: tuple[Any, ...]) -> str | None:
    """The name of the program of a function for these arguments.

    Made of JAX's settings, the platform, and the shapes, types and static parts of the arguments. None within a trace,
    on devices chosen by hand, and for arguments with parts that have no lasting name, such as a user's function.
    """
    config: Any = jax.config
    if config.jax_disable_jit or config.jax_default_device is not None:
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
    return f"{f.__name__.strip('_')}-{hashlib.sha256(text.encode()).hexdigest()[:32]}"


def surroundings() -> str | None:
    """A digest of this package's version and source, of the versions of what it is built on, and of XLA's flags.

    None where a version is unknown.
    """
    try:
        versions = [f"{name} {importlib.metadata.version(name)}" for name in BUILT_ON]
    except importlib.metadata.PackageNotFoundError:
        return None
    root = Path(__file__).parents[2]
    states = [(file.relative_to(root), file.stat()) for file in sorted(root.rglob("*.py"))]
    sources = [f"{file} {state.st_size} {state.st_mtime_ns}" for file, state in states]
    flags = os.environ.get("XLA_FLAGS", "")  # nothing in a program, but with others all would be compiled anew
    return hashlib.sha256("\n".join([__version__, flags, *versions, *sources]).encode()).hexdigest()[:32]


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
