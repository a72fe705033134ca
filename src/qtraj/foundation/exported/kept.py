"""Functions whose traced programs are kept in a folder from one process to the next.

JAX's own cache spares a process the compiling, but not the tracing, which takes several times as long as loading what
was compiled. So a kept function is traced once for all processes: its program is written as StableHLO (`jax.export`),
under a name made of what it depends on. Where no folder is set, and for arguments without a lasting name, it is
`equinox.filter_jit` of the function, but for the weak types of results, which are lost.
"""

import functools
import importlib.util
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import equinox as eqx
import jax

from qtraj.foundation.exported.executable import traced
from qtraj.foundation.exported.names import name_of, surroundings
from qtraj.foundation.exported.store import Store

P = ParamSpec("P")
R = TypeVar("R")

_store: Store | None = None


def keep_in(folder: Path | None) -> None:
    """Keep traced programs in this folder, which is made when there is something to keep; None keeps none.

    To be called before what is kept is imported, for the source is looked at here; and by processes whose arguments are
    of this package's classes: of other classes the name is known, but no source. Without flatbuffers, the form of what
    `jax.export` writes, none are kept either.
    """
    global _store
    around = surroundings() if importlib.util.find_spec("flatbuffers") else None
    _store = None if folder is None or around is None else Store(folder / around)


def ahead(command: str | None) -> AbstractContextManager[None]:
    """While it is entered, load what the last run of this command used, in threads of their own; None loads nothing.

    Nothing either where JAX has kept nothing of what it compiled: then each of them would be compiled here.
    """
    if _store is None or command is None:
        return nullcontext()
    config: Any = jax.config
    compiled = config.jax_compilation_cache_dir
    return _store.ahead(command, load=compiled is not None and Path(compiled).is_dir())


def kept(*kinds: type) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Compile a function of pytrees, as `equinox.filter_jit` does, and keep its programs.

    It returns arrays, in tuples, lists, dictionaries, and the named tuples and modules of these kinds.
    """

    def of(f: Callable[P, R]) -> Callable[P, R]:
        compiled = eqx.filter_jit(f)

        @functools.wraps(f)
        def call(*given: P.args, **named: P.kwargs) -> R:
            store = _store
            name = None if named or store is None else name_of(f, given)
            if store is not None and name is not None:
                executable = store.executable(name, lambda: traced(f, given, kinds))
                if executable is not None:
                    return executable(given, kinds)
            return compiled(*given, **named)

        return call

    return of
