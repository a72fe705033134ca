"""One traced program: made of a function, written to a file, loaded from it."""

import hashlib
import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np

from qtraj.foundation.exported.form import filled, form_of
from qtraj.foundation.files import write_atomically

UNPROMISED = ("lapack_dormqr_ffi", "lapack_sormqr_ffi")
"""Calls, of a least-squares solver, that may change with jaxlib, whose version is part of a program's name."""

DIGEST = 32
"""Bytes at the beginning of a file."""


class Executable:
    """A compiled program of arrays, and the form of its result."""

    def __init__(self, content: bytes):
        """Compile what `traced` made, or have JAX load what it has compiled before."""
        from jax import export  # here, so that only those who keep programs load it

        form, _, program = content.partition(b"\n")
        exported = export.deserialize(bytearray(program))
        self._form = json.loads(form)
        self._run = jax.jit(exported.call).lower(*exported.in_avals).compile()

    def __call__(self, given: tuple[Any, ...], kinds: Iterable[type]) -> Any:
        """The result for the arrays of these arguments."""
        found = self._run(*jax.tree.leaves(eqx.filter(given, eqx.is_array)))
        # What such a program returns is committed to its device, for which whatever takes it would be compiled again.
        return filled(self._form, iter(jax.device_put([np.asarray(x) for x in found])), kinds)


def traced(f: Callable[..., Any], given: tuple[Any, ...], kinds: Iterable[type]) -> bytes | None:
    """The program of a function in the arrays of the arguments; None for one that `jax.export` refuses."""
    from jax import export

    arrays, rest = eqx.partition(given, eqx.is_array)
    leaves, structure = jax.tree.flatten(arrays)
    forms = []

    def of_leaves(*leaves: Any) -> list[Any]:
        form, arrays = form_of(f(*eqx.combine(jax.tree.unflatten(structure, leaves), rest)), kinds)
        forms.append(form)
        return arrays

    jitted = jax.jit(of_leaves)
    jitted.trace(*leaves)  # an error of the function itself is no refusal
    unpromised = [export.DisabledSafetyCheck.custom_call(name) for name in UNPROMISED]
    try:
        exported = export.export(jitted, disabled_checks=unpromised)(*leaves)
    except (ValueError, RuntimeError):
        return None
    return json.dumps(forms[0]).encode() + b"\n" + bytes(exported.serialize())


def read(file: Path) -> bytes | None:
    """What was written to a file, if it is there and whole."""
    try:
        content = file.read_bytes()
    except OSError:
        return None
    digest, program = content[:DIGEST], content[DIGEST:]
    return program if hashlib.sha256(program).digest() == digest else None


def write(file: Path, program: bytes) -> None:
    """Write a program behind its digest.

    **Raises:** OSError where it cannot be written.
    """
    write_atomically(file, hashlib.sha256(program).digest() + program)
