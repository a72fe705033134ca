"""The algebra in NumPy and in JAX: the same values for single quaternions and batches, and no compilation in NumPy."""

import jax
import numpy as np
import pytest

from qtraj.algebra import cosines, dual_quaternion, matrices, quaternion, rotation

RNG = np.random.default_rng(3)
Q, P, V, W = RNG.normal(size=4), RNG.normal(size=4), RNG.normal(size=3), RNG.normal(size=3)
D, E = RNG.normal(size=8), RNG.normal(size=8)
C = rotation.to_dcm(Q)
CASES = [
    (quaternion.product, Q, P),
    (quaternion.inverse, Q),
    (quaternion.rotate, Q, V),
    (quaternion.exp, V),
    (quaternion.log, Q),
    (quaternion.derivative, Q, V),
    (rotation.to_dcm, Q),
    (cosines.from_rotation, C),
    (rotation.nearest_dcm, C),
    (rotation.squares_from_dcm, C),
    (rotation.to_gibbs, Q),
    (rotation.from_gibbs, V),
    (rotation.gibbs_from_dcm, C),
    (rotation.gibbs_ratios, C),
    (rotation.to_mrp, Q),
    (rotation.from_mrp, V),
    (rotation.to_rotation_vector, Q),
    (rotation.from_rotation_vector, V),
    (matrices.rotation, Q),
    (matrices.rotation_slope, Q, P),
    (matrices.rate, Q, P),
    (matrices.cross_repeated, V, W),
    (matrices.double_product, V, W, V),
    (dual_quaternion.product, D, E),
    (dual_quaternion.inverse, D),
    (dual_quaternion.transform, D, V),
    (dual_quaternion.derivative, D, V, W),
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case[0].__module__.split('.')[-1]}.{case[0].__name__}")
def test_one_and_many(case, compiled):
    function, *arguments = case
    found = function(*arguments)
    batch = function(*(np.stack([x, 2 * x]) for x in arguments))
    assert isinstance(found, np.ndarray)
    assert not compiled
    np.testing.assert_allclose(found, jax.jit(function)(*arguments), rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(batch[0], found, rtol=1e-14, atol=1e-15)
    on_device = [jax.device_put(x) for x in arguments]
    compiled.clear()
    again = function(*on_device)
    assert isinstance(again, jax.Array)
    assert not compiled
    np.testing.assert_array_equal(again, found)


@pytest.mark.parametrize("sequence", ["ZYX", "zxz"])
def test_euler_angles(sequence, compiled):
    angles = rotation.to_euler(Q, sequence)
    np.testing.assert_allclose(abs(rotation.from_euler(sequence, angles) @ quaternion.unit(Q)), 1)
    np.testing.assert_allclose(rotation.to_euler(np.stack([Q, 2 * Q]), sequence), np.stack([angles, angles]))
    assert not compiled
    np.testing.assert_allclose(jax.jit(lambda q: rotation.to_euler(q, sequence))(Q), angles, rtol=1e-13)


def test_lists_and_integers():
    np.testing.assert_array_equal(quaternion.product([0, 1, 0, 0], [0, 0, 1, 0]), [0, 0, 0, 1])
