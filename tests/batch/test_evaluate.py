"""The batched façade gives what the single instants give, labelled."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.path.quantities import AXES

TIMES = np.linspace(0.0, 4.0, 7)
SHAPES = {"world": 3, "body": 3, "quaternion_component": 4}
EXACT = 1e-13


def helix(k: float = 0.0) -> qt.SpiralHelix:
    return qt.SpiralHelix(jnp.stack([20.0 + k, jnp.asarray(1.0)]), [0.2, 1.9], [1.0, 0.4, 0.05], 4.0)


@pytest.fixture(scope="module")
def stack():
    return jax.vmap(helix)(jnp.arange(3.0))


@pytest.fixture(scope="module")
def table():
    return qt.evaluate(helix(), TIMES, tuple(AXES))


def test_every_output_is_that_of_the_single_instant(table):
    for i, t in enumerate(TIMES):
        at = qt.trihedral(helix(), t)
        r = helix().derivatives(t, 3)
        expected = {
            "position": r[0],
            "velocity": r[1],
            "acceleration": r[2],
            "jerk": r[3],
            "dcm": at.dcm(),
            "quaternion": at.quaternion(),
            "gibbs": at.gibbs(),
            "speed": at.speed,
            "curvature": at.curvature,
            "torsion": at.torsion,
            "rate": at.rate,
            "angular_acceleration": at.acceleration,
            "defined": at.defined,
        }
        for name, value in expected.items():
            scale = max(1.0, np.abs(value).max())
            np.testing.assert_allclose(getattr(table, name)[i], value, rtol=0, atol=EXACT * scale, err_msg=name)


def test_shapes_of_one_path_and_of_many(table, stack):
    many = qt.evaluate(stack, TIMES, tuple(AXES))
    first = qt.evaluate(stack, TIMES, tuple(AXES), components="first")
    for name, axes in AXES.items():
        inner = tuple(SHAPES[axis] for axis in axes)
        assert getattr(table, name).shape == (7, *inner)
        assert getattr(many, name).shape == (3, 7, *inner)
        assert getattr(first, name).shape == (*inner, 3, 7)
        moved = np.moveaxis(np.asarray(getattr(first, name), float), range(-2, 0), range(2))
        np.testing.assert_allclose(moved, np.asarray(getattr(many, name), float), rtol=EXACT, atol=EXACT)


def test_only_what_was_asked_for_is_there():
    table = qt.evaluate(helix(), TIMES)
    given = [name for name in AXES if getattr(table, name) is not None]
    assert given == ["position", "velocity", "acceleration", "quaternion", "curvature", "torsion", "rate"]


def test_the_quaternion_is_continuous_on_request():
    times = np.linspace(0.0, 4.0, 200)  # more than a whole turn: the sign must change somewhere without it
    plain = qt.evaluate(helix(), times, ["quaternion"]).quaternion
    smooth = qt.evaluate(helix(), times, ["quaternion"], continuous=True).quaternion
    agreement = jnp.sum(smooth[1:] * smooth[:-1], axis=-1)
    assert float(jnp.min(agreement)) > 0.99
    assert float(jnp.min(jnp.sum(plain[1:] * plain[:-1], axis=-1))) < 0
    np.testing.assert_allclose(jnp.abs(jnp.sum(plain * smooth, axis=-1)), 1.0, atol=EXACT)


def test_another_frame_is_hung_on_request():
    table = qt.evaluate(helix(), TIMES, ["dcm"], frame=qt.Upright())
    np.testing.assert_allclose(table.dcm[3], qt.trihedral(helix(), TIMES[3], qt.Upright()).dcm(), atol=EXACT)


def test_any_hodograph_will_do():
    curve = qt.Curve(lambda t: jnp.stack([jnp.cos(t), jnp.sin(t), 0.5 * t]), 4.0)
    table = qt.evaluate(curve, TIMES, ["curvature", "torsion"])
    np.testing.assert_allclose(table.curvature, 0.8, rtol=1e-12)
    np.testing.assert_allclose(table.torsion, 0.4, rtol=1e-12)


@pytest.mark.parametrize("components", ["last", "first"])
def test_to_xarray_labels_and_keeps_every_number(stack, components):
    table = qt.evaluate(stack, TIMES, tuple(AXES), components=components)
    data = table.to_xarray()
    assert set(data.data_vars) == set(AXES)
    for name in AXES:
        np.testing.assert_array_equal(data[name].values, getattr(table, name))
        assert data[name].attrs["units"]
    assert data["position"].sel(world="z").dims == ("path", "time")
    assert data["time"].attrs["units"] == "s"
    assert "scalar first" in data.attrs["quaternion_convention"]


@pytest.mark.parametrize(
    ("arguments", "fragment"),
    [
        ({"outputs": "position"}, "sequence of names"),
        ({"outputs": ["colour"]}, "unknown output 'colour'"),
        ({"components": "middle"}, "'last' or 'first'"),
        ({"times": 3.0}, "vector (n,)"),
    ],
)
def test_bad_requests_are_refused_with_a_reason(arguments, fragment):
    with pytest.raises(ValueError) as caught:
        qt.evaluate(**({"paths": helix(), "times": TIMES} | arguments))
    assert fragment in str(caught.value)
