"""Every notebook is a script and an .ipynb with the same cells and their outputs.

After a change run `python docs/notebooks.py`. `.ci/run` executes all notebooks and compares their outputs with the
stored ones: `python docs/notebooks.py --check`.
"""

import ast
import importlib.util
import json
import re
import sys
from pathlib import Path

import pytest
import xarray
from matplotlib.figure import Figure

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "notebooks"
SCRIPTS = {file.stem: file for file in sorted(FOLDER.glob("*.py"))}
LARGEST = 750_000
"""Maximum bytes of an .ipynb, to keep the repository small."""

PRIVATE = re.compile(r"/(home|root|tmp|Users|var|opt|mnt)/|site-packages|[A-Z]:\\\\|0x[0-9a-f]{6}|\b\d\d:\d\d:\d\d\b")
"""Paths, memory addresses and times of the machine that executed a notebook."""


def load(file):
    spec = importlib.util.spec_from_file_location(file.stem, file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


books = load(ROOT / "docs" / "notebooks.py")


def script(name):
    return SCRIPTS[name].read_text(encoding="utf-8")


def notebook(name):
    return json.loads((FOLDER / f"{name}.ipynb").read_text(encoding="utf-8"))


def code_cells(name):
    return [cell for cell in notebook(name)["cells"] if cell["cell_type"] == "code"]


def test_the_notebooks_are_found():
    assert {"00_two_papers", "10_recorded_turn", "50_tuning", "70_batches"} <= SCRIPTS.keys()
    assert {file.stem for file in FOLDER.glob("*.ipynb")} == SCRIPTS.keys()


@pytest.mark.parametrize("name", SCRIPTS)
def test_script_and_notebook_have_the_same_cells(name):
    paired = [(cell["cell_type"], "".join(cell["source"])) for cell in notebook(name)["cells"]]
    assert paired == books.cells(script(name))


@pytest.mark.parametrize("name", SCRIPTS)
def test_every_cell_was_executed_in_its_present_form(name):
    """If the code has changed since, run `python docs/notebooks.py`."""
    assert notebook(name)["metadata"]["qtraj"][books.DIGEST] == books.digest(books.cells(script(name)))
    assert [cell["execution_count"] for cell in code_cells(name)] == list(range(1, len(code_cells(name)) + 1))


@pytest.mark.parametrize("name", SCRIPTS)
def test_figures_and_numbers_are_stored(name):
    outputs = [output for cell in code_cells(name) for output in cell["outputs"]]
    assert {output["output_type"] for output in outputs} == {"stream", "execute_result"}
    assert {output["name"] for output in outputs if output["output_type"] == "stream"} == {"stdout"}
    assert any("image/png" in output.get("data", {}) for output in outputs)


@pytest.mark.parametrize("name", SCRIPTS)
def test_outputs_are_small_and_do_not_identify_the_machine(name):
    assert (FOLDER / f"{name}.ipynb").stat().st_size < LARGEST
    for cell in code_cells(name):
        for output in cell["outputs"]:
            shown = {"text": output.get("text", []), **output.get("data", {})}
            for kind, text in shown.items():
                assert kind == "image/png" or not PRIVATE.search("".join(text))


@pytest.mark.parametrize("name", SCRIPTS)
def test_every_notebook_can_fail_and_uses_float64(name):
    assert any(isinstance(node, ast.Assert) for node in ast.walk(ast.parse(script(name))))
    assert 'jax.config.update("jax_enable_x64", True)' in script(name)
    assert script(name).startswith("# ---\n# jupyter:\n#   jupytext:\n#     formats: ipynb,py:percent\n")


def test_cells_are_split_at_their_markers():
    head, prose = "# ---\n# x: 1\n# ---\n\n", "# %% [markdown]\n# # A\n#\n# b\n\n"
    text = head + prose + "# %%\n# %matplotlib inline\nx = 1  # %\n\n\n# %%\ny\n"
    assert books.cells(text) == [("markdown", "# A\n\nb"), ("code", "%matplotlib inline\nx = 1  # %"), ("code", "y")]
    with pytest.raises(ValueError, match="not a cell marker"):
        books.cells("# %% something else\n")


PROSE, CODE = "# %% [markdown]\n# About\n\n", "# %%\nimport sys\nprint(1 / 3)\nprint(0.1, file=sys.stderr)\n{'a': 2}\n"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with one notebook, stored; `_executed` executes in this process."""
    monkeypatch.setattr(books, "FOLDER", tmp_path)
    monkeypatch.setattr(books, "_executed", books.execute)
    monkeypatch.setitem(sys.modules, "__main__", sys.modules["__main__"])
    (tmp_path / "a.py").write_text(PROSE + CODE)
    assert books._store("a")
    return tmp_path


def stored(folder):
    return json.loads((folder / "a.ipynb").read_text())


def test_printed_text_and_the_last_expression_are_stored(folder):
    prose, code = stored(folder)["cells"]
    assert "outputs" not in prose
    printed, result = code["outputs"]
    assert printed == {"name": "stdout", "output_type": "stream", "text": ["0.3333333333333333\n"]}
    assert (result["data"], result["execution_count"]) == ({"text/plain": ["{'a': 2}"]}, 1)
    before = (folder / "a.ipynb").read_bytes()
    books._store("a")
    assert (folder / "a.ipynb").read_bytes() == before


def test_the_check_detects_other_numbers_and_writes_nothing(folder, capsys):
    assert books._check("a")
    (folder / "a.py").write_text(PROSE + CODE.replace("1 / 3", "1 / 4"))
    before = (folder / "a.ipynb").read_bytes()
    assert not books._check("a")
    assert "code cell 1: stored is\n0.333" in capsys.readouterr().out
    assert (folder / "a.ipynb").read_bytes() == before


def test_changed_prose_is_stored_without_executing_but_changed_code_is_not(folder, monkeypatch):
    monkeypatch.delattr(books, "_executed")
    before = stored(folder)["cells"]
    (folder / "a.py").write_text(PROSE + "# More\n\n" + CODE)
    assert books._store_prose("a")
    after = stored(folder)["cells"]
    assert after[0]["source"] == ["About\n", "\n", "More"]
    assert after[1] == before[1]
    (folder / "a.py").write_text(PROSE + CODE + "2\n")
    assert not books._store_prose("a")
    assert stored(folder)["cells"] == after


def test_a_cell_that_fails_stores_nothing(monkeypatch, capfd, tmp_path):
    """The notebook does not exist, so its process fails."""
    monkeypatch.setattr(books, "ENVIRONMENT", {"PYTHONPATH": str(tmp_path)})
    assert not books._store("no_such_notebook")
    assert "FileNotFoundError" in capfd.readouterr().err
    assert not (FOLDER / "no_such_notebook.ipynb").exists()


def test_tracebacks_name_the_cell():
    namespace = {"__name__": "__main__"}
    with pytest.raises(ZeroDivisionError) as caught:
        books._outputs("%matplotlib inline\ndef f():\n    return 1 / 0\n\n\nf()", "<cell 1>", namespace)
    last = caught.traceback[-1]
    assert (str(last.path), last.lineno + 1) == ("<cell 1>", 3)


def test_figures_are_pictures_and_datasets_are_text():
    figure = Figure(figsize=(2, 1))
    figure.subplots().plot([0, 1], [0, 1])
    shown = books.shown(figure)
    assert shown["image/png"].startswith("iVBOR")
    assert shown == books.shown(figure)
    assert len(shown["image/png"]) < 10_000
    assert books.shown(xarray.Dataset()).keys() == {"text/plain"}


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("0.3333 m", "0.3334 m"),
        ("error 2.8e-16", "error 1.1e-15"),
        ("gap −3e-17", "gap 4e-17"),
        ("converged in 139 steps", "converged in 171 steps"),
        ("2 … 73 steps", "1 … 81 steps"),
        ("jax 0.10.2, numpy 2.4.6", "jax 0.11.0rc1, numpy 2.5.0"),
        ("[1.   0.5]", "[1. 0.5]"),
    ],
)
def test_rounding_is_not_a_difference(before, after):
    assert books.agree(before, after)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("0.333 m", "0.433 m"),
        ("0.333 m", "-0.333 m"),
        ("0.333 m", "0.333 s"),
        ("error 2.8e-16", "error 2.8e-5"),
        ("converged in 139 steps", "not converged in 139 steps"),
        ("[1. 0.5]", "[1. 0.5 0.2]"),
        ("8 of 9", "9 of 9"),
        ("x1", "x2"),
    ],
)
def test_differences_are_detected(before, after):
    assert not books.agree(before, after)
