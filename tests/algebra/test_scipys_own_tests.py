"""SciPy's own tests of `Rotation` pass with the formulas of qtraj in place of SciPy's."""

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

TESTS = "scipy.spatial.transform.tests.test_rotation"
OTHER_CONVENTIONS: dict[str, str] = {}
"""Tests of SciPy that fail because of another convention, and this convention; there are none."""


@pytest.mark.skipif(
    importlib.util.find_spec("scipy.spatial.transform.tests") is None or importlib.util.find_spec("hypothesis") is None,
    reason="this SciPy has no tests, or hypothesis, which they need, is not installed",
)
def test_they_pass(tmp_path):
    (tmp_path / "pytest.ini").touch()
    options = ["-c", "pytest.ini", "-p", "tests.algebra.scipy_with_ours", "-p", "no:cacheprovider", "-p", "no:xdist"]
    found = subprocess.run(
        [sys.executable, "-m", "pytest", *options, "-q", "-rfE", "--tb=short", "--pyargs", TESTS],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[2]), *sys.path])},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    ).stdout
    failed = re.findall(r"^(?:FAILED|ERROR) \S*::(\w+)", found, re.MULTILINE)
    assert set(failed) <= {*OTHER_CONVENTIONS}, found
    passed = re.search(r"(\d+) passed", found)
    assert passed is not None, found
    assert int(passed[1]) > 250
    calls = dict(re.findall(r"(\w+) (\d+)", found.partition("\nours:")[2].partition("\n")[0]))
    assert len(calls) == 13
    assert min(map(int, calls.values())) > 0
