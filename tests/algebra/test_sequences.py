"""Attitudes along a sequence: interpolation, continuous rotation vectors and continuous Euler angles."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

import qtraj as qt

TIMES = np.array([0.0, 1.0, 2.5, 2.75, 4.0])
QS = np.random.default_rng(3).normal(size=(5, 4))


def test_slerp_agrees_with_scipy():
    t = np.linspace(0.0, 4.0, 41).reshape(1, 41)
    expected = Slerp(TIMES, Rotation.from_quat(QS, scalar_first=True))(t[0]).as_matrix()
    for found in (qt.rotation.slerp_along(TIMES, QS, t), jax.jit(qt.rotation.slerp_along)(TIMES, QS, t)):
        np.testing.assert_allclose(np.linalg.inv(qt.rotation.to_dcm(np.asarray(found[0]))), expected, atol=1e-13)


def test_slerp_refuses_what_it_cannot_interpolate():
    with pytest.raises(ValueError, match=r"times are from 0 to 4, but the instants are from -1 to 2"):
        qt.rotation.slerp_along(TIMES, QS, [-1.0, 2.0])
    with pytest.raises(ValueError, match=r"arrays of the shapes \(5,\) and \(4, 4\)"):
        qt.rotation.slerp_along(TIMES, QS[:4], 1.0)
    with pytest.raises(ValueError, match="two or more increasing times"):
        qt.rotation.slerp_along(TIMES[::-1], QS, 1.0)
    assert np.isnan(jax.jit(qt.rotation.slerp_along)(TIMES, QS, 5.0)).all()


def tumbling(seed, count=400):
    """A smooth motion of several turns."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 20.0, count)
    steps = 0.05 * (rng.normal(size=3) + np.sin(np.outer(t, rng.uniform(0.3, 1.0, 3)) + rng.uniform(0, 6, 3)))
    attitudes = [Rotation.random(random_state=seed)]
    for step in steps[1:]:
        attitudes.append(attitudes[-1] * Rotation.from_rotvec(step))
    return Rotation.concatenate(attitudes).as_quat(scalar_first=True)


@pytest.mark.parametrize("seq", ["ZYX", "zyx", "XYZ", "zxz", "YXY"])
def test_euler_angles_are_continuous(seq):
    for seed in range(5):
        qs = tumbling(seed)
        found = qt.rotation.euler_along(qs, seq)
        np.testing.assert_allclose(qt.rotation.angle_between(qt.rotation.from_euler(seq, found), qs), 0.0, atol=1e-12)
        plain = qt.rotation.to_euler(qs, seq)
        assert np.abs(np.diff(found, axis=0)).max() < np.pi / 2 < np.abs(np.diff(plain, axis=0)).max()
        np.testing.assert_array_equal(found[0], plain[0])


def test_euler_angles_through_a_loop_and_whole_turns():
    """A vertical loop: the pitch passes 90°, while yaw and roll stay; three loops are three turns."""
    pitch = np.linspace(0.0, 6 * np.pi, 241)
    qs = qt.rotation.from_euler("ZYX", np.stack([np.full(241, 0.3), pitch, np.full(241, -0.2)], axis=-1))
    found = qt.rotation.euler_along(qs, "ZYX")
    np.testing.assert_allclose(found, np.stack([np.full(241, 0.3), pitch, np.full(241, -0.2)], axis=-1), atol=1e-7)


@pytest.mark.parametrize("seq", ["ZYX", "zyx", "ZXZ", "zxz", "yzx"])
def test_the_third_angle_is_kept_in_gimbal_lock(seq):
    lock = 0.0 if seq[0] == seq[2] else np.pi / 2
    angles = np.array([[0.4, 0.7 * lock + 0.1, 0.5], [0.45, lock, 0.55], [0.5, lock, 0.55]])
    qs = qt.rotation.from_euler(seq, angles)
    found = qt.rotation.euler_along(qs, seq)
    np.testing.assert_allclose(found[1:, 2], 0.5, atol=1e-12)
    np.testing.assert_allclose(qt.rotation.angle_between(qt.rotation.from_euler(seq, found), qs), 0.0, atol=1e-7)


def test_rotation_vectors_pass_half_and_whole_turns():
    angles, axis = np.linspace(-1.0, 20.0, 85), np.array([2.0, -1.0, 2.0]) / 3
    qs = qt.rotation.from_rotation_vector(angles[:, None] * axis)
    assert np.any(qs[:, 0] < 0)
    found = qt.rotation.rotation_vectors_along(-qs)
    np.testing.assert_allclose(found, angles[:, None] * axis, atol=1e-13)
    np.testing.assert_allclose(jax.jit(qt.rotation.rotation_vectors_along)(qs), found, atol=1e-13)


def test_derivatives_along_a_sequence():
    qs = jnp.asarray(tumbling(1)[:20])
    for function in (qt.rotation.rotation_vectors_along, lambda q: qt.rotation.euler_along(q, "ZYX")):
        found = jax.jit(lambda q, f=function: jax.jvp(f, (q,), (jnp.ones_like(q),))[1])(qs)
        step = 1e-6
        difference = (function(qs + step) - function(qs - step)) / (2 * step)
        np.testing.assert_allclose(found, difference, rtol=1e-6, atol=1e-7)
