"""Documents round-trip exactly, reject unsupported types, and errors name the file."""

import os
import stat

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.foundation import document

AWKWARD = [0.1, 1 / 3, 2**-1074, 1.7976931348623157e308, -0.0]  # shortest, subnormal, largest, signed zero


def helix() -> qt.SpiralHelix:
    placement = qt.Placement([623000.125, 4848000.3, 150.7], [0.9, 0.1, -0.2, 0.3])
    return qt.SpiralHelix(AWKWARD, [0.1, 0.35], [1e-17, 0.2], 4.1, placement)


@pytest.mark.parametrize("suffix", [".toml", ".json"])
def test_round_trip_is_exact(tmp_path, suffix):
    path = helix()
    path.save(tmp_path / f"path{suffix}")
    again = qt.load(tmp_path / f"path{suffix}")
    assert jax.tree.structure(path) == jax.tree.structure(again)
    for a, b in zip(jax.tree.leaves(path), jax.tree.leaves(again), strict=True):
        assert np.asarray(a).tobytes() == np.asarray(b).tobytes()


@pytest.mark.parametrize("suffix", [".toml", ".json"])
def test_nan_and_infinity_are_kept(tmp_path, suffix):
    certificate = qt.Certificate(["speed"] * 3, [2] * 3, [jnp.inf, -jnp.inf, jnp.nan], [1.0, 2.0, 3.0], [1.0] * 3)
    document.save(certificate, tmp_path / f"certificate{suffix}")
    times = qt.load(tmp_path / f"certificate{suffix}").times
    np.testing.assert_array_equal(times, [np.inf, -np.inf, np.nan])


def test_loading_without_float64_warns(tmp_path):
    qt.SpiralHelix([1 / 3], [0.0, 1.0], [0.0], 1.0).save(tmp_path / "path.toml")
    jax.config.update("jax_enable_x64", False)
    try:
        with pytest.warns(UserWarning, match="rounded to float32"):
            qt.load(tmp_path / "path.toml")
    finally:
        jax.config.update("jax_enable_x64", True)


def test_a_file_is_replaced_at_once(tmp_path):
    file = tmp_path / "path.toml"
    file.write_text("old")
    helix().save(file)
    assert isinstance(qt.load(file), qt.SpiralHelix)
    assert stat.S_IMODE(file.stat().st_mode) & 0o444
    assert os.listdir(tmp_path) == ["path.toml"]


@pytest.mark.parametrize(
    ("name", "text", "fragment"),
    [
        ("a.toml", "x = [1, ", "not valid TOML"),
        ("a.json", "{", "not valid JSON"),
        ("a.toml", "x = 1", "'format' must be 'qtraj/1'"),
        ("a.json", "[1]", "'format' must be 'qtraj/1'"),
        (
            "a.toml",
            'format = "qtraj/1"\ntype = "Nothing"',
            "unknown type 'Nothing'; if it is an own class, import the module",
        ),
        ("a.toml", 'format = "qtraj/1"\ntype = "SpiralHelx"', "unknown type 'SpiralHelx'; did you mean 'SpiralHelix'?"),
        ("a.toml", 'format = "qtraj/1"\ntype = "Placement"\ncolour = 1', "no field 'colour'"),
        ("a.toml", 'format = "qtraj/1"\ntype = "Placement"\norigin = [0, 0]', "shape (3,)"),
        ("a.toml", 'format = "qtraj/1"\ntype = "SpiralHelix"\nradius = [1.0]', "SpiralHelix lacks the field 'angle'"),
        ("a.txt", "", "must end in .toml or .json"),
    ],
)
def test_a_bad_file_is_named(tmp_path, name, text, fragment):
    file = tmp_path / name
    file.write_text(text)
    with pytest.raises(ValueError) as caught:
        qt.load(file)
    assert str(file) in str(caught.value)
    assert fragment in str(caught.value)


def test_a_missing_file_is_an_os_error(tmp_path):
    with pytest.raises(FileNotFoundError):
        qt.load(tmp_path / "nothing.toml")


def test_a_path_with_a_function_cannot_be_stored(tmp_path):
    curve = qt.Curve(lambda t: jnp.stack([t, t, t]), 1.0)
    with pytest.raises(ValueError, match="Curve cannot be stored"):
        curve.save(tmp_path / "curve.toml")
    assert not os.listdir(tmp_path)
