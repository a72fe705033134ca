"""Properties of the conversions: scale, Gibbs vectors, paper S's squares and ratios, signs, errors, float32."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from qtraj.algebra import quaternion, rotation
from qtraj.algebra.cosines import SIGNS

ROUND_OFF = 1e-14


def batch(f):
    return jax.jit(jax.vmap(f))


def quickly(f):
    """Compiled without optimisation, which halves the time of a test that runs once."""
    return jax.jit(f)


def random_quaternions(count, seed=1):
    return np.random.default_rng(seed).normal(size=(count, 4))


def dcm(qs):
    return Rotation.from_quat(np.array(qs), scalar_first=True).as_matrix().transpose(0, 2, 1)


# Scale


def converted(q):
    angles = jnp.stack([rotation.to_euler(q, seq) for seq in ("xyz", "ZXZ", "XZY")])
    return {
        "dcm": rotation.to_dcm(q),
        "rotation vector": rotation.to_rotation_vector(q),
        "mrp": rotation.to_mrp(q),
        "euler": (jnp.cos(angles), jnp.sin(angles)),  # −π and π are the same angle
        "rotated": quaternion.rotate(q, jnp.array([0.3, -1.0, 2.0], dtype=q.dtype)),
    }


CONVERSIONS, TO_GIBBS = quickly(jax.vmap(converted)), batch(rotation.to_gibbs)


@pytest.mark.parametrize("c", [-1.0, -3.0, 1e-3, -1e-200, 1e200])
def test_conversions_agree_at_any_scale(c, special):
    qs = np.concatenate([random_quaternions(200), special])
    qs = qs[clear_of_lock(qs)]
    if c == -1e-200:
        qs = np.where(np.abs(qs) < 1e-100, 0.0, qs)  # these would underflow
    expected, actual = CONVERSIONS(jnp.array(qs)), CONVERSIONS(jnp.array(c * qs))
    for name, value in expected.items():
        np.testing.assert_allclose(actual[name], value, rtol=0, atol=20 * ROUND_OFF, err_msg=name)
    np.testing.assert_allclose(TO_GIBBS(jnp.array(c * qs)), TO_GIBBS(jnp.array(qs)), rtol=ROUND_OFF)


def clear_of_lock(qs):
    """Exclude attitudes near gimbal lock of a sequence, but not in it: their outer angles are ill-conditioned."""
    R = dcm(qs).transpose(0, 2, 1)
    pairs = [R[:, 2, 1:], R[:, 2, :2], R[:, 0, ::2]]  # cosine or sine of the middle angle of xyz, ZXZ, XZY
    gap = np.linalg.norm(pairs, axis=2)
    return ((gap > 1e-2) | (gap < 5e-16)).all(axis=0)


# Direction cosines


def test_squares_by_the_linear_system():
    """H·H = 4E, and ¼H(1, α11, α22, α33) are the squares."""
    np.testing.assert_array_equal(np.array(SIGNS) @ np.array(SIGNS), 4 * np.eye(4))
    qs = random_quaternions(500)
    qs /= np.linalg.norm(qs, axis=1, keepdims=True)
    np.testing.assert_allclose(batch(rotation.squares_from_dcm)(jnp.array(dcm(qs))), qs**2, rtol=0, atol=ROUND_OFF)
    with_one = np.stack([np.ones(500), *np.diagonal(dcm(qs), axis1=1, axis2=2).T])
    np.testing.assert_allclose(np.array(SIGNS) @ (qs**2).T, with_one, rtol=0, atol=ROUND_OFF)


def test_rows_of_the_direction_cosines_are_the_body_axes():
    q = jnp.array(random_quaternions(1)[0])
    rows = [quaternion.rotate(q, axis) for axis in jnp.eye(3)]
    np.testing.assert_allclose(rotation.to_dcm(q), rows, rtol=0, atol=ROUND_OFF)


# Gibbs vectors


def regular_form(C):
    """(α23−α32, α31−α13, α12−α21)/(1 + tr α), in NumPy."""
    v = np.stack([C[:, 1, 2] - C[:, 2, 1], C[:, 2, 0] - C[:, 0, 2], C[:, 0, 1] - C[:, 1, 0]], axis=1)
    return v / (1 + np.trace(C, axis1=1, axis2=2))[:, None]


def test_gibbs_vector_is_the_ratio_in_high_precision(attitudes):
    qs = attitudes[attitudes[:, 0] != 0]
    with mpmath.workdps(40):
        expected = [[float(mpmath.mpf(x) / mpmath.mpf(q[0])) for x in q[1:]] for q in qs.tolist()]
    np.testing.assert_allclose(TO_GIBBS(jnp.array(qs)), expected, rtol=ROUND_OFF)
    back = np.array(batch(rotation.from_gibbs)(jnp.array(expected)))
    np.testing.assert_allclose(back, np.sign(qs[:, :1]) * qs, rtol=ROUND_OFF)


def test_gibbs_vector_has_the_length_of_scipy_s_half_angle():
    qs = random_quaternions(10_000)
    qs = qs[np.abs(qs[:, 0]) > 0.3 * np.linalg.norm(qs, axis=1)]
    v = Rotation.from_quat(qs, scalar_first=True).as_rotvec()
    angle = np.linalg.norm(v, axis=1, keepdims=True)
    expected = np.tan(angle / 2) * v / angle
    error = np.linalg.norm(TO_GIBBS(jnp.array(qs)) - expected, axis=1) / np.linalg.norm(expected, axis=1)
    assert error.max() < ROUND_OFF


def test_gibbs_vector_from_direction_cosines(attitudes):
    """Accurate to round-off of the attitude everywhere; equal to the regular form where that is well-conditioned."""
    C = dcm(attitudes)
    gibbs = np.array(batch(rotation.gibbs_from_dcm)(jnp.array(C)))
    finite = np.isfinite(gibbs).all(axis=1)
    np.testing.assert_array_less(np.abs(attitudes[~finite, 0]), 1e-15)
    back = np.array(batch(rotation.from_gibbs)(jnp.array(gibbs[finite])))
    distances = [np.linalg.norm(back + s * attitudes[finite], axis=1) for s in (1, -1)]
    assert np.min(distances, axis=0).max() < ROUND_OFF
    near = attitudes[:, 0] ** 2 > 0.25
    regular = regular_form(C[near])
    size = np.maximum(np.abs(regular).max(axis=1, keepdims=True), np.finfo(float).tiny)
    np.testing.assert_allclose(gibbs[near] / size, regular / size, rtol=0, atol=ROUND_OFF)


def test_gibbs_vector_is_invariant_under_its_rotation(attitudes):
    """αG = G: the same components in both axes."""
    clear = attitudes[np.abs(attitudes[:, 0]) > 1e-3]
    gibbs = np.array(TO_GIBBS(jnp.array(clear)))
    size = np.abs(gibbs).max(axis=1, keepdims=True) + np.finfo(float).tiny
    turned = np.einsum("nij,nj->ni", dcm(clear), gibbs / size)
    np.testing.assert_allclose(turned, gibbs / size, rtol=0, atol=ROUND_OFF)


def test_the_six_printed_ratios_where_they_are_defined():
    qs = random_quaternions(5000)
    qs /= np.linalg.norm(qs, axis=1, keepdims=True)
    qs = qs[np.abs(qs).min(axis=1) > 0.1]  # the denominators are 4α0α_m
    ratios = np.array(batch(rotation.gibbs_ratios)(jnp.array(dcm(qs))))
    expected = (qs[:, 1:] / qs[:, :1])[:, :, None] * np.ones(2)
    loss = 1 / np.abs(qs).min(axis=1)[:, None, None] ** 2
    assert len(qs) > 1000
    assert (np.abs(ratios - expected) / (loss * (1 + np.abs(expected)))).max() < ROUND_OFF


def test_the_printed_ratios_fail_in_a_horizontal_turn_and_the_regular_form_does_not():
    """Both forms of G3 are 0/0 for a turn about z, the paper's horizontal case."""
    C = rotation.to_dcm(jnp.array([np.cos(0.3), 0, 0, np.sin(0.3)]))
    assert np.isnan(rotation.gibbs_ratios(C)[2]).all()
    np.testing.assert_allclose(rotation.gibbs_from_dcm(C), [0, 0, np.tan(0.3)], rtol=ROUND_OFF)


