"""λ(t) from recorded rates, compared with closed forms and with the classical coning algorithms."""

import functools
import itertools

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import qtraj as qt
from qtraj.motion.propagation.strapdown import propagate_samples

from .coning import Coning, angles

CONE = Coning(1.0, 2 * np.pi)
SAMPLE_TIMES = np.arange(145.0)
"""144 intervals of one second: a multiple of 12, as every classical algorithm needs."""
ROUND_OFF = 1e-13
FORMULA = 0.06
"""Relative tolerance: the published drifts are leading terms, here at x = 0.5."""
ORDER_MARGIN = 0.4
STEP = 1e-5
DIFFERENCE_ERROR = 1e-8

CLASSICAL = {
    1: (12, 3),
    2: (960, 5),
    3: (204120, 7),
    4: (82575360, 9),
}
"""Samples per update: drift per update β²x^power/denominator, x = Ω·update."""


def correction(cross, t):
    """The coning correction of a classical algorithm to the sum of the increments of one update [rad]."""
    match t:
        case [a]:
            return 0 * a
        case [a, b]:
            return cross(a, b) * 2 / 3
        case [a, b, c]:
            return cross(a, c) * 9 / 20 + cross(b, c - a) * 27 / 40
        case [a, b, c, d]:
            return cross(a, d) * 54 / 105 + cross(b, d) * 92 / 105 + cross(c, d) * 214 / 105


def classical(increments, samples):
    """The rotation over the whole recording by a classical algorithm."""
    updates = increments.reshape(-1, samples, 3)
    vectors = updates.sum(axis=1) + np.array([correction(np.cross, list(update)) for update in updates])
    return functools.reduce(Rotation.__mul__, Rotation.from_rotvec(vectors))


@pytest.mark.parametrize("samples", CLASSICAL)
def test_the_baselines_drift_as_published(samples):
    """The error of the classical algorithms about the cone's axis, with 50 digits."""
    denominator, power = CLASSICAL[samples]
    with mpmath.workdps(50):
        x, beta = mpmath.mpf("0.5"), mpmath.mpf("1e-6")

        def integral(t):
            level, drift = mpmath.sin(beta), -2 * mpmath.sin(beta / 2) ** 2
            return np.array([level * mpmath.cos(t), level * mpmath.sin(t), drift * t])

        bounds = [integral(x * k / samples) for k in range(samples + 1)]
        increments = [after - before for before, after in itertools.pairwise(bounds)]
        vector = sum(increments) + correction(np.cross, increments)
        half, level = mpmath.cos(beta / 2), mpmath.sin(beta / 2)
        # Scalar part and z component of λ(0)⁻¹∘λ(x).
        scalar = half**2 + level**2 * mpmath.cos(x)
        vertical = -(level**2) * mpmath.sin(x)
        true = 2 * mpmath.acos(scalar) / mpmath.sqrt(1 - scalar**2) * vertical
        drift = abs(vector[2] - true) / beta**2
        assert float(drift * denominator / x**power) == pytest.approx(1, abs=FORMULA)


def rotated(first, rotation):
    return (Rotation.from_quat(first, scalar_first=True) * rotation).as_quat(scalar_first=True)


def errors(per_cycle, kinds=("increment",)):
    """Final errors [rad] of the classical algorithms by samples per update, and of ours by kind."""
    cone = Coning(1.0, 2 * np.pi / per_cycle)
    increments = cone.increments(SAMPLE_TIMES)
    first, last = cone.quaternions(SAMPLE_TIMES[[0, -1]])
    ours = []
    for kind in kinds:
        rates = jax.vmap(cone)(jnp.asarray(SAMPLE_TIMES)) if kind == "instantaneous" else increments
        ours.append(propagate_samples(SAMPLE_TIMES, rates, first, kind)[-1])
    theirs = [rotated(first, classical(increments[1:], samples)) for samples in CLASSICAL]
    result = angles(np.stack([*theirs, *ours]), np.tile(last, (len(theirs) + len(ours), 1)))
    return result[: len(theirs)], result[len(theirs) :]


@pytest.mark.parametrize("per_cycle", [12, 36])
def test_better_than_the_classical_algorithms_at_low_frequency(per_cycle):
    theirs, ours = errors(per_cycle)
    assert ours[0] < 0.5 * theirs.min()
    assert theirs.min() > 10 * ROUND_OFF  # the errors are above round-off


def test_order():
    """The drift rate is of order 6 in the sampling interval for instants, and 8 for increments and means."""
    coarse, fine = (errors(n, ("instantaneous", "increment", "mean"))[1] for n in (16, 24))
    orders = np.log(coarse / fine) / np.log(1.5) - 1  # of the drift rate; one less than of the drift per sample
    assert np.all(orders > np.array([6, 8, 8]) - ORDER_MARGIN), orders


