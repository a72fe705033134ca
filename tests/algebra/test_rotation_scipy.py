"""Every conversion against SciPy, on 10 000 random attitudes and all the special ones."""

import itertools
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from qtraj.algebra import rotation

ROUND_OFF = 1e-14
SEQUENCES = [
    case("".join(axes))
    for axes in itertools.product("xyz", repeat=3)
    if axes[0] != axes[1] != axes[2]
    for case in (str.lower, str.upper)
]


def batch(f):
    return jax.jit(jax.vmap(f))


def quickly(f):
    """As `batch`, for large functions: half the compile time."""
    return jax.jit(jax.vmap(f))


def distance(p, q):
    """‖p ∓ q‖ of unit quaternions, half the angle between the attitudes."""
    p, q = np.array(p), np.array(q)
    return np.minimum(np.linalg.norm(p - q, axis=-1), np.linalg.norm(p + q, axis=-1))


def scipy_from(qs):
    return Rotation.from_quat(np.array(qs), scalar_first=True)


def scipy_quaternion(r):
    return r.as_quat(scalar_first=True)


def relative(actual, expected):
    """‖actual − expected‖/‖expected‖ by rows, for sizes down to 1e-300."""
    actual, expected = np.array(actual), np.array(expected)
    size = np.abs(expected).max(axis=1, keepdims=True)
    size = np.where(size == 0, 1.0, size)
    return np.linalg.norm(actual / size - expected / size, axis=1)


def up_to_a_half_turn_s_sign(actual, expected, qs):
    """A half turn has two axes of opposite sign, and SciPy takes either: compare those with the nearer sign."""
    exact = qs[:, 0] == 0
    opposite = relative(-np.array(actual), expected)
    return np.where(exact, np.minimum(relative(actual, expected), opposite), relative(actual, expected))


def test_direction_cosines(attitudes):
    expected = scipy_from(attitudes).as_matrix().transpose(0, 2, 1)
    np.testing.assert_allclose(batch(rotation.to_dcm)(jnp.array(attitudes)), expected, rtol=0, atol=ROUND_OFF)


def test_from_direction_cosines(attitudes):
    matrices = scipy_from(attitudes).as_matrix().transpose(0, 2, 1)
    qs = np.array(batch(rotation.from_dcm)(jnp.array(matrices)))
    assert distance(qs, attitudes).max() < ROUND_OFF
    np.testing.assert_allclose(np.linalg.norm(qs, axis=1), 1, rtol=0, atol=1e-15)
    assert (qs[:, 0] >= 0).all()


def test_rotation_vectors(attitudes):
    vectors = batch(rotation.to_rotation_vector)(jnp.array(attitudes))
    expected = scipy_from(attitudes).as_rotvec()
    assert up_to_a_half_turn_s_sign(vectors, expected, attitudes).max() < ROUND_OFF
    assert np.linalg.norm(vectors, axis=1).max() <= np.pi + ROUND_OFF
    back = batch(rotation.from_rotation_vector)(jnp.array(expected))
    assert distance(back, scipy_quaternion(Rotation.from_rotvec(expected))).max() < ROUND_OFF
    assert distance(back, attitudes).max() < ROUND_OFF
    assert (
        relative(back[:, 1:], np.copysign(1, attitudes[:, :1]) * attitudes[:, 1:])[attitudes[:, 0] > 0.5].max()
        < ROUND_OFF
    )


def test_modified_rodrigues_parameters(attitudes):
    parameters = batch(rotation.to_mrp)(jnp.array(attitudes))
    expected = scipy_from(attitudes).as_mrp()
    assert up_to_a_half_turn_s_sign(parameters, expected, attitudes).max() < ROUND_OFF
    assert np.linalg.norm(parameters, axis=1).max() <= 1 + ROUND_OFF
    back = batch(rotation.from_mrp)(jnp.array(expected))
    assert distance(back, scipy_quaternion(Rotation.from_mrp(expected))).max() < ROUND_OFF
    shadow = expected[:10_000] / -np.sum(expected[:10_000] ** 2, axis=1, keepdims=True)
    assert distance(batch(rotation.from_mrp)(jnp.array(shadow)), attitudes[:10_000]).max() < ROUND_OFF


def test_rotation_vectors_beyond_one_turn():
    vectors = 20 * np.random.default_rng(5).normal(size=(100, 3))
    expected = scipy_quaternion(Rotation.from_rotvec(vectors))
    assert distance(batch(rotation.from_rotation_vector)(jnp.array(vectors)), expected).max() < ROUND_OFF


def test_there_is_every_sequence():
    assert len(SEQUENCES) == 24


def gimbal_locked(seq):
    outer = np.random.default_rng(7).uniform(-np.pi, np.pi, size=(40, 2))
    outer[:4] = [[0, 0], [0, 1], [np.pi / 2, np.pi / 2], [-np.pi / 2, 1]]
    ends = (0.0, np.pi) if seq[0] == seq[2] else (-np.pi / 2, np.pi / 2)
    return Rotation.from_euler(seq, [[a, end, c] for a, c in outer for end in ends])


