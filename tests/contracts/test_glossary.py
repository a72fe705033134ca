"""Words that the project has replaced by the standard term do not come back, in code or in prose.

Only words without an ordinary use are listed. Parts of names count: `lane_count` contains `lane`.
"""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

GLOSSARY = {
    "lane": "batch element",
    "lanes": "batch, batch elements",
    "pulls": "multipliers",
    "campaign": "multistart",
    "campaigns": "multistarts",
    "relief": "infeasibility advice",
    "slowness": "inv_speed",
    "narrowness": "inv_cross_norm",
    "summit": "refined maximum",
    "summits": "refined maxima",
    "Moves": "PathDerivatives",
    "carrying": "with_tangent_of",
    "moving_components": "components in the moving basis",
    "gibbs_gauge": "gibbs_normalization",
    "filler": "fallback value",
    "fillers": "fallback values",
    "sheet": "sign (branch) of the quaternion",
    "sheets": "signs (branches) of the quaternion",
    "gain_growth": "spectral_abscissa",
    "TurnChain": "SlewSequence",
    "qt.CubicSpline": "qt.MultiKnotCubic",
    "qtraj.CubicSpline": "qtraj.MultiKnotCubic",
    "rooms": "packages",
    "floors": "layers",
    "lest": "so that … not",
}
"""What is not written, and what is written instead."""

WORD = re.compile(rf"(?<![A-Za-z])(?:{'|'.join(GLOSSARY)})(?![A-Za-z])")

ORDINARY = re.compile(r"lane[ _-]changes?")
"""Ordinary uses: manoeuvres on a road."""

FORMER_NAMES = {
    ("src/qtraj/__init__.py", "TurnChain"),
    ("src/qtraj/motion/control/__init__.py", "gibbs_gauge"),
    ("src/qtraj/io/flat.py", "lane"),  # files written by earlier versions have this column
    ("src/qtraj/motion/programs/euler_turn.py", "TurnChain"),
    ("tests/contracts/test_help.py", "TurnChain"),
}
"""Files that must know a former name."""


def files():
    """Sources and pages; not this test, the tests of former names, and what is written by programs."""
    folders = {"src": "*.py", "docs": "*.md", "tests": "*.py", "notebooks": "*.py", "benchmarks": "*.py"}
    found = [file for folder, pattern in folders.items() for file in (ROOT / folder).rglob(pattern)]
    found += [
        *(ROOT / "docs").glob("*.py"),
        ROOT / "README.md",
        ROOT / "CONTRIBUTING.md",
        ROOT / "notebooks" / "README.md",
    ]
    left_out = {Path(__file__).name, "test_former_names.py"}
    return {str(file.relative_to(ROOT)): file for file in sorted(found) if file.name not in left_out}


FILES = files()


def words(name, text):
    """The words of the glossary in the text of a file, each as 'line: word'."""
    found = []
    for number, line in enumerate(text.splitlines(), 1):
        hits = [match[0] for match in WORD.finditer(ORDINARY.sub("", line))]
        found += [f"{number}: {hit}, better: {GLOSSARY[hit]}" for hit in hits if (name, hit) not in FORMER_NAMES]
    return found


@pytest.mark.parametrize("name", FILES)
def test_standard_terms_are_used(name):
    assert words(name, FILES[name].read_text(encoding="utf-8")) == []


@pytest.mark.parametrize("line", ["many lanes", "lane_count = 3", "qt.TurnChain", "x = lanes[0]", "the far sheet"])
def test_a_replaced_word_is_found(line):
    assert len(words("README.md", line)) == 1


@pytest.mark.parametrize("line", ["a lane change", "the planes", "stylesheets", "a spreadsheet", "lane_change"])
def test_ordinary_words_are_not(line):
    assert words("README.md", line) == []