def test_from_gibbs_at_infinity():
    inf = np.inf
    np.testing.assert_array_equal(rotation.from_gibbs(jnp.array([0.0, -inf, 5.0])), [0, 0, -1, 0])
    assert np.isnan(rotation.from_gibbs(jnp.array([inf, inf, 0.0]))).any()
    np.testing.assert_allclose(rotation.from_gibbs(jnp.array([3e300, 0.0, 4e300])), [0, 0.6, 0, 0.8], atol=1e-15)


# Sign continuity


def test_continuous_undoes_random_sign_flips():
    ts = np.linspace(0, 30, 400)
    smooth = np.stack([np.cos(ts), np.sin(ts) * np.cos(ts / 7), np.sin(ts) * np.sin(ts / 7), 0 * ts], axis=1)
    flips = np.random.default_rng(2).choice([-1.0, 1.0], size=(400, 1))
    scales = np.geomspace(1e-200, 1e200, 400)[:, None]
    fixed = np.array(rotation.continuous(jnp.array(flips * scales * smooth)))
    np.testing.assert_array_equal(fixed, flips[0] * scales * smooth)


def test_continuous_keeps_the_first_sign_and_treats_zero_as_positive():
    qs = jnp.array([[-1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, -1.0, 0, 0], [0, 0, 0, 2.0]])
    expected = [[-1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 1.0, 0, 0], [0, 0, 0, -2.0]]
    np.testing.assert_array_equal(rotation.continuous(qs), expected)
    np.testing.assert_array_equal(rotation.continuous(qs[:1]), qs[:1])


