"""The page on accuracy names only tests and figures that exist."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCUMENT = (ROOT / "docs" / "accuracy.md").read_text(encoding="utf-8")


def functions_of(folder):
    """Names of the test functions under a folder."""
    trees = [ast.parse(file.read_text(encoding="utf-8")) for file in folder.rglob("test_*.py")]
    return {node.name for tree in trees for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_every_test_it_names_exists():
    named = set(re.findall(r"`(test_\w+)`", DOCUMENT))
    assert len(named) > 15
    assert named - functions_of(ROOT / "tests" / "motion") == set()


def test_every_file_it_names_exists():
    files = re.findall(r"[\w/]*test_\w+\.py", DOCUMENT)
    places = (ROOT, ROOT / "tests" / "motion")
    assert [name for name in files if not any((place / name).exists() for place in places)] == []
    figures = re.findall(r"\]\((figures/[^)]+)\)", DOCUMENT)
    assert [name for name in figures if not (ROOT / "docs" / name).exists()] == []
    assert len(figures) == 3


def test_every_table_is_filled():
    bodies = re.findall(r"<!-- ([a-z ]+) -->\n(.*?)<!-- end \1 -->", DOCUMENT, flags=re.DOTALL)
    assert [name for name, body in bodies if body.count("|") < 10] == []
    assert len(bodies) == 10
