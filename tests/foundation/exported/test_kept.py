"""Programs are traced once for all processes: here, once for all decorations of one function."""

import dataclasses
import hashlib
import os
import sys
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

from qtraj.foundation.exported import kept as keeping
from qtraj.foundation.exported.kept import keep_in, kept


class Pair(NamedTuple):
    total: Array
    parts: dict


class Ramp(eqx.Module):
    slope: Array
    kind: object = eqx.field(static=True)


traced = []


def work(ramp, x, note=None):
    traced.append(ramp.kind)
    return Pair(jnp.asarray(ramp.slope, float) * jnp.sum(x.astype(float)), {"x": x + 1, "note": note})


@pytest.fixture
def folder(tmp_path):
    traced.clear()
    keep_in(tmp_path / "programs")
    yield tmp_path / "programs"
    keep_in(None)


@pytest.fixture
def once(folder):
    """What a process without any program in memory makes of a call."""

    def call(*given):
        keep_in(folder)
        return kept(Pair)(work)(*given)

    return call


def files(folder):
    return sorted(file for file in folder.rglob("*") if file.is_file()) if folder.exists() else []


def test_the_second_process_traces_nothing(folder, once):
    ramp, x = Ramp(jnp.asarray(2.0), "even"), jnp.arange(3.0)
    first, second = once(ramp, x), once(Ramp(jnp.asarray(3.0), "even"), x)
    assert traced == ["even"]
    assert isinstance(second, Pair)
    assert (float(first.total), float(second.total)) == (6.0, 9.0)
    np.testing.assert_array_equal(second.parts["x"], [1.0, 2.0, 3.0])
    assert second.parts["note"] is None
    assert not second.total.committed, "what takes it would be compiled again"
    assert len(files(folder)) == 1


@pytest.mark.parametrize(
    "other",
    [
        (Ramp(jnp.asarray(2.0), "odd"), jnp.arange(3.0)),
        (Ramp(jnp.asarray(2.0), "even"), jnp.arange(4.0)),
        (Ramp(jnp.asarray(2.0), "even"), jnp.arange(3)),
        (Ramp(jnp.asarray(2.0), "even"), jnp.arange(3.0), jnp.asarray(1.0)),
    ],
    ids=["static", "shape", "type", "structure"],
)
def test_what_the_program_depends_on_has_a_program_of_its_own(folder, once, other):
    once(Ramp(jnp.asarray(2.0), "even"), jnp.arange(3.0))
    once(*other)
    assert len(traced) == len(files(folder)) == 2


def test_another_precision_has_a_program_of_its_own(folder, once):
    numbers = np.arange(3, dtype=np.int32)
    once(Ramp(np.int32(2), "even"), numbers)
    with jax.enable_x64(not jax.config.read("jax_enable_x64")):
        once(Ramp(np.int32(2), "even"), numbers)
    assert len(traced) == 2


def test_arguments_without_a_lasting_name_are_compiled_as_ever(folder, once):
    assert float(once(Ramp(jnp.asarray(2.0), lambda: 0), jnp.ones(2)).total) == 4.0
    assert files(folder) == []


def test_within_a_trace_nothing_is_kept(folder, once):
    def total(slope):
        return once(Ramp(slope, "even"), jnp.ones(2)).total

    assert float(jax.grad(total)(jnp.asarray(3.0))) == 2.0
    assert float(jax.jit(total)(jnp.asarray(3.0))) == 6.0
    assert files(folder) == []


def undamaged(content):
    return hashlib.sha256(content).digest() + content


@pytest.mark.parametrize(
    "spoil",
    [
        lambda content: content[:-1],
        lambda content: b"",
        lambda content: b"x" * 99,
        lambda content: undamaged(b"no form"),
        lambda content: undamaged(b'"array"\nno program'),
    ],
    ids=["cut", "empty", "other", "formless", "void"],
)
def test_a_spoilt_program_is_traced_and_written_anew(folder, once, spoil):
    given = Ramp(jnp.asarray(2.0), "even"), jnp.arange(3.0)
    once(*given)
    (file,) = files(folder)
    whole = file.read_bytes()
    file.write_bytes(spoil(whole))
    assert float(once(*given).total) == 6.0
    assert len(traced) == 2
    once(*given)
    assert len(traced) == 2


def test_where_nothing_can_be_written_nothing_is_kept(tmp_path):
    (tmp_path / "programs").write_text("a file, where a folder should be")
    keep_in(tmp_path / "programs")
    try:
        assert float(kept(Pair)(work)(Ramp(jnp.asarray(2.0), "even"), jnp.ones(2)).total) == 4.0
    finally:
        keep_in(None)


def test_another_source_has_programs_of_its_own(folder, once, monkeypatch):
    given = Ramp(jnp.asarray(2.0), "even"), jnp.arange(3.0)
    once(*given)
    monkeypatch.setattr(keeping, "surroundings", lambda: "another")
    once(*given)
    assert len(traced) == len(files(folder)) == 2


def test_other_settings_have_programs_of_their_own(folder, once):
    given = Ramp(jnp.asarray(2.0), "even"), jnp.arange(3.0)
    once(*given)
    with jax.numpy_rank_promotion("warn"):
        once(*given)
    assert len(files(folder)) == 2


@dataclasses.dataclass(frozen=True)
class Plain:
    slope: np.ndarray


@pytest.mark.filterwarnings("ignore:A JAX array is being set as static")
@pytest.mark.parametrize("slope", [Ramp(jnp.asarray(2.0), "even"), Plain(np.asarray(2.0)), np.asarray(2.0)], ids=type)
def test_numbers_that_are_no_arguments_are_never_kept(folder, once, slope):
    """They would be those of the first process for ever."""
    once(Ramp(jnp.asarray(2.0), slope), jnp.ones(2))
    assert files(folder) == []


def test_threads_share_a_program(folder):
    call = kept(Pair)(work)
    given = [(Ramp(jnp.asarray(float(k)), "even"), jnp.ones(2)) for k in range(16)]
    with ThreadPoolExecutor(8) as pool:
        totals = list(pool.map(lambda arguments: float(call(*arguments).total), given))
    assert totals == [2.0 * k for k in range(16)]
    assert len(files(folder)) == 1


def test_what_is_returned_must_be_known(folder):
    class Unknown(NamedTuple):
        total: Array

    with pytest.raises(TypeError, match="Unknown"):
        kept()(lambda x: Unknown(jnp.sum(x)))(jnp.ones(2))


def test_an_error_of_the_function_is_its_own(folder):
    def fails(x):
        traced.append(x)
        raise ValueError("one number was expected")

    with pytest.raises(ValueError, match="one number"):
        kept()(fails)(jnp.ones(2))
    assert len(traced) == 1


def test_what_is_not_used_for_long_is_removed(folder, once, monkeypatch):
    old, young = folder / "old", folder / "young"
    for other in (old, young):
        other.mkdir(parents=True)
        (other / "program").write_bytes(b"")
    os.utime(old, (0, 0))
    once(Ramp(jnp.asarray(2.0), "even"), jnp.ones(2))
    assert not old.exists()
    assert young.exists()


def test_without_the_library_that_writes_them_nothing_is_kept(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "flatbuffers", None)
    keep_in(tmp_path / "programs")
    assert float(kept(Pair)(work)(Ramp(jnp.asarray(2.0), "even"), jnp.ones(2)).total) == 4.0
    assert files(tmp_path) == []
