"""Exchange with SciPy and jaxlie: equal attitudes, and components in the order that the names state."""

import jax
import jax.numpy as jnp
import jaxlie
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.derivatives import with_jacobians

import qtraj as qt
from qtraj.foundation import extras
from qtraj.io import exchange

ROUND_OFF = 1e-14
Q = np.random.default_rng(11).normal(size=(20, 4)) * np.logspace(-3, 3, 20)[:, None]
V = np.random.default_rng(12).normal(size=(20, 3))
TURN = jax.jit(jax.vmap(qt.quaternion.rotate))


def units(q):
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def test_plain_arrays_change_only_their_order():
    assert exchange.xyzw_from_wxyz([1.0, 2.0, 3.0, 4.0]).tolist() == [2, 3, 4, 1]
    assert exchange.wxyz_from_xyzw([1.0, 2.0, 3.0, 4.0]).tolist() == [4, 1, 2, 3]
    many = Q.reshape(4, 5, 4)
    assert np.array_equal(exchange.wxyz_from_xyzw(exchange.xyzw_from_wxyz(many)), many)
    assert qt.quaternion.to_xyzw(jnp.asarray(Q[0])).tolist() == exchange.xyzw_from_wxyz(Q[0]).tolist()
    assert qt.quaternion.from_xyzw(jnp.asarray(Q[0])).tolist() == exchange.wxyz_from_xyzw(Q[0]).tolist()
    assert exchange.xyzw_from_wxyz(jnp.float32([1, 0, 0, 0])).dtype == jnp.float32


def test_scipy_rotates_vectors_equally():
    rotation = exchange.scipy_from_wxyz(Q)
    assert rotation.apply(V) == pytest.approx(np.asarray(TURN(Q, V)), abs=ROUND_OFF)
    assert np.asarray(exchange.xyzw_from_wxyz(units(Q))) == pytest.approx(rotation.as_quat(), abs=ROUND_OFF)
    dcm = np.asarray(jax.vmap(qt.rotation.to_dcm)(Q))
    assert rotation.as_matrix() == pytest.approx(np.swapaxes(dcm, 1, 2), abs=ROUND_OFF)


def test_jaxlie_rotates_vectors_equally():
    rotation = exchange.jaxlie_from_wxyz(Q)
    assert isinstance(rotation, jaxlie.SO3)
    with jax.numpy_dtype_promotion("standard"):  # jaxlie multiplies by integers
        turned = jax.vmap(lambda r, v: r.apply(v))(rotation, V)
        theirs = jax.vmap(lambda a, b: a @ b)(exchange.jaxlie_from_wxyz(Q[:-1]), exchange.jaxlie_from_wxyz(Q[1:]))
    product = jax.vmap(qt.quaternion.product)(units(Q)[:-1], units(Q)[1:])
    assert np.asarray(turned) == pytest.approx(np.asarray(TURN(Q, V)), abs=ROUND_OFF)
    assert np.asarray(exchange.wxyz_from_jaxlie(theirs)) == pytest.approx(np.asarray(product), abs=ROUND_OFF)


@pytest.mark.parametrize("q", [Q[3], -Q[3], Q, Q[:1]], ids=["one", "negative", "many", "one of many"])
def test_signs_and_shapes_survive_a_round_trip(q):
    for there, back in (
        (exchange.scipy_from_wxyz, exchange.wxyz_from_scipy),
        (exchange.jaxlie_from_wxyz, exchange.wxyz_from_jaxlie),
    ):
        again = np.asarray(back(there(q)))
        assert again.shape == q.shape
        assert again == pytest.approx(units(q), abs=ROUND_OFF)


def test_rotations_from_the_other_libraries_are_read():
    half = Rotation.from_rotvec([[0.0, 0.0, 0.0], [0.0, 0.0, np.pi / 2]])
    assert exchange.wxyz_from_scipy(half) == pytest.approx(np.array([[1, 0, 0, 0], [0.5**0.5, 0, 0, 0.5**0.5]]))
    quarter = jaxlie.SO3.from_x_radians(np.pi / 2)
    assert np.asarray(exchange.wxyz_from_jaxlie(quarter)) == pytest.approx([0.5**0.5, 0.5**0.5, 0, 0], abs=ROUND_OFF)


def test_an_exchange_with_jaxlie_can_be_differentiated():
    """The logarithm of a rotation about z by Φ has the derivative 1 in Φ, for any length of λ."""

    def angle(phi):
        return exchange.jaxlie_from_wxyz(3.0 * qt.rotation.from_rotation_vector(jnp.array([0.0, 0.0, 1.0]) * phi)).log()

    for derivative in jax.jit(with_jacobians(angle))(0.7)[1:]:
        assert np.asarray(derivative) == pytest.approx([0.0, 0.0, 1.0], abs=ROUND_OFF)


def test_tiny_quaternions_keep_their_attitude():
    tiny = 1e-200 * units(Q)
    assert np.asarray(exchange.jaxlie_from_wxyz(tiny).wxyz) == pytest.approx(units(Q), abs=ROUND_OFF)


def test_wrong_shapes_and_missing_packages_are_reported():
    for function in (exchange.xyzw_from_wxyz, exchange.scipy_from_wxyz, exchange.jaxlie_from_wxyz):
        with pytest.raises(ValueError, match=r"four components on the last axis, but shape \(3,\) was given"):
            function([1.0, 0.0, 0.0])
    with pytest.raises(ValueError, match=r"shape \(4,\) or \(n, 4\)"):
        exchange.scipy_from_wxyz(Q.reshape(4, 5, 4))
    with pytest.raises(ValueError, match="zero norm"):
        exchange.scipy_from_wxyz([0.0, 0.0, 0.0, 0.0])
    with pytest.raises(ModuleNotFoundError, match=r"needs no_such_package: pip install no_such_package$"):
        extras.require_package("no_such_package", "an exchange", None)
