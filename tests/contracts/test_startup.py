"""`import qtraj` imports nothing before it is needed, and its lazy names agree with those for the type checker."""

import ast
import importlib
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

import qtraj as qt
from qtraj.io import stored

HEAVY = ("diffrax", "optax", "optimistix", "lineax")
EXTRAS = ("typer", "rich", "pydantic", "xarray", "h5netcdf", "h5py", "zarr", "pyarrow", "matplotlib", "plotly", "scipy")
PACKAGES = ("algebra", "io", "motion")
"""Packages with modules that are public names."""
STUB = ast.parse(Path(inspect.getfile(qt)).with_suffix(".pyi").read_text(encoding="utf-8"))


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


def test_the_names_of_the_stub_are_the_public_names():
    seen = {
        alias.name: node.module for node in ast.walk(STUB) if isinstance(node, ast.ImportFrom) for alias in node.names
    }
    assert {*seen, "__version__"} == set(qt.__all__) == set(dir(qt))
    for name, home in seen.items():
        found = getattr(qt, name)
        if home is None:  # a package of the root
            assert found is importlib.import_module(f"qtraj.{name}")
            continue
        module = importlib.import_module(f"qtraj.{home}")
        assert found is (importlib.import_module(f"qtraj.{home}.{name}") if home in PACKAGES else getattr(module, name))


def test_the_packages_are_the_folders():
    assert set(qt._PACKAGES) == {file.parent.name for file in Path(inspect.getfile(qt)).parent.glob("*/__init__.py")}


def test_no_package_hides_a_public_name():
    """Importing a module of a package sets the name of the package, which a function of that name would lose."""
    hidden = {name for name in qt._PACKAGES if name in qt.__all__ and getattr(qt, name).__name__ != f"qtraj.{name}"}
    assert hidden == set()


def test_an_unknown_name_is_refused():
    with pytest.raises(AttributeError, match="no attribute 'evaluated'"):
        qt.evaluated  # noqa: B018


def test_every_storable_class_can_be_loaded():
    """The list of `io.stored` has every module with a storable class."""
    root = Path(inspect.getfile(qt)).parent
    files = [file for file in root.rglob("*.py") if re.search(r"^@stor(able$|ed_as\()", file.read_text("utf-8"), re.M)]
    assert {".".join(["qtraj", *file.relative_to(root).with_suffix("").parts]) for file in files} == set(stored.HOMES)
