"""The reference lists every public name, and every public name has a docstring."""

import importlib
import inspect
import re
import types
from pathlib import Path

import pytest

import qtraj
from qtraj.cli.main import application
from qtraj.viz import figures

DOCS = Path(__file__).parents[2] / "docs"
TEXT = "\n".join(page.read_text(encoding="utf-8") for page in sorted((DOCS / "reference").glob("*.md")))
DOCUMENTED = re.findall(r"(?m)^::: (\S+)$", TEXT)

MODULES = {"qtraj": qtraj, "qtraj.viz.figures": figures}
MODULES |= {f"qtraj.{n}": getattr(qtraj, n) for n in qtraj.__all__ if isinstance(getattr(qtraj, n), types.ModuleType)}
"""Modules with public names, by the names that users know."""


def public(module):
    """Public names of a module: those of `__all__`, or else those it defines, without modules and strings."""
    own = [name for name, thing in vars(module).items() if getattr(thing, "__module__", None) == module.__name__]
    names = getattr(module, "__all__", None) or [name for name in own if not name.startswith("_")]
    things = {name: getattr(module, name) for name in names}
    return {name: thing for name, thing in things.items() if not isinstance(thing, types.ModuleType | str)}


def resolve(identifier):
    """The object of a dotted name.

    **Raises:** AttributeError or ModuleNotFoundError where there is none.
    """
    parts, thing = identifier.split("."), qtraj
    for k, name in enumerate(parts[1:], 2):
        thing = getattr(thing, name) if hasattr(thing, name) else importlib.import_module(".".join(parts[:k]))
    return thing


def missing(module, documented):
    """Public names of a module that are not documented under any name."""
    objects = {id(resolve(identifier)) for identifier in documented}
    return sorted(name for name, thing in public(module).items() if id(thing) not in objects)


def undocumented(name, thing):
    """A public object and its public methods and properties, as far as they have no docstring."""
    text = thing.__dict__.get("__doc__") if inspect.isclass(thing) else thing.__doc__
    generated = inspect.isclass(thing) and (text or "").startswith(f"{thing.__name__}(")
    names = [name] if not (text or "").strip() or generated else []
    if inspect.isclass(thing):
        members = {k: v for k, v in inspect.getmembers(thing) if not k.startswith("_")}
        callables = {k: v for k, v in members.items() if isinstance(v, property) or inspect.isroutine(v)}
        names += [f"{name}.{k}" for k, v in callables.items() if not inspect.getdoc(v)]
    return names


@pytest.mark.parametrize("name", MODULES)
def test_every_public_name_is_in_the_reference(name):
    assert missing(MODULES[name], DOCUMENTED) == []


@pytest.mark.parametrize("name", MODULES)
def test_every_public_name_has_a_docstring(name):
    assert MODULES[name].__doc__
    assert [member for n, thing in public(MODULES[name]).items() for member in undocumented(f"{name}.{n}", thing)] == []


def test_every_submodule_and_the_version_are_named():
    assert [name for name in MODULES if f"`{name}`" not in TEXT and name != "qtraj"] == []
    assert "`qtraj.__version__`" in TEXT


def test_nothing_is_documented_twice():
    assert len(DOCUMENTED) > 130
    assert sorted(DOCUMENTED) == sorted(set(DOCUMENTED))
    things = [id(resolve(identifier)) for identifier in DOCUMENTED]
    assert len(set(things)) == len(things)


def test_every_command_is_on_a_page():
    page = (DOCS / "concepts" / "files.md").read_text(encoding="utf-8")
    names = [command.callback.__name__ for command in application().registered_commands]
    assert [name for name in names if f"| `qtraj {name} " not in page] == []


def test_the_check_detects_a_missing_name_and_a_missing_docstring():
    module = types.ModuleType("qtraj.fake")

    def documented():
        """Documented."""

    class Bare:
        def method(self): ...

    for thing in (documented, Bare):
        thing.__module__ = module.__name__
    module.documented, module.Bare, module._own = documented, Bare, documented
    assert missing(module, ["qtraj.tune"]) == ["Bare", "documented"]
    assert undocumented("documented", documented) == []
    assert undocumented("Bare", Bare) == ["Bare", "Bare.method"]
