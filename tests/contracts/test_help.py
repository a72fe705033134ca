"""Names, signatures and values, as shown in an interactive session."""

import inspect
import io
import pydoc
import types

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt

LONGEST = 1200
"""Characters of a signature, on twelve lines of a terminal; the longest one is that of `Limits`."""
NAMES = [n for n in qt.__all__ if callable(getattr(qt, n)) and not isinstance(getattr(qt, n), types.ModuleType)]


def test_dir_lists_only_the_public_names():
    assert dir(qt) == sorted(qt.__all__)
    assert not {"Any", "importlib", "TYPE_CHECKING", "_HOMES"} & set(dir(qt))


@pytest.mark.parametrize(
    "module", [qt.control, qt.dynamics, qt.exchange, qt.quaternion, qt.rotation], ids=lambda m: m.__name__
)
def test_dir_of_a_module_lists_only_its_public_names(module):
    assert dir(module) == sorted(module.__all__)
    for name in dir(module):
        thing = getattr(module, name)
        assert not isinstance(thing, types.ModuleType)
        assert thing.__module__.startswith("qtraj.")


@pytest.mark.parametrize("name", NAMES)
def test_signatures_name_their_types(name):
    text = str(inspect.signature(getattr(qt, name)))
    for word in ("ndarray", "jaxlib", "jaxtyping", "Union[", "qtraj.", "collections."):
        assert word not in text
    assert len(text) <= LONGEST


def test_help_of_tune_begins_with_its_arguments():
    out = io.StringIO()
    pydoc.Helper(output=out).help(qt.tune)
    head = out.getvalue().partition("fixed:")[0]
    assert "duration: ArrayInput | None = None" in head.replace("'", "")
    assert len(head) < 500


def test_limits_show_values_and_units():
    assert repr(qt.Limits(curvature=0.1)) == "Limits(curvature=0.1 1/m)"
    assert repr(qt.Limits(speed=5, slope=0.06, jerk=2.5)) == "Limits(speed=5 m/s, slope=0.06 -, jerk=2.5 m/s³)"
    assert repr(qt.Limits()) == "Limits()"


def test_batched_and_traced_limits_can_be_shown():
    stacked = jax.vmap(lambda k: qt.Limits(curvature=k))(jnp.array([0.1, 0.2]))
    assert repr(stacked) == "Limits(curvature=[0.1, 0.2] 1/m)"
    seen = []
    jax.jit(lambda k: seen.append(repr(qt.Limits(curvature=k))) or k)(0.1)
    assert seen == ["Limits(curvature=weak_f64[])"]


def test_placements_and_frames_show_their_values():
    placed = repr(qt.Placement([1.0, 2.0, 0.5]))
    assert placed == "Placement(origin=[1, 2, 0.5] m, orientation=[1, 0, 0, 0])"
    assert repr(qt.Upright()) == "Upright(up=[0, 0, 1])"


@pytest.mark.parametrize(("former", "present"), [("TurnChain", "SlewSequence"), ("CubicSpline", "MultiKnotCubic")])
def test_former_names_warn_and_are_the_present_ones(former, present):
    with pytest.warns(DeprecationWarning, match=f"{former} is now called qtraj.{present}"):
        assert getattr(qt, former) is getattr(qt, present)
    assert former not in dir(qt)


def test_files_with_former_names_are_read(tmp_path):
    turns = qt.SlewSequence(np.eye(4)[:3], qt.MultiKnotCubic(9.0, max_rate=0.5))
    turns.save(tmp_path / "now.toml")
    text = (tmp_path / "now.toml").read_text()
    former = text.replace("SlewSequence", "TurnChain").replace("MultiKnotCubic", "CubicSpline")
    assert former.count("TurnChain") == former.count("CubicSpline") == 1
    (tmp_path / "then.toml").write_text(former)
    loaded = qt.load(tmp_path / "then.toml")
    assert isinstance(loaded, qt.SlewSequence)
    assert isinstance(loaded.law, qt.MultiKnotCubic)