def test_means_are_increments_over_their_intervals():
    times = np.cumsum(np.random.default_rng(0).uniform(0.01, 0.03, size=40))
    increments = CONE.increments(times)
    means = increments / np.diff(times, prepend=0.0)[:, None]
    first = CONE.quaternions(times[:1])[0]
    np.testing.assert_allclose(
        propagate_samples(times, means, first, "mean"),
        propagate_samples(times, increments, first, "increment"),
        rtol=0,
        atol=ROUND_OFF,
    )


@pytest.mark.parametrize("kind", ["instantaneous", "increment"])
def test_uneven_times(kind):
    """Every instant of a jittered recording that does not start at zero; |λ| is constant."""
    times = 3.0 + np.cumsum(np.random.default_rng(1).uniform(0.01, 0.04, size=60))
    rates = CONE.increments(times) if kind == "increment" else jax.vmap(CONE)(jnp.asarray(times))
    q0 = -3 * CONE.quaternions(times[:1])[0]
    qs = propagate_samples(times, rates, q0, kind)
    assert angles(qs, CONE.quaternions(times)).max() < 1e-7
    np.testing.assert_allclose(np.linalg.norm(qs, axis=1), 3.0, rtol=ROUND_OFF, atol=0)


@pytest.mark.parametrize("kind", ["instantaneous", "mean", "increment"])
def test_polynomial_rates_about_an_axis_are_exact(kind):
    """A quartic rate is exact for every kind, also at the ends and with uneven times."""
    rng = np.random.default_rng(2)
    times = np.cumsum(rng.uniform(0.1, 0.3, size=12))
    polynomial = np.polynomial.Polynomial(rng.normal(size=5) * 0.3)
    axis = np.array([2.0, -1.0, 2.0]) / 3
    angle = polynomial.integ()(times)
    increments = np.diff(angle, prepend=angle[0])
    spans = np.diff(times, prepend=times[0] - 1.0)
    values = {"instantaneous": polynomial(times), "mean": increments / spans, "increment": increments}[kind]
    qs = propagate_samples(times, values[:, None] * axis, [1.0, 0, 0, 0], kind)
    expected = jax.vmap(qt.rotation.from_rotation_vector)(jnp.asarray((angle - angle[0])[:, None] * axis))
    np.testing.assert_allclose(qs, expected, rtol=0, atol=ROUND_OFF)


def test_inertial_axes():
    times = np.linspace(0.0, 1.0, 61)
    rates = jax.vmap(CONE.inertial)(jnp.asarray(times))
    qs = propagate_samples(times, rates, CONE.quaternions([0.0])[0], axes="inertial")
    assert angles(qs, CONE.quaternions(times)).max() < 1e-9


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("kind", ["instantaneous", "increment"])
def test_short_recordings(count, kind):
    """A constant rate is exact from two samples."""
    times = np.arange(count) * 0.5
    constant = np.broadcast_to([0.4, 0.0, 0.3], (count, 3))
    qs = propagate_samples(times, constant * (0.5 if kind == "increment" else 1.0), [1.0, 0, 0, 0], kind)
    expected = jax.vmap(qt.rotation.from_rotation_vector)(jnp.asarray(times[:, None] * [0.4, 0.0, 0.3]))
    np.testing.assert_allclose(qs, expected, rtol=0, atol=ROUND_OFF)


def test_the_first_mean_is_not_used():
    times = np.linspace(0.0, 1.0, 9)
    increments = CONE.increments(times)
    first = CONE.quaternions([0.0])[0]
    qs = propagate_samples(times, increments, first, "increment")
    increments[0] = np.nan
    np.testing.assert_array_equal(propagate_samples(times, increments, first, "increment"), qs)


@pytest.mark.parametrize("kind", ["instantaneous", "increment"])
def test_derivatives_in_bias_and_attitude(kind):
    """Forward and reverse modes under jit compared with central differences, as a calibration needs."""
    times = np.linspace(0.0, 1.0, 13)
    rates = jnp.asarray(np.random.default_rng(4).normal(size=(13, 3)) * (0.05 if kind == "increment" else 1.0))

    @jax.jit
    def goal(x):
        qs = propagate_samples(times, rates + jnp.broadcast_to(x[:3], (13, 3)), x[3:], kind)
        return jnp.sum(qs[-1] * jnp.arange(1.0, 5.0))

    x = jnp.asarray([0.01, -0.02, 0.03, 0.1, -0.7, 0.5, 0.4])
    expected = np.array([(goal(x + STEP * e) - goal(x - STEP * e)) / (2 * STEP) for e in np.eye(7)])
    scale = DIFFERENCE_ERROR * np.linalg.norm(expected)
    np.testing.assert_allclose(jax.grad(goal)(x), expected, rtol=0, atol=scale)
    np.testing.assert_allclose(jax.jacfwd(goal)(x), expected, rtol=0, atol=scale)