LOCKED = {seq: gimbal_locked(seq) for seq in SEQUENCES}


@pytest.fixture(scope="module")
def euler(attitudes):
    """All attitudes, the locked ones of every sequence at the end; for each sequence our angles and the way back."""
    qs = np.concatenate([attitudes, *(scipy_quaternion(locked) for locked in LOCKED.values())])

    def there_and_back(q):
        angles = {seq: rotation.to_euler(q, seq) for seq in SEQUENCES}
        return angles, {seq: rotation.from_euler(seq, angles[seq]) for seq in SEQUENCES}

    return qs, *jax.tree.map(np.array, quickly(there_and_back)(jnp.array(qs)))


@pytest.mark.parametrize("seq", SEQUENCES)
def test_euler_angles(seq, euler):
    """SciPy turns our angles into the attitudes, and we turn them back."""
    qs, angles, back = euler[0], euler[1][seq], euler[2][seq]
    assert distance(scipy_quaternion(Rotation.from_euler(seq, angles)), qs).max() < ROUND_OFF
    assert distance(back, qs).max() < ROUND_OFF
    assert np.abs(angles[:, ::2]).max() <= np.pi
    low, high = (0, np.pi) if seq[0] == seq[2] else (-np.pi / 2, np.pi / 2)
    assert low - ROUND_OFF <= angles[:, 1].min()
    assert angles[:, 1].max() <= high + ROUND_OFF


@pytest.mark.parametrize("seq", SEQUENCES)
def test_euler_angles_are_those_of_scipy(seq, euler):
    """Also in gimbal lock, where the third angle is zero."""
    qs, angles = euler[0][:10_000], euler[1][seq]
    clearance = np.abs(np.sin(angles[:10_000, 1]) if seq[0] == seq[2] else np.cos(angles[:10_000, 1]))
    error = turn_apart(angles[:10_000], scipy_from(qs).as_euler(seq)).max(axis=1)
    assert (error * clearance).max() < ROUND_OFF  # the outer angles lose what the clearance from lock says
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # SciPy's announcement of gimbal lock
        expected = LOCKED[seq].as_euler(seq)
    count = len(expected)
    start = len(angles) - (len(SEQUENCES) - SEQUENCES.index(seq)) * count
    at_lock = angles[start : start + count]
    np.testing.assert_array_equal(at_lock[:, 2], 0)
    assert turn_apart(at_lock, expected).max() < ROUND_OFF


def turn_apart(a, b):
    return np.abs((a - b + np.pi) % (2 * np.pi) - np.pi)


@pytest.mark.parametrize("seq", ["xyz", "ZXZ"])
def test_near_gimbal_lock_the_attitude_is_kept(seq):
    """SciPy drops an angle within 1e-7 of lock and 1e-8 of attitude with it; here the attitude stays to round-off."""
    lock = 0.0 if seq == "ZXZ" else np.pi / 2
    qs = scipy_quaternion(Rotation.from_euler(seq, [[0.3, lock - gap, 0.4] for gap in 10.0 ** -np.arange(3, 17)]))
    angles = np.array(batch(lambda q: rotation.to_euler(q, seq))(jnp.array(qs)))
    assert distance(scipy_quaternion(Rotation.from_euler(seq, angles)), qs).max() < ROUND_OFF


@pytest.mark.parametrize("seq", ["x", "Y", "zy", "XZ"])
def test_sequences_of_one_and_two_axes(seq):
    angles = np.random.default_rng(2).uniform(-4, 4, (3, 5, len(seq)))
    expected = scipy_quaternion(Rotation.from_euler(seq, angles.reshape(-1, len(seq)))).reshape(3, 5, 4)
    found = rotation.from_euler(seq, angles)
    assert found.shape == (3, 5, 4)
    assert distance(found, expected).max() < ROUND_OFF
    np.testing.assert_allclose(jax.jit(lambda x: rotation.from_euler(seq, x))(angles), found, atol=ROUND_OFF)
    if len(seq) == 1:
        np.testing.assert_array_equal(rotation.from_euler(seq, 0.3), rotation.from_euler(seq, [0.3]))
    with pytest.raises(ValueError, match=rf"angles must have shape \(..., {len(seq)}\), but shape \(3,\) was given"):
        rotation.from_euler(seq, [0.1, 0.2, 0.3])
    with pytest.raises(ValueError, match="an Euler sequence must be three of the letters"):
        rotation.to_euler(found, seq)


@pytest.mark.parametrize("seq", ["", "xx", "xY", "xyzx", "w"])
def test_sequences_that_are_none(seq):
    with pytest.raises(ValueError, match="an Euler sequence must be one to three of the letters"):
        rotation.from_euler(seq, np.zeros(len(seq)))
