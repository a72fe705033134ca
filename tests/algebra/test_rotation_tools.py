"""Rotations that users of SciPy, jaxlie and pytransform3d expect: against SciPy, in NumPy and JAX, for all shapes."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp
from tests.derivatives import with_jacobians

from qtraj.algebra import quaternion, rotation

RNG = np.random.default_rng(11)
SHAPES = [(), (5,), (2, 3)]
SEQUENCES = [s for s in map("".join, itertools.product("xyz", repeat=3)) if s[0] != s[1] != s[2]]
SEQUENCES += [s.upper() for s in SEQUENCES]
EXACT = 1e-13


def unit(shape, size):
    x = RNG.normal(size=(*shape, size))
    return x / np.linalg.norm(x, axis=-1, keepdims=True)


def scipy_of(q):
    return Rotation.from_quat(np.reshape(q, (-1, 4)), scalar_first=True)


def same(p, q, atol=EXACT):
    np.testing.assert_allclose(np.abs(np.sum(np.asarray(p) * np.asarray(q), axis=-1)), 1.0, atol=atol)


CASES = {
    "between_vectors": (rotation.between_vectors, (3, 3)),
    "angle_between": (rotation.angle_between, (4, 4)),
    "slerp": (rotation.slerp, (4, 4, None)),
    "power": (rotation.power, (4, None)),
    "from_axis_angle": (rotation.from_axis_angle, (3, None)),
    "to_axis_angle": (rotation.to_axis_angle, (4,)),
    "left_jacobian": (rotation.left_jacobian, (3,)),
    "right_jacobian": (rotation.right_jacobian, (3,)),
    "euler_rates_to_body": (lambda a, r: rotation.euler_rates_to_body("ZYX", a, r), (3, 3)),
    "body_to_euler_rates": (lambda a, r: rotation.body_to_euler_rates("zxz", a, r), (3, 3)),
    "rate": (quaternion.rate, (4, 4)),
    "mean": (rotation.mean, ((3, 4),)),
    "align": (lambda u, v: rotation.align(u, v, [1.0, 2.0, 0.5]), ((3, 3), (3, 3))),
    "triad": (rotation.align, ((2, 3), (2, 3))),
    "weighted mean": (rotation.mean, ((3, 4), (3,))),
}


def arguments(sizes, shape, seed=0):
    rng = np.random.default_rng(seed)
    tails = [() if k is None else k if isinstance(k, tuple) else (k,) for k in sizes]
    return [rng.uniform(0.2, 1.4, (*shape, *tail)) for tail in tails]


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("shape", SHAPES)
def test_shapes_and_namespaces(name, shape):
    """NumPy and lists in, NumPy out; JAX in, JAX out."""
    function, sizes = CASES[name]
    given = arguments(sizes, shape)
    found = jax.tree.leaves(function(*given))
    assert all(isinstance(x, np.ndarray | np.floating) for x in found)
    if shape:
        one = jax.tree.leaves(function(*(x[(0,) * len(shape)] for x in given)))
        assert [x.shape for x in found] == [(*shape, *np.shape(x)) for x in one]
        for a, b in zip(found, one, strict=True):
            np.testing.assert_allclose(a[(0,) * len(shape)], b, atol=1e-12)
    for a, b in zip(found, jax.tree.leaves(function(*(jnp.asarray(x) for x in given))), strict=True):
        assert isinstance(b, jax.Array)
        np.testing.assert_array_equal(a, b)
    if not any(np.ndim(x) == 0 for x in given):
        for a, b in zip(found, jax.tree.leaves(function(*(x.tolist() for x in given))), strict=True):
            np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("name", CASES)
def test_in_a_trace_and_in_single_precision(name):
    function, sizes = CASES[name]
    given = arguments(sizes, (5,))
    found = jax.tree.leaves(function(*given))
    for kind, atol in ((jnp.float64, 1e-12), (jnp.float32, 2e-4)):
        converted = [jnp.asarray(x, kind) for x in given]
        functions = (function, jax.vmap(function)) if kind == jnp.float64 else (function,)
        for traced in jax.jit(lambda *x, functions=functions: [f(*x) for f in functions])(*converted):
            for a, b in zip(found, jax.tree.leaves(traced), strict=True):
                assert b.dtype == kind
                np.testing.assert_allclose(a, b, rtol=1e-9, atol=atol)


@pytest.mark.parametrize("name", CASES)
def test_leading_axes_broadcast_and_integers_are_floats(name):
    function, sizes = CASES[name]
    given = arguments(sizes, (5,))
    first = [given[0][2], *given[1:]]
    expected = [np.broadcast_to(given[0][2], given[0].shape), *given[1:]]
    if len(sizes) > 1:
        for a, b in zip(*(jax.tree.leaves(function(*x)) for x in (first, expected)), strict=True):
            np.testing.assert_allclose(a, b, atol=1e-14)
    whole = [np.arange(1, 1 + x.size).reshape(x.shape) for x in arguments(sizes, ())]
    if name != "align":  # the rows are parallel enough for round-off
        found = (jax.tree.leaves(function(*(x.astype(kind) for x in whole))) for kind in (int, float))
        for a, b in zip(*found, strict=True):
            np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("name", CASES)
def test_gradients_agree_with_differences(name):
    function, sizes = CASES[name]
    given = [jnp.asarray(x) for x in arguments(sizes, (), 3)]
    flat = jnp.concatenate([x.ravel() for x in given])
    ends = np.cumsum([0, *(x.size for x in given)])

    def of(flat):
        parts = [flat[a:b].reshape(x.shape) for a, b, x in zip(ends[:-1], ends[1:], given, strict=True)]
        return jnp.concatenate([jnp.ravel(x) for x in jax.tree.leaves(function(*parts))])

    def value(flat):
        parts = [flat[a:b].reshape(x.shape) for a, b, x in zip(ends[:-1], ends[1:], given, strict=True)]
        return np.concatenate([np.ravel(x) for x in jax.tree.leaves(function(*parts))])

    h, at = 1e-6, np.asarray(flat)
    numeric = np.stack([(value(at + h * e) - value(at - h * e)) / (2 * h) for e in np.eye(at.size)], axis=1)
    for found in jax.jit(with_jacobians(of))(flat)[1:]:
        np.testing.assert_allclose(found, numeric, rtol=1e-6, atol=1e-7)


def _aligned(u):
    return rotation.align(u, jnp.eye(3)).quaternion


SINGULAR = {
    "equal attitudes": (lambda q: rotation.angle_between(q, jnp.array([1.0, 0, 0, 0])), [1.0, 0, 0, 0]),
    "half turn": (lambda q: rotation.angle_between(q, jnp.array([1.0, 0, 0, 0])), [0.0, 1, 0, 0]),
    "slerp of equal attitudes": (lambda q: rotation.slerp(q, jnp.array([1.0, 0, 0, 0]), 0.3), [1.0, 0, 0, 0]),
    "slerp of a half turn": (lambda q: rotation.slerp(q, jnp.array([1.0, 0, 0, 0]), 0.3), [0.0, 0, 1, 0]),
    "power of one": (lambda q: rotation.power(q, 0.3), [1.0, 0, 0, 0]),
    "axis of one": (lambda q: jnp.stack([*rotation.to_axis_angle(q)[0], rotation.to_axis_angle(q)[1]]), [1.0, 0, 0, 0]),
    "opposite": (lambda a: rotation.between_vectors(a, jnp.array([0.0, 0, -2])), [0.0, 0, 1]),
    "equal directions": (lambda a: rotation.between_vectors(a, jnp.array([0.0, 0, 2])), [0.0, 0, 1]),
    "no rotation": (rotation.left_jacobian, [0.0, 0, 0]),
    "equal attitudes of a mean": (lambda q: rotation.mean(jnp.stack([q, q, -q])), [0.5, 0.5, -0.5, 0.5]),
    "exact directions": (lambda u: _aligned(jnp.stack([u, 2 * jnp.roll(u, 1), jnp.roll(u, 2)])), [1.0, 0, 0]),
}  # fmt: skip


@pytest.mark.parametrize("name", SINGULAR)
def test_values_and_derivatives_are_finite_at_singular_points(name):
    function, at = SINGULAR[name]
    for found in jax.jit(with_jacobians(function))(jnp.array(at)):
        assert np.isfinite(found).all()


def test_between_vectors():
    a, b = 10.0 ** RNG.uniform(-200, 100, (2, 300, 1)) * unit((2, 300), 3)
    q = rotation.between_vectors(a, b)
    np.testing.assert_allclose(np.linalg.norm(q, axis=-1), 1.0, atol=EXACT)
    scaled = (x / np.abs(x).max(axis=-1, keepdims=True) for x in (a, b))  # squares underflow
    directions = [x / np.linalg.norm(x, axis=-1, keepdims=True) for x in scaled]
    np.testing.assert_allclose(quaternion.rotate(q, directions[0]), directions[1], atol=1e-12)
    angle = np.arctan2(np.linalg.norm(np.cross(*directions), axis=-1), np.sum(directions[0] * directions[1], axis=-1))
    np.testing.assert_allclose(scipy_of(q).magnitude(), angle, atol=1e-12)  # the shortest
    for vector, axis in (([0, 0, 1], [0, 1, 0]), ([1, 0, 0], [0, 0, -1]), ([1, 2, 3], [0, -3, 2])):
        half = rotation.between_vectors(vector, -3 * np.array(vector))
        np.testing.assert_allclose(quaternion.rotate(half, vector), -np.array(vector, float), atol=1e-15)
        same(half, [0.0, *(np.array(axis) / np.linalg.norm(axis))])
    for gap in (1e-300, 1e-16, 1e-12, 1e-8):
        near = rotation.between_vectors([0.0, 0, 1], [gap, 0, -1])
        np.testing.assert_allclose(quaternion.rotate(near, [0.0, 0, 1]), [gap, 0, -1], atol=1e-15)
    assert np.isnan(rotation.between_vectors([0.0, 0, 0], [0.0, 0, 1])).all()


def test_interpolation_angles_and_powers():
    p, q = unit((200,), 4), unit((200,), 4)
    s = RNG.uniform(-0.5, 1.5, 200)
    for k in range(20):
        expected = Slerp([0, 1], Rotation.from_quat([p[k], q[k]], scalar_first=True))(np.clip(s[k], 0, 1))
        same(rotation.slerp(3 * p[k], -q[k], np.clip(s[k], 0, 1)), expected.as_quat(scalar_first=True))
    np.testing.assert_allclose(rotation.angle_between(2 * p, q), (scipy_of(p).inv() * scipy_of(q)).magnitude())
    relative = quaternion.product(quaternion.conjugate(p), q)
    same(rotation.slerp(p, q, s), quaternion.product(p, rotation.power(relative, s)))
    for exponent in (-1.0, 0.0, 0.5, 1.0, 2.0, 3.7):
        expected = (scipy_of(p) ** exponent).as_quat(scalar_first=True)
        same(rotation.power(p, exponent), expected, 1e-12)
    assert float(rotation.angle_between([1, 0, 0, 0], [1, 1e-9, 0, 0])) == pytest.approx(2e-9, rel=1e-12)
    ends = rotation.slerp(p, q, np.array([[0.0], [1.0]]))
    np.testing.assert_allclose(ends[0], p, atol=EXACT)
    same(ends[1], q)


def test_axis_and_angle():
    q = unit((200,), 4)
    axis, angle = rotation.to_axis_angle(-3 * q)
    np.testing.assert_allclose(axis * angle[:, None], scipy_of(q).as_rotvec(), atol=1e-12)
    same(rotation.from_axis_angle(5 * axis, angle), q)
    assert rotation.from_axis_angle([0, 0, 2], np.zeros((2, 3))).shape == (2, 3, 4)
    assert np.isnan(rotation.from_axis_angle([0, 0, 0], 1.0)).all()


@pytest.mark.parametrize("size", [0.0, 1e-200, 1e-6, 0.5, 0.999999, 1.000001, 3.0, 6.0, 20.0])
def test_jacobians_map_rates(size):
    v, v_dot = size * unit((20,), 3), unit((20,), 3)
    q, q_dot = jax.vmap(lambda v, d: jax.jvp(rotation.from_rotation_vector, (v,), (d,)))(v, v_dot)
    for jacobian, axes in ((rotation.left_jacobian, "inertial"), (rotation.right_jacobian, "body")):
        mapped = np.einsum("nij,nj->ni", jacobian(v), v_dot)
        np.testing.assert_allclose(mapped, quaternion.rate(q, q_dot, axes), atol=1e-13)
        series = sum(np.linalg.matrix_power(_cross(v[0] * (1 if axes == "inertial" else -1)), k) / _factorial(k + 1)
                     for k in range(60))  # fmt: skip
        if size < 10:  # the series loses digits for long vectors
            np.testing.assert_allclose(jacobian(v)[0], series, atol=1e-12)


def _cross(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def _factorial(k):
    return float(np.prod(np.arange(1.0, k + 1)))


@pytest.mark.parametrize("seq", SEQUENCES)
def test_euler_rates(seq):
    angles, rates = RNG.uniform(0.2, 1.3, (30, 3)), RNG.normal(size=(30, 3))
    q, q_dot = jax.vmap(lambda a, r: jax.jvp(lambda x: rotation.from_euler(seq, x), (a,), (r,)))(angles, rates)
    omega = rotation.euler_rates_to_body(seq, angles, rates)
    np.testing.assert_allclose(omega, quaternion.rate(q, q_dot), atol=EXACT)
    np.testing.assert_allclose(rotation.body_to_euler_rates(seq, angles, omega), rates, atol=1e-11)
    locked = np.array([0.3, 0.0 if seq[0] == seq[2] else np.pi / 2, 0.1])
    assert np.isfinite(rotation.euler_rates_to_body(seq, locked, rates[0])).all()
    with pytest.raises(ValueError, match=f"the Euler angles '{seq}' are in gimbal lock"):
        rotation.body_to_euler_rates(seq, locked, [1.0, 2, 3])
    if seq in ("ZYX", "zxz"):
        assert np.isnan(jax.jit(lambda a: rotation.body_to_euler_rates(seq, a, jnp.ones(3)))(locked)).all()
        with pytest.raises(ValueError, match=r"\(element 1\) are in gimbal lock"):
            rotation.body_to_euler_rates(seq, [angles[0], locked], rates[:2])


@pytest.mark.parametrize("axes", ["body", "inertial"])
def test_the_rate_inverts_the_derivative(axes):
    q, omega = 1e-170 * RNG.normal(size=(2, 3, 4)), RNG.normal(size=(2, 3, 3))
    np.testing.assert_allclose(quaternion.rate(q, quaternion.derivative(q, omega, axes), axes), omega, rtol=1e-11)


def test_average():
    qs, weights = unit((7,), 4), RNG.uniform(0, 2, 7)
    near = quaternion.product(unit((), 4), np.concatenate([np.ones((7, 1)), 0.3 * qs[:, 1:]], axis=1))
    signs = RNG.choice([-3.0, 0.2], 7)[:, None]
    for w in (None, weights):
        same(rotation.mean(signs * near, w), scipy_of(near).mean(w).as_quat(scalar_first=True))
    assert np.isnan(rotation.mean([[1.0, 0, 0, 0], [0.0, 1, 0, 0]])).all()
    with pytest.raises(ValueError, match=r"mean: weights must have shape \(..., 7\)"):
        rotation.mean(qs, [1.0, 2.0])
    with pytest.raises(ValueError, match="mean: weights must not be negative"):
        rotation.mean(qs, -weights)
    with pytest.raises(ValueError, match=r"mean: qs must have shape \(..., n, 4\)"):
        rotation.mean([1.0, 0, 0, 0])


def test_alignment():
    q, u = unit((), 4), unit((6,), 3)
    exact = quaternion.rotate(q, u)
    noisy = exact + 0.01 * RNG.normal(size=(6, 3))
    v = noisy / np.linalg.norm(noisy, axis=1, keepdims=True)
    for weights in (None, RNG.uniform(0.5, 3, 6)):
        found = rotation.align(4 * u, v, weights)
        expected, rssd = Rotation.align_vectors(v, u, weights)
        same(found.quaternion, expected.as_quat(scalar_first=True))
        total = 6 if weights is None else weights.sum()
        assert float(found.residual) == pytest.approx(rssd / np.sqrt(total), rel=1e-9)
    assert float(rotation.align(u, exact).residual) < 1e-14
    first = rotation.align(u[:2], noisy[:2])
    np.testing.assert_allclose(quaternion.rotate(first.quaternion, u[0]), v[0], atol=1e-14)  # TRIAD
    normal = np.cross(v[0], quaternion.rotate(first.quaternion, u[1]))
    np.testing.assert_allclose(np.cross(normal, np.cross(v[0], v[1])), 0, atol=1e-14)
    for body in (u[[0, 0, 0]], np.zeros((3, 3)), u[[1, 1]]):
        with pytest.raises(ValueError, match="the directions do not determine the attitude"):
            rotation.align(body, v[: len(body)])
        assert np.isnan(jax.jit(rotation.align)(jnp.asarray(body), jnp.asarray(v[: len(body)])).quaternion).all()
    with pytest.raises(ValueError, match="with the same n ≥ 2"):
        rotation.align(u[:1], v[:1])


def test_the_covariance_of_an_alignment_is_that_of_many_trials():
    u, sigma = unit((4,), 3), np.array([1e-3, 2e-3, 1e-3, 5e-4])
    q, trials = unit((), 4), 4000
    noise = sigma[:, None] * RNG.normal(size=(trials, 4, 3))
    v = quaternion.rotate(q, u) + noise
    found = rotation.align(u, v, 1 / sigma**2)
    errors = rotation.to_rotation_vector(quaternion.product(quaternion.conjugate(q), found.quaternion))
    scatter = errors.T @ errors / trials
    np.testing.assert_allclose(scatter, found.covariance[0], atol=0.1 * np.trace(found.covariance[0]))


def test_random_attitudes_are_uniform():
    for key in (jax.random.key(2), np.random.default_rng(2)):
        q = rotation.random(key, (20_000,))
        assert isinstance(q, jax.Array) == isinstance(key, jax.Array)
        np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-6)
        angle = np.sort(np.asarray(rotation.angle_between(q, [1.0, 0, 0, 0])))
        share = (np.arange(20_000) + 0.5) / 20_000
        np.testing.assert_allclose((angle - np.sin(angle)) / np.pi, share, atol=0.02)  # Haar's distribution
        assert rotation.random(key).shape == (4,)
    with pytest.raises(ValueError, match="key must be a key of JAX"):
        rotation.random(3)


def test_scipy_there_and_back():
    for shape in SHAPES:
        q = unit(shape, 4)
        found = rotation.to_scipy(7 * q)
        np.testing.assert_allclose(found.as_matrix(), np.swapaxes(rotation.to_dcm(q), -1, -2), atol=EXACT)
        np.testing.assert_allclose(rotation.from_scipy(found), q, atol=EXACT)
    with pytest.raises(ValueError, match="a SciPy Rotation was expected, but list was given"):
        rotation.from_scipy([1, 0, 0, 0])
    with pytest.raises(ValueError, match="to_scipy needs concrete quaternions"):
        jax.jit(lambda q: rotation.to_dcm(q) + rotation.to_scipy(q).as_matrix())(jnp.ones(4))


def test_parallel_directions_and_single_weights_do_not_determine_an_attitude():
    """NumPy must not report a singular matrix instead."""
    line = [[1, 0, 0], [2, 0, 0], [-1, 0, 0]]
    for body, weights in ((line, None), (np.eye(3), [1, 0, 0])):
        with pytest.raises(ValueError, match="the directions do not determine the attitude"):
            rotation.align(body, body, weights)
    with pytest.raises(ValueError, match="weights must not be negative, infinite or all zero"):
        rotation.align(np.eye(3), np.eye(3), [1.0, np.inf, 1.0])


def test_signs_are_continuous_in_every_sequence_of_a_batch():
    qs = RNG.normal(size=(2, 3, 9, 4))
    found = rotation.continuous(qs)
    assert (np.sum(found[..., 1:, :] * found[..., :-1, :], axis=-1) >= 0).all()
    np.testing.assert_array_equal(found[1, 2], rotation.continuous(qs[1, 2]))
    np.testing.assert_array_equal(found[..., 0, :], qs[..., 0, :])
    for wrong in (qs[0, 0, 0], np.ones((3, 3))):
        with pytest.raises(ValueError, match=r"continuous: qs must have shape \(..., n, 4\)"):
            rotation.continuous(wrong)


def test_arguments_of_wrong_types_are_named():
    for shape, size in ((5, (5, 4)), ([2, 3], (2, 3, 4))):
        assert rotation.random(np.random.default_rng(0), shape).shape == size
    with pytest.raises(ValueError, match="each element of shape must be a whole number"):
        rotation.random(np.random.default_rng(0), 2.5)
    with pytest.raises(ValueError, match=r"key must be a key of JAX.*a JAX array of shape \(3,\)"):
        rotation.random(jnp.ones(3))
    with pytest.raises(ValueError, match="an Euler sequence must be three of the letters"):
        rotation.euler_rates_to_body(3, [1, 2, 3], [1, 2, 3])
    for wrong in ([[1, 2, 3], [1, 2]], [1j, 0, 0], ["a", "b", "c"]):
        with pytest.raises(ValueError, match="numbers in rows of equal length were expected, but the list"):
            rotation.between_vectors(wrong, [0, 1, 0])


def test_the_nearest_rotation_is_differentiable_at_a_rotation():
    """Its singular values are equal, where those of the decomposition have no derivatives."""
    exact = np.asarray(rotation.to_dcm(unit((), 4)))
    stretched = exact @ np.diag([1.3, 0.7, 2.0])
    derivatives = jax.jit(with_jacobians(rotation.nearest_dcm))
    for at in (exact, stretched, stretched @ np.diag([1.0, -1.0, 1.0])):
        h = 1e-6
        steps = h * np.eye(9).reshape(9, 3, 3)
        numeric = (rotation.nearest_dcm(at + steps) - rotation.nearest_dcm(at - steps)) / (2 * h)
        for found in derivatives(at)[1:]:
            np.testing.assert_allclose(np.moveaxis(np.asarray(found).reshape(3, 3, 9), -1, 0), numeric, atol=1e-8)


def test_the_second_derivative_of_the_nearest_rotation():
    rng = np.random.default_rng(3)
    at, step = rng.normal(size=(3, 3)) + 2 * np.eye(3), rng.normal(size=(3, 3))

    def element(x):
        return rotation.nearest_dcm(jnp.asarray(at) + x * jnp.asarray(step))[0, 1]

    both, h = jax.jit(jax.value_and_grad(jax.grad(element))), 1e-5
    (before, _), (_, second), (after, _) = (both(x) for x in (-h, 0.0, h))
    assert float(second) == pytest.approx((float(after) - float(before)) / (2 * h), rel=1e-7)
    assert abs(float(second)) > 1e-3
