"""Let `import qtraj` work without lazy_loader, on a machine where only JAX, its libraries and pytest are installed.

Import this module before qtraj. With lazy_loader installed, it does nothing.
"""

import ast
import importlib
import importlib.util
import sys
import types
from pathlib import Path


def attach(package, modules):
    """Return what `lazy_loader.attach` returns for the submodules of a package."""

    def attribute(name):
        if name in modules:
            return importlib.import_module(f"{package}.{name}")
        raise AttributeError(f"module {package} has no attribute {name}")

    return attribute, lambda: list(modules), list(modules)


def attach_stub(package, file):
    """Return what `lazy_loader.attach_stub` returns: names are imported from where the stub file imports them."""
    lines = ast.parse(Path(file).with_suffix(".pyi").read_text(encoding="utf-8")).body
    imports = [x for x in lines if isinstance(x, ast.ImportFrom) and x.level == 1]
    homes = {alias.name: f"{package}.{x.module}" for x in imports for alias in x.names}

    def attribute(name):
        if name in homes:
            return getattr(importlib.import_module(homes[name]), name)
        raise AttributeError(f"module {package} has no attribute {name}")

    return attribute, lambda: list(homes), list(homes)


if importlib.util.find_spec("lazy_loader") is None:
    own = types.ModuleType("lazy_loader")
    own.attach, own.attach_stub = attach, attach_stub
    sys.modules["lazy_loader"] = own
