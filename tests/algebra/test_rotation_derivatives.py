"""First and second derivatives of the conversions, forward and reverse, at every singular attitude."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.derivatives import with_jacobians

from qtraj.algebra import quaternion, rotation

ROUND_OFF = 1e-14
DIFFERENCE = 1e-8  # central differences with step 1e-5

THERE_AND_BACK = {
    "direction cosines": lambda q: rotation.from_dcm(rotation.to_dcm(q)),
    "rotation vector": lambda q: rotation.from_rotation_vector(rotation.to_rotation_vector(q)),
    "mrp": lambda q: rotation.from_mrp(rotation.to_mrp(q)),
    "gibbs": lambda q: rotation.from_gibbs(rotation.to_gibbs(q)),
}
FROM_THREE = {
    "rotation vector": rotation.from_rotation_vector,
    "mrp": rotation.from_mrp,
    "gibbs": rotation.from_gibbs,
    "euler": lambda v: rotation.from_euler("ZYX", v),
}
EULER = ("xyz", "ZXZ", "XZY")


def batch(f):
    """Compiled without optimisation, which halves the time of a test that runs once."""
    return jax.jit(jax.vmap(f))


def first_derivatives(f, xs):
    """Forward and reverse."""
    return jax.tree.map(np.array, batch(lambda x: with_jacobians(f)(x)[1:])(xs))


def all_derivatives(f, xs):
    """Value, forward and reverse first derivatives, second derivatives."""
    return [np.array(y) for y in batch(lambda x: (*with_jacobians(f)(x), jax.hessian(f)(x)))(xs)]


def differences(f, xs, step=1e-5):
    shifts = step * jnp.eye(xs.shape[1])
    near = (xs[:, None, None, :] + jnp.stack([shifts, -shifts])[None]).reshape(-1, xs.shape[1])
    values = np.array(batch(f)(near))
    up, down = np.moveaxis(values.reshape(len(xs), 2, xs.shape[1], *values.shape[1:]), 1, 0)
    return np.moveaxis((up - down) / (2 * step), 1, -1)


@pytest.fixture(scope="module")
def unit(special):
    """Attitudes of norm 1.5, and λ/|λ| with its derivatives there."""
    qs = jnp.array(1.5 * special)
    return qs, all_derivatives(quaternion.unit, qs)


@pytest.mark.parametrize("name", THERE_AND_BACK)
def test_there_and_back_is_the_unit_quaternion_with_its_derivatives(name, unit):
    """The composition is ±λ/|λ| with its first and second derivatives, also at identity, half turns and ties."""
    qs, (_, direction, _, curvature) = unit[0], unit[1]
    value, forward, reverse, second = all_derivatives(THERE_AND_BACK[name], qs)
    sign = np.sign(np.sum(value * np.array(qs), axis=1))
    regular = slice(None) if name != "gibbs" else np.abs(qs[:, 0]) > 0.01  # half turns are tested separately
    expected = unit[1][0] * sign[:, None]
    np.testing.assert_allclose(value[regular], expected[regular], rtol=0, atol=ROUND_OFF)
    for slope in (forward, reverse):
        np.testing.assert_allclose((sign[:, None, None] * slope)[regular], direction[regular], rtol=0, atol=ROUND_OFF)
    second = sign[:, None, None, None] * second
    np.testing.assert_allclose(second[regular], curvature[regular], rtol=0, atol=10 * ROUND_OFF)


@pytest.mark.parametrize("f", [rotation.to_dcm, rotation.to_rotation_vector, rotation.to_mrp])
def test_conversions_do_not_change_along_the_scale(f, special):
    """Finite first and second derivatives, forward and reverse; f(cλ) = f(λ) makes f′λ = 0 and f″λ = −f′."""
    _, forward, reverse, second = all_derivatives(f, jnp.array(special))
    assert np.isfinite(second).all()
    np.testing.assert_allclose(forward, reverse, rtol=0, atol=ROUND_OFF)
    along = np.einsum("n...i,ni->n...", forward, special)
    np.testing.assert_allclose(along, np.zeros_like(along), rtol=0, atol=ROUND_OFF)
    curvature = np.einsum("n...ij,nj->n...i", second, special)
    np.testing.assert_allclose(curvature, -forward, rtol=0, atol=10 * ROUND_OFF)


@pytest.mark.parametrize("name", FROM_THREE)
def test_maps_from_three_parameters_are_smooth_at_zero_and_elsewhere(name):
    f = FROM_THREE[name]
    vs = jnp.array(np.concatenate([np.zeros((1, 3)), 1e-160 * np.eye(3), np.random.default_rng(3).normal(size=(9, 3))]))
    _, forward, reverse, second = all_derivatives(f, vs)
    np.testing.assert_allclose(forward, reverse, rtol=0, atol=ROUND_OFF)
    assert np.isfinite(second).all()
    np.testing.assert_allclose(forward, differences(f, vs), rtol=0, atol=DIFFERENCE)


CONVERSIONS = {
    "dcm": rotation.to_dcm,
    "rotation vector": rotation.to_rotation_vector,
    "mrp": rotation.to_mrp,
    "gibbs": rotation.to_gibbs,
    "gibbs from dcm": lambda q: rotation.gibbs_from_dcm(rotation.to_dcm(q)),
    "xyz": lambda q: rotation.to_euler(q, "xyz"),
    "ZXZ": lambda q: rotation.to_euler(q, "ZXZ"),
}


@pytest.mark.parametrize("name", CONVERSIONS)
def test_conversions_against_differences(name):
    """At four attitudes away from gimbal lock and half turns, where differences are accurate."""
    qs = jnp.array([[0.7, 0.4, -0.3, 0.5], [-0.6, 0.5, 0.4, 0.2], [0.9, 0.5, 0.1, -0.4], [1.4, -1.0, 0.8, 0.9]])
    forward, reverse = first_derivatives(CONVERSIONS[name], qs)
    np.testing.assert_allclose(forward, reverse, rtol=0, atol=10 * ROUND_OFF)
    np.testing.assert_allclose(forward, differences(CONVERSIONS[name], qs), rtol=0, atol=DIFFERENCE)


@pytest.mark.parametrize("seq", EULER)
def test_euler_angles_have_finite_derivatives_in_gimbal_lock(seq, special):
    """At the special attitudes, some of them locked, and at locked attitudes of the sequence."""
    lock = (0.0, np.pi) if seq[0] == seq[2] else (-np.pi / 2, np.pi / 2)
    angles = jnp.array([[a, b, c] for a in (0.0, 0.3, np.pi / 2, 3.0) for b in lock for c in (0.0, -1.1)])
    locked = batch(lambda x: rotation.from_euler(seq, x))(angles)
    qs = jnp.concatenate([locked, -locked, jnp.array(special)])
    forward, reverse = first_derivatives(lambda q: rotation.to_euler(q, seq), qs)
    assert np.isfinite(forward).all()
    size = np.abs(forward).max(axis=(1, 2), keepdims=True)  # near gimbal lock the derivatives are correctly large
    np.testing.assert_allclose(forward / size, reverse / size, rtol=0, atol=10 * ROUND_OFF)


def test_from_dcm_is_finite_at_ties_and_on_the_cube(special):
    matrices = batch(rotation.to_dcm)(jnp.array(special))
    forward, reverse = first_derivatives(rotation.from_dcm, matrices)
    assert np.isfinite(forward).all()
    np.testing.assert_allclose(forward, reverse, rtol=0, atol=ROUND_OFF)


def test_the_gibbs_vector_of_a_half_turn_is_infinite_without_nan():
    axes = [[1, 0, 0], [0, -1, 0], [0, 0, 1], [1, -2, 0], [1, 2, 3]]
    qs = np.array([[0.0, *axis] for axis in axes] + [[-0.0, *axis] for axis in axes] + [[1e-200, 1, 0, 0]])
    value = np.array(batch(rotation.to_gibbs)(jnp.array(qs)))
    for g, axis in zip(value[:10], axes + axes, strict=True):
        first = np.sign(axis)[np.nonzero(axis)[0][0]]
        expected = [0.0 if x == 0 else np.inf * x * first for x in axis]
        np.testing.assert_array_equal(g, expected)
    np.testing.assert_allclose(value[10], [1e200, 0, 0], rtol=1e-15)  # a long vector keeps its length
    for slope in first_derivatives(rotation.to_gibbs, jnp.array(qs)):
        np.testing.assert_array_equal(slope, np.zeros((11, 3, 4)))
    cosines = batch(rotation.to_dcm)(jnp.array(qs[:10]))
    np.testing.assert_array_equal(batch(rotation.gibbs_from_dcm)(cosines), value[:10])
    for slope in first_derivatives(rotation.gibbs_from_dcm, cosines):
        assert np.isfinite(slope).all()
