"""Layers: a module imports from its own layer or a lower one, never from a higher one, and never in a cycle."""

import ast
import graphlib
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[2] / "src"
ROOT = "qtraj"

LAYERS = {
    "_version": 0,
    "foundation": 0,
    "algebra": 1,
    "path": 2,
    "motion": 3,
    "design": 4,
    "batch": 5,
    "sweep": 5,
    "io": 6,
    "viz": 6,
    "scenario": 6,
    "cli": 7,
    "__main__": 7,
}
TOP = 8  # the root package itself, which names everything below it


def layer(module):
    """The layer of a module by its dotted name; KeyError for a package that has no layer."""
    parts = module.split(".")
    return TOP if len(parts) == 1 else LAYERS[parts[1]]


def imported(code, module, is_package=False):
    """The modules of the package that `code` imports: anywhere in it, absolutely, relatively or by name.

    A name taken from a package may be a module or not: `qtraj.path.x` is listed for `from qtraj.path import x`.
    """
    package = module if is_package else module.rpartition(".")[0]
    found = []
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parent = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*parent, *([node.module] if node.module else [])])
            found += [base if alias.name == "*" else f"{base}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Call) and _called(node) in {"import_module", "__import__"}:
            found += [arg.value for arg in node.args[:1] if isinstance(arg, ast.Constant)]
    return [name for name in found if name == ROOT or name.startswith(f"{ROOT}.")]


def _called(node):
    return node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", None)


def upward(code, module, is_package=False):
    """The imports in `code` from layers above `module`."""
    own = layer(module)

    def above(name):
        if name.startswith(f"{ROOT}.") and name.split(".")[1] not in LAYERS:
            return own < TOP  # a public name, taken from the root
        return layer(name) > own

    return [name for name in imported(code, module, is_package) if above(name)]


def modules():
    """Dotted name → (file, whether it is a package) of every module in the source tree."""
    found = {}
    for file in sorted((SOURCE / ROOT).rglob("*.py")):
        parts = file.relative_to(SOURCE).with_suffix("").parts
        package = parts[-1] == "__init__"
        found[".".join(parts[:-1] if package else parts)] = (file, package)
    return found


MODULES = modules()


@pytest.mark.parametrize("module", sorted(MODULES.keys() - {ROOT}))
def test_imports_go_down(module):
    file, is_package = MODULES[module]
    assert upward(file.read_text(encoding="utf-8"), module, is_package) == []


def walk_in_order(sources):
    """Modules in an order in which each follows those it imports; graphlib.CycleError names the cycle if there is none.

    `sources`: dotted name → (code, whether it is a package).
    """
    graph = {}
    for module, (code, is_package) in sources.items():
        named = imported(code, module, is_package)
        targets = {name if name in sources else name.rpartition(".")[0] for name in named}
        graph[module] = (targets & sources.keys()) - {module, ROOT}
    return tuple(graphlib.TopologicalSorter(graph).static_order())


def test_no_cycles():
    sources = {module: (file.read_text(encoding="utf-8"), package) for module, (file, package) in MODULES.items()}
    assert set(walk_in_order(sources)) == MODULES.keys()


def test_the_check_finds_a_cycle():
    here = {"qtraj.path.a": ("from qtraj.path import b", False), "qtraj.path.b": ("from .a import x", False)}
    with pytest.raises(graphlib.CycleError):
        walk_in_order(here)


def test_every_package_has_a_layer():
    packages = {name.split(".")[1] for name in MODULES if "." in name}
    assert packages <= LAYERS.keys()


@pytest.mark.parametrize(
    ("code", "module", "is_package"),
    [
        ("import qtraj.motion.program", "qtraj.path.track", False),
        ("import qtraj", "qtraj.path.track", False),
        ("from qtraj import SpiralHelix", "qtraj.cli.main", False),
        ("from qtraj import motion", "qtraj.path.track", False),
        ("from qtraj.design.limits import Limits", "qtraj.motion.program", False),
        ("from ..motion import program", "qtraj.path.track", False),
        ("from ..motion.program import FrameProgram", "qtraj.path", True),
        ("from ... import motion", "qtraj.path.deep.module", False),
        ("def late():\n    from qtraj.io import tracks", "qtraj.foundation.document", False),
        ("if TYPE_CHECKING:\n    import qtraj.cli", "qtraj.batch.evaluate", False),
        ("from qtraj.cli import terminal", "qtraj.scenario.reader", False),
        ("import importlib\nimportlib.import_module('qtraj.batch')", "qtraj.algebra.quaternion", False),
    ],
)
def test_the_check_finds_an_import_that_goes_up(code, module, is_package):
    assert len(upward(code, module, is_package)) == 1


@pytest.mark.parametrize(
    ("code", "module"),
    [
        ("import jax\nfrom jax import numpy", "qtraj.foundation.types"),
        ("from qtraj.foundation.types import Vec3", "qtraj.algebra.vector"),
        ("from qtraj.algebra import quaternion", "qtraj.path.placement"),
        ("from . import hodograph", "qtraj.path.track"),
        ("from .hodograph import AbstractHodograph", "qtraj.path.track"),
        ("from qtraj._version import __version__", "qtraj.foundation.document"),
        ("from qtraj.io import tracks", "qtraj.cli.main"),
        ("from qtraj.scenario import reader", "qtraj.cli.slew"),
    ],
)
def test_the_check_accepts_the_others(code, module):
    assert upward(code, module) == []
