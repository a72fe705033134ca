"""Programs kept between runs: traced once, and loaded from the user's cache folder from then on.

The persistent compilation cache spares compiling; tracing, which takes longer than all the rest of a short job, it
does not. Here the traced program itself is kept as well (`jax.export`), where the package flatbuffers is installed.
"""

import functools
import hashlib
import importlib.util
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.export
import jax.numpy as jnp
from jaxlib import version

from qtraj.foundation.document import write_atomically

Function = Callable[..., Any]


def kept(name: str, function: Function, *arguments: Any) -> Any | None:
    """`function(*arguments)`, compiled as one program, or None where programs cannot be kept.

    `function` gives dictionaries and tuples of arrays, and depends on nothing but its arguments and `name`.
    """
    folder = _folder()
    if folder is None:
        return None
    leaves, form = jax.tree.flatten(arguments)
    leaves = [jnp.asarray(leaf) for leaf in leaves]
    shapes = [jax.ShapeDtypeStruct(leaf.shape, leaf.dtype) for leaf in leaves]
    what = "\n".join([name, str(form), *map(str, shapes), jax.__version__, version.__version__, _source()])
    file = folder / hashlib.sha256(what.encode()).hexdigest()
    program = _read(file)
    if program is None:
        flat = jax.jit(lambda *leaves: function(*form.unflatten(leaves)))
        program = bytes(jax.export.export(flat)(*shapes).serialize())
        write_atomically(file, hashlib.sha256(program).digest() + program)
    return jax.jit(jax.export.deserialize(bytearray(program)).call)(*leaves)


def _folder() -> Path | None:
    """Beside the compiled programs, without which keeping traces is of little use."""
    compiled = getattr(jax.config, "jax_compilation_cache_dir", None)
    if not compiled or importlib.util.find_spec("flatbuffers") is None:
        return None
    folder = Path(compiled).parent / "programs"
    try:
        folder.mkdir(exist_ok=True)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK | os.X_OK) else None


def _read(file: Path) -> bytes | None:
    """The program in a file, or None where there is none or it was damaged."""
    try:
        content = file.read_bytes()
    except OSError:
        return None
    digest, program = content[:32], content[32:]
    return program if hashlib.sha256(program).digest() == digest else None


@functools.cache
def _source() -> str:
    """What tells one state of the package's source from another."""
    root = Path(__file__).parents[1]
    stats = ((file, file.stat()) for file in sorted(root.rglob("*.py")))
    return repr([(str(file), stat.st_size, stat.st_mtime_ns) for file, stat in stats])
