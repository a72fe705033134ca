"""Every notebook is a script and an .ipynb beside it: the same cells, without outputs.

After a change run `jupytext --update --to ipynb notebooks/*.py` (jupytext is in the extra `dev`), or save either of the
two in an editor with Jupytext. The scripts themselves are executed by .ci/run.
"""

import ast
import json
import re
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "notebooks"
SCRIPTS = {file.stem: file for file in sorted(FOLDER.glob("*.py"))}

MARKER = re.compile(r"^# %%(?: \[(markdown)\])?$")


def cells(script):
    """The cells of a percent script as (kind, source); magics of IPython are comments there."""
    _, *body = re.split(r"(?m)^(?=# %%)", script)
    found = []
    for block in body:
        marker, _, source = block.partition("\n")
        match = MARKER.match(marker)
        if match is None:
            raise ValueError(f"not a marker of a cell: {marker!r}")
        source = source.strip("\n")
        if match[1]:
            found.append(("markdown", re.sub(r"(?m)^# ?", "", source)))
        else:
            found.append(("code", re.sub(r"(?m)^# (?=%\w)", "", source)))
    return found


def notebook(name):
    return json.loads((FOLDER / f"{name}.ipynb").read_text(encoding="utf-8"))


def test_the_notebooks_are_found():
    assert {"00_two_papers", "10_recorded_turn", "50_tuning", "70_batches"} <= SCRIPTS.keys()
    assert {file.stem for file in FOLDER.glob("*.ipynb")} == SCRIPTS.keys()


@pytest.mark.parametrize("name", SCRIPTS)
def test_script_and_notebook_have_the_same_cells(name):
    paired = [(cell["cell_type"], "".join(cell["source"])) for cell in notebook(name)["cells"]]
    assert paired == cells(SCRIPTS[name].read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", SCRIPTS)
def test_outputs_are_stripped(name):
    code = [cell for cell in notebook(name)["cells"] if cell["cell_type"] == "code"]
    assert code
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)


@pytest.mark.parametrize("name", SCRIPTS)
def test_every_notebook_can_fail_and_uses_float64(name):
    script = SCRIPTS[name].read_text(encoding="utf-8")
    assert any(isinstance(node, ast.Assert) for node in ast.walk(ast.parse(script)))
    assert 'jax.config.update("jax_enable_x64", True)' in script
    assert script.startswith("# ---\n# jupyter:\n#   jupytext:\n#     formats: ipynb,py:percent\n")


def test_cells_are_split_at_their_markers():
    head, prose = "# ---\n# x: 1\n# ---\n\n", "# %% [markdown]\n# # A\n#\n# b\n\n"
    script = head + prose + "# %%\n# %matplotlib inline\nx = 1  # %\n\n\n# %%\ny\n"
    assert cells(script) == [("markdown", "# A\n\nb"), ("code", "%matplotlib inline\nx = 1  # %"), ("code", "y")]
    with pytest.raises(ValueError, match="not a marker"):
        cells("# %% something else\n")
