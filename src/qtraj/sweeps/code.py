"""Describe compiled functions: what they do, which global variables they read, and whether they are installed."""

import dis
import functools
import importlib.util
import sys
import sysconfig
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

_INSTALLED = (str(Path(sysconfig.get_path("stdlib")).resolve()), str(Path(__file__).parents[1].resolve()))
_PACKAGES = {"site-packages", "dist-packages"}
_GLOBAL = ("LOAD_GLOBAL", "LOAD_NAME", "LOAD_FROM_DICT_OR_GLOBALS")


def nested(code: types.CodeType) -> Iterator[types.CodeType]:
    """Yield a code object and all those of the functions, classes and comprehensions inside it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from nested(constant)


def meaning(code: types.CodeType) -> tuple[Any, ...]:
    """Return what compiled code does, without its names of files and numbers of lines."""
    constants = [meaning(x) if isinstance(x, types.CodeType) else x for x in code.co_consts]
    names = code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars
    counts = code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags
    return code.co_name, code.co_code, code.co_exceptiontable, constants, *names, *counts


def global_names(code: types.CodeType) -> list[str]:
    """Return the names of the global variables that code reads, in order."""
    found = (x for inner in nested(code) for x in dis.get_instructions(inner) if x.opname in _GLOBAL)
    return sorted({str(x.argval) for x in found})


def imported(code: types.CodeType) -> list[str]:
    """Return the names of the modules that code imports when it runs, in order."""
    found = (x for inner in nested(code) for x in dis.get_instructions(inner) if x.opname == "IMPORT_NAME")
    return sorted({str(x.argval) for x in found})


def file_of(module: str) -> str | None:
    """Return the file of a module by its name, without importing it; None if it has no file or does not exist."""
    loaded = sys.modules.get(module)
    if loaded is not None:
        return getattr(loaded, "__file__", None)
    try:
        spec = importlib.util.find_spec(module)
    except (ImportError, ValueError):
        return None
    return spec.origin if spec is not None and spec.has_location else None


def is_installed(thing: Any) -> bool:
    """Return whether a function, a class or a module is from Python, qtraj or another installed package."""
    if isinstance(thing, types.FunctionType):  # whose module may be that of a function which it wraps
        return is_installed_file(thing.__code__.co_filename)
    name = thing.__name__ if isinstance(thing, types.ModuleType) else getattr(thing, "__module__", None)
    if not isinstance(name, str) or name == "__main__":
        return False
    file = getattr(sys.modules.get(name), "__file__", None)
    if file is None:  # part of Python, or created by a program
        return isinstance(thing, type) or name.partition(".")[0] in sys.stdlib_module_names
    return is_installed_file(file)


@functools.lru_cache(maxsize=4096)
def is_installed_file(file: str) -> bool:
    """Return whether a file is part of Python, qtraj or another installed package."""
    if file.startswith("<"):  # such as "<stdin>" and "<frozen os>"
        return file.startswith("<frozen ")
    path = Path(file).resolve()
    return str(path).startswith(_INSTALLED) or not _PACKAGES.isdisjoint(path.parts)
