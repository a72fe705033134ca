"""`import qtraj` imports nothing before it is needed, and its lazy names agree with those for the type checker."""

import ast
import importlib
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import qtraj as qt
from qtraj.io import stored

HEAVY = ("diffrax", "optax", "optimistix", "lineax")
EXTRAS = ("typer", "rich", "pydantic", "xarray", "h5netcdf", "h5py", "zarr", "pyarrow", "matplotlib", "plotly", "scipy")
TREE = ast.parse(inspect.getsource(qt))


def loaded(code, names):
    """Which of `names` a fresh interpreter has imported after `code`."""
    listing = f"import sys; {code}; print(*[n for n in {names!r} if n in sys.modules])"
    run = subprocess.run([sys.executable, "-c", listing], capture_output=True, text=True, check=True)
    return run.stdout.split()


def test_the_import_is_lazy():
    assert loaded("import qtraj", ("jax", "equinox", *HEAVY, *EXTRAS)) == []


def test_public_names_import_no_solvers_and_extras():
    assert loaded("import qtraj as qt; [getattr(qt, name) for name in qt.__all__]", HEAVY + EXTRAS) == []


def test_the_check_detects_an_import():
    assert loaded("import qtraj, optax", HEAVY) == ["optax"]


def test_the_names_agree_with_those_for_the_type_checker():
    [block] = [node for node in TREE.body if isinstance(node, ast.If) and isinstance(node.test, ast.Name)]
    seen = {alias.name: node.module for node in block.body for alias in node.names}
    lazy = {name: home for home, names in qt._HOMES.items() for name in names}
    modules = {name: home.rpartition(".")[0] for name, home in qt._MODULES.items() if name not in qt._PACKAGES}
    assert lazy | modules == seen
    assert {*seen, "__version__"} == set(qt.__all__) <= set(dir(qt))
    assert all(getattr(qt, name) is getattr(importlib.import_module(lazy[name]), name) for name in lazy)


def test_the_packages_are_the_folders():
    assert set(qt._PACKAGES) == {file.parent.name for file in Path(inspect.getfile(qt)).parent.glob("*/__init__.py")}


def test_an_unknown_name_is_refused():
    with pytest.raises(AttributeError, match="no attribute 'evaluated'"):
        qt.evaluated  # noqa: B018


def test_every_storable_class_can_be_loaded():
    """The list of `io.stored` has every module with a storable class."""
    root = Path(inspect.getfile(qt)).parent
    files = [file for file in root.rglob("*.py") if "\n@storable\n" in file.read_text(encoding="utf-8")]
    assert {".".join(["qtraj", *file.relative_to(root).with_suffix("").parts]) for file in files} == set(stored.HOMES)
