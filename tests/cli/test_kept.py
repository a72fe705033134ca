"""Programs kept between runs: traced once, found again, never trusted when damaged."""

import importlib.util

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from qtraj.cli import kept as keeping
from qtraj.cli.kept import kept
from qtraj.cli.tuning import search as searching
from qtraj.cli.tuning.job import Choice, lay
from qtraj.cli.tuning.search import search
from qtraj.design.proof.certify import certify
from qtraj.design.tuning.tune import tune
from qtraj.io.scenario import DEFAULT, read_scenario
from qtraj.io.scenario_model import Scenario

SAME = 1e-9
"""Of numbers that two compilations of one search give."""


@pytest.fixture
def programs(tmp_path, monkeypatch):
    """The folder of kept programs; without flatbuffers nothing is ever kept, which has a test of its own."""
    pytest.importorskip("flatbuffers", reason="programs are kept where the package flatbuffers is installed")
    monkeypatch.setattr(keeping, "_folder", lambda: tmp_path)
    return tmp_path


def counted(calls):
    def function(numbers, x):
        calls.append(x.shape)
        return {"sum": numbers[0] + jnp.sum(x), "pair": (x, 2 * x)}

    return function


def test_a_program_is_traced_once(programs):
    calls, x = [], np.arange(3.0)
    for _ in range(3):
        found = kept("sum", counted(calls), (1.0,), x)
        assert float(found["sum"]) == 4.0
        np.testing.assert_array_equal(found["pair"][1], 2 * x)
    assert len(calls) == 1
    kept("sum", counted(calls), (1.0,), np.arange(4.0))
    kept("another", counted(calls), (1.0,), x)
    assert len(calls) == len(list(programs.iterdir())) == 3


def test_a_damaged_program_is_traced_again(programs):
    calls, x = [], np.arange(3.0)
    kept("sum", counted(calls), (1.0,), x)
    [file] = programs.iterdir()
    content = file.read_bytes()
    for damaged in (content[:-1], b"", content[:40] + b"?" + content[41:]):
        file.write_bytes(damaged)
        assert float(kept("sum", counted(calls), (1.0,), x)["sum"]) == 4.0
        kept("sum", counted(calls), (1.0,), x)
    assert len(calls) == 4


@pytest.mark.parametrize("lacks", ["cache", "flatbuffers"])
def test_nothing_is_kept_without_a_cache_or_flatbuffers(lacks, monkeypatch, tmp_path):
    folder = None if lacks == "cache" else str(tmp_path / "jax")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if lacks == name else object())
    before = jax.config.jax_compilation_cache_dir
    jax.config.update("jax_compilation_cache_dir", folder)
    try:
        assert kept("sum", counted([]), (1.0,), np.arange(3.0)) is None
    finally:
        jax.config.update("jax_compilation_cache_dir", before)
    assert list(tmp_path.iterdir()) == []


def test_the_search_in_one_program_is_that_of_its_parts(default_run, monkeypatch):
    job = lay(read_scenario(DEFAULT, Scenario), Choice())
    assert search(job) is None  # the tests keep nothing
    monkeypatch.setattr(searching, "kept", lambda name, function, *arguments: function(*arguments))
    before, best = search(job)
    whole = tune(**job.tuning())
    leaves = [jax.tree.leaves(x) for x in ((before, best), (certify(job.path, job.limits), whole))]
    assert jax.tree.structure(best) == jax.tree.structure(whole)
    for ours, theirs in zip(*leaves, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=SAME, atol=SAME)


def test_a_search_that_fails_is_left_to_its_parts(monkeypatch):
    job = lay(read_scenario(DEFAULT, Scenario), Choice())
    monkeypatch.setattr(searching, "kept", lambda *_: {"outcome": (0.0, searching.CONVERGED + 1, 3)})
    assert search(job) is None