def test_float32():
    times = jnp.linspace(0.0, 1.0, 49, dtype=jnp.float32)
    rates = jax.vmap(CONE)(times.astype(float)).astype(jnp.float32)
    qs = propagate_samples(times, rates, jnp.asarray(CONE.quaternions([0.0])[0], jnp.float32))
    assert qs.dtype == jnp.float32
    assert angles(np.asarray(qs, float), CONE.quaternions(times)).max() < 3e-6


TIMES = np.array([0.0, 0.1, 0.2, 0.3, 0.4])
GAP = np.array([0.0, 0.1, 0.2, 0.9, 1.0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"times": GAP}, r"gap of 0.7 s between sample 2 at 0.2 s and sample 3 at 0.9 s; the median interval is 0.1 s"),
        ({"times": TIMES[[0, 1, 3, 2, 4]]}, r"times\[3\] = 0.2 s follows times\[2\] = 0.3 s"),
        ({"times": TIMES[:4]}, r"rates must have shape \(4, 3\), one row for each time, but shape \(5, 3\)"),
        ({"rates": np.diag([0, 0, np.nan, 0, 0])[:, :3]}, "sample 2 at 0.2 s is"),
        ({"kind": "average"}, "'instantaneous', 'mean', 'increment', but 'average'"),
        ({"axes": "world"}, "'body' or 'inertial'"),
        ({"degree": -1}, "must be a whole number, at least 0"),
        ({"q0": np.zeros(4)}, "must not be zero"),
    ],
)
def test_bad_recordings(change, message):
    arguments = {"times": TIMES, "rates": np.zeros((5, 3)), "q0": [1.0, 0, 0, 0]} | change
    with pytest.raises(ValueError, match=message):
        propagate_samples(**arguments)


def test_the_former_order_of_arguments_is_recognised():
    rates, q0 = np.outer(np.sin(TIMES), [1.0, 2.0, 0.5]), [0.6, 0.0, 0.8, 0.0]
    right = propagate_samples(TIMES, rates, q0)
    with pytest.warns(DeprecationWarning, match="are now times, rates, q0"):
        np.testing.assert_array_equal(propagate_samples(rates, q0, TIMES), right)
    with pytest.raises(ValueError, match="vector of instants"):
        propagate_samples(rates, rates, q0)


def test_a_gap_is_refused_while_tracing():
    with pytest.raises(ValueError, match=r"gap of 0\.7 s"):
        jax.jit(lambda rates: propagate_samples(GAP, rates, [1.0, 0, 0, 0]))(jnp.zeros((5, 3)))


@pytest.mark.parametrize("max_gap", [None, 8.0])
def test_a_gap_that_is_allowed_is_said(max_gap):
    with pytest.warns(UserWarning, match=r"a gap of 0\.7 s between sample 2 at 0\.2 s and sample 3"):
        assert propagate_samples(GAP, np.zeros((5, 3)), [1.0, 0, 0, 0], max_gap=max_gap).shape == (5, 4)


def test_several_gaps_are_counted():
    times = np.concatenate([np.arange(6.0), np.arange(30.0, 36.0), np.arange(45.0, 50.0)])
    with pytest.warns(UserWarning, match=r"has 2 gaps, the longest one of 25 s between sample 5"):
        propagate_samples(times, np.zeros((len(times), 3)), [1.0, 0, 0, 0], max_gap=None)


@pytest.mark.parametrize("max_gap", [-1, 0, 0.5, np.nan, "8", True])
def test_a_largest_gap_that_is_no_multiple_is_refused(max_gap):
    with pytest.raises(ValueError, match="max_gap must be None or a number of at least 1"):
        propagate_samples(np.arange(5.0), np.zeros((5, 3)), [1.0, 0, 0, 0], max_gap=max_gap)


@pytest.mark.parametrize("degree", [1.5, -1, True, "3"])
def test_a_degree_that_is_no_whole_number_is_refused(degree):
    with pytest.raises(ValueError, match=r"the degree of the local polynomial must be a whole number, at least 0"):
        propagate_samples(np.arange(5.0), np.zeros((5, 3)), [1.0, 0, 0, 0], degree=degree)


def test_a_method_by_name_is_refused():
    with pytest.raises(ValueError, match=r"method must be an integration method, GaussLegendre.* the str 'rk4' was"):
        propagate_samples(np.arange(5.0), np.zeros((5, 3)), [1.0, 0, 0, 0], method="rk4")
