"""Run the benchmarks of `python -m benchmarks` in pytest-benchmark, and store the table of each as extra information.

The fixture times each benchmark as a whole. Only the ratios in the table are meaningful, because there the candidates
alternate.
"""

import importlib
import os

import pytest

from .races import RACES

QUICK = bool(os.environ.get("QTRAJ_BENCHMARKS_QUICK"))


@pytest.mark.parametrize("name", RACES)
def test_race(benchmark, name):
    race = importlib.import_module(f"benchmarks.races.{name}")
    found = benchmark.pedantic(race.measure, args=(QUICK,), rounds=1, iterations=1)
    benchmark.extra_info |= {"race": name, **found._asdict()}
    assert found.rows
    assert all(row.keys() == found.rows[0].keys() for row in found.rows)
