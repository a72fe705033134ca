"""docs/errata.md and the tests it names belong together: no row without its test, no test without its row."""

import ast
import re
from pathlib import Path

HERE = Path(__file__).parent
TABLE = HERE.parents[1] / "docs" / "errata.md"


def defined(file):
    tree = ast.parse((HERE / file).read_text(encoding="utf-8"))
    names = [node.name for node in tree.body if isinstance(node, ast.FunctionDef)]
    return {f"{file}::{name}" for name in names if name.startswith("test_")}


def test_table_and_tests_agree():
    named = set(re.findall(r"`(test_\w+\.py::test_\w+)`", TABLE.read_text(encoding="utf-8")))
    files = ["test_errata_sakhno.py", "test_errata_chelnokov.py", "test_special_cases.py"]
    assert named == set().union(*(defined(file) for file in files))