def test_the_derivatives_of_continuous_are_its_signs():
    qs = jnp.array([[1.0, 0, 0, 0], [-1.0, 0.1, 0, 0], [0, 1.0, 0, 0]])
    expected = np.einsum("k,kl,ij->kilj", [1, -1, -1], np.eye(3), np.eye(4))
    for jacobian in (jax.jacfwd, jax.jacrev):
        np.testing.assert_array_equal(jax.jit(jacobian(rotation.continuous))(qs), expected)


# Errors


@pytest.mark.parametrize("seq", ["", "xyzx", "xxy", "zyy", "xYz", "abc", "x1z", "ZYx"])
def test_a_bad_sequence_is_refused_with_advice(seq):
    for call in (
        lambda: rotation.to_euler(jnp.array([1.0, 0, 0, 0]), seq),
        lambda: rotation.from_euler(seq, jnp.zeros(3)),
    ):
        with pytest.raises(ValueError, match=f"such as 'ZYX' or 'zxz', but '{seq}' was given"):
            call()


def test_the_public_names_are_reachable():
    for name in rotation.__all__:
        assert getattr(rotation, name).__doc__, name


# float32


@quickly
def conversions(q):
    C = rotation.to_dcm(q)
    return [
        C,
        rotation.from_dcm(C),
        rotation.squares_from_dcm(C),
        rotation.from_gibbs(rotation.to_gibbs(q)),
        rotation.gibbs_from_dcm(C),
        rotation.from_mrp(rotation.to_mrp(q)),
        rotation.from_rotation_vector(rotation.to_rotation_vector(q)),
        rotation.to_euler(q, "ZYX"),
        rotation.from_euler("ZYX", rotation.to_euler(q, "zxz")),
        rotation.continuous(jnp.stack([q, -q])),
    ]


@pytest.mark.parametrize("q", [[0.7, -0.4, 0.5, 0.1], [1.0, 0, 0, 0], [1.0, 1e-25, 0, 0]])
def test_float32_is_kept_and_agrees(q):
    double = jnp.array(q)
    for single, expected in zip(conversions(double.astype(jnp.float32)), conversions(double), strict=True):
        assert single.dtype == jnp.float32
        np.testing.assert_allclose(single, expected, rtol=0, atol=2e-6)


def test_float32_has_finite_gradients_at_identity_and_half_turns():
    def read(q):
        euler = rotation.to_euler(q, "ZYX"), rotation.to_euler(q, "zxz")
        return rotation.to_rotation_vector(q), rotation.to_mrp(q), rotation.from_dcm(rotation.to_dcm(q)), *euler

    qs = jnp.concatenate([jnp.eye(4, dtype=jnp.float32), -jnp.eye(4, dtype=jnp.float32)])
    slopes = quickly(jax.vmap(lambda q: (jax.jacfwd(read)(q), jax.jacrev(read)(q))))(qs)
    for slope in jax.tree.leaves(slopes):
        assert slope.dtype == jnp.float32
        assert np.isfinite(slope).all()


NOT_ROTATIONS = {
    "reflection": np.diag([1.0, 1.0, -1.0]),
    "scaled": 1.1 * np.eye(3),
    "sheared": np.eye(3) + np.eye(3, k=1),
}


@pytest.mark.parametrize("name", NOT_ROTATIONS)
def test_a_matrix_that_is_no_rotation_is_refused(name):
    matrix = NOT_ROTATIONS[name]
    for given in (matrix, jnp.asarray(matrix), np.stack([np.eye(3), matrix])):
        with pytest.raises(ValueError, match=r"must be a rotation matrix, but .*pass rotation\.nearest_dcm\(C\)"):
            rotation.from_dcm(given)
    assert np.isnan(jax.jit(rotation.from_dcm)(jnp.asarray(matrix))).all()
    nearest = rotation.nearest_dcm(matrix)
    np.testing.assert_allclose(nearest @ nearest.T, np.eye(3), atol=ROUND_OFF)
    assert np.linalg.det(nearest) == pytest.approx(1)
    assert np.isfinite(rotation.from_dcm(nearest)).all()


def test_the_nearest_rotation_agrees_with_scipy():
    matrices = np.random.default_rng(3).normal(size=(50, 3, 3))
    expected = [Rotation.align_vectors(m, np.eye(3))[0].as_matrix().T for m in matrices.transpose(0, 2, 1)]
    np.testing.assert_allclose(rotation.nearest_dcm(matrices), np.swapaxes(expected, 1, 2), atol=1e-12)
    rounded = np.round(expected, 4)
    np.testing.assert_allclose(rotation.from_dcm(rounded), rotation.from_dcm(np.asarray(expected)), atol=1e-3)
