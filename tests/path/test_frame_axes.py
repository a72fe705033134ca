"""Coordinates, columns and attributes of datasets are labelled by the axes of the frame."""

import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.io.dataset import path_dataset
from qtraj.io.flat import flatten
from qtraj.motion.programs.rotation_minimizing import frame_named, name_of
from qtraj.path.frame_components import Basis
from qtraj.path.trihedral import AbstractFrame

HELIX = qt.SpiralHelix([10.0, 0.0], [0.2, 0.4], [1.0, 0.5], 6.0)
TIMES = np.linspace(0.0, 6.0, 13)
ALL = ("position", "dcm", "quaternion", "rate", "gibbs", "defined")


class Own(AbstractFrame):
    """A user's own frame."""

    def trihedral(self, r, duration):
        return qt.Upright().trihedral(r, duration)


NAMES = {
    "natural": (qt.Natural(), ["tangent", "normal", "binormal"], "y = principal normal, z = binormal"),
    "upright": (qt.Upright(), ["forward", "left", "up"], "y = left (level), z = up"),
    "rotation-minimizing": (qt.RotationMinimizing(), ["tangent", "first", "second"], "no rotation about x"),
    "own": (Own(), ["x", "y", "z"], "the axes of the frame"),
}


@pytest.mark.parametrize("name", NAMES)
def test_a_table_has_the_labels_of_its_frame(name):
    frame, labels, convention = NAMES[name]
    dataset = qt.evaluate(HELIX, TIMES, ALL, frame=frame).to_xarray()
    assert dataset["body"].values.tolist() == labels
    assert dataset.attrs["frame"] == name
    assert convention in dataset.attrs["frame_convention"]
    assert [f"rate_{label}" for label in labels] == [c for c in flatten(dataset).columns if c.startswith("rate")]


@pytest.mark.parametrize("name", NAMES)
def test_a_dataset_of_paths_has_the_labels_of_its_frame(name):
    frame, labels, convention = NAMES[name]
    dataset = path_dataset({"a": HELIX}, samples=9, frame=frame)
    assert dataset["body"].values.tolist() == labels
    assert convention in dataset.attrs["frame_convention"]
    assert not np.isnan(dataset["rate"].values).any()


def test_peaks_have_the_labels_of_their_frame():
    peaks = qt.evaluate(HELIX, TIMES, ("rate",), frame=qt.Upright(), reduce="max").to_xarray()
    assert float(peaks["rate"].sel(body="up")) == pytest.approx(0.4 * np.cos(np.arctan(0.5 / 4.0)))


def test_the_default_frame_is_upright_with_a_recording_and_natural_without():
    track = qt.Track(TIMES, np.stack([10 * np.cos(0.2 + 0.4 * TIMES), 10 * np.sin(0.2 + 0.4 * TIMES), TIMES], axis=1))
    assert path_dataset({"a": HELIX}, samples=9).attrs["frame"] == "natural"
    assert path_dataset({"a": HELIX}, track=track, samples=9).attrs["frame"] == "upright"


@pytest.mark.parametrize("components", ["last", "first"])
def test_a_rotation_minimizing_table_agrees_with_its_program(components):
    program = qt.FrameProgram(HELIX, qt.RotationMinimizing())
    table = qt.evaluate(HELIX, TIMES, ALL, frame=qt.RotationMinimizing(), components=components)
    front = components == "first"
    for k, t in enumerate(TIMES):
        at = program(t)
        expected = {"quaternion": at.quaternion, "rate": at.rate, "dcm": qt.rotation.to_dcm(at.quaternion)}
        for name, value in expected.items():
            actual = getattr(table, name)
            np.testing.assert_allclose(actual[..., k] if front else actual[k], value, atol=1e-12)
    rolling = table.rate[0] if front else table.rate[:, 0]
    assert np.array_equal(rolling, np.zeros(len(TIMES)))
    assert bool(jnp.all(table.defined))


def test_many_rotation_minimizing_frames_agree_with_single_ones():
    import jax

    stack = jax.tree.map(lambda *x: jnp.stack(x), HELIX, qt.SpiralHelix([12.0, 0.0], [0.1, 0.3], [0.0, 0.2], 6.0))
    table = qt.evaluate(stack, TIMES, ALL, frame=qt.RotationMinimizing())
    single = qt.evaluate(HELIX, TIMES, ALL, frame=qt.RotationMinimizing())
    np.testing.assert_allclose(table.quaternion[0], single.quaternion, atol=1e-12)
    assert table.dcm.shape == (2, 13, 3, 3)


def test_a_rotation_minimizing_frame_with_reduce_is_an_error():
    with pytest.raises(ValueError, match="integrated along the path, so it supports neither reduce nor reuse"):
        qt.evaluate(HELIX, TIMES, ALL, frame=qt.RotationMinimizing(), reduce="max")


def test_a_basis_with_a_placement_alone_converts_vectors():
    placement, v = qt.Placement((1.0, 2.0, 3.0), (1.0, 2.0, 3.0, 4.0)), jnp.array([1.0, -2.0, 0.5])
    basis = Basis(placement=placement)
    world = basis.world(tuple(v))
    np.testing.assert_allclose(world, placement.to_world(v), rtol=0, atol=1e-15)
    np.testing.assert_allclose(basis.local(world), v, rtol=0, atol=1e-15)


@pytest.mark.parametrize("name", ["natural", "upright", "rotation-minimizing", "thrust-aligned"])
def test_a_frame_by_its_name(name):
    assert name_of(frame_named(name)) == name
    with pytest.raises(ValueError, match="unknown frame 'forward': the frames are upright, natural"):
        frame_named("forward")
