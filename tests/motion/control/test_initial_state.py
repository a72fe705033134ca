"""The initial state of a body, its closed-form motion about a program, and the stability of a law."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

import qtraj as qt
from qtraj.motion import control
from qtraj.motion.control import gains
from qtraj.motion.control.baselines import BASELINES

from ..rigs import Rest, ThreeAxis, random_gains

EXACT = 1e-13
NEAR_CRITICAL = 1e-6  # relative, of a double eigenvalue: the square root of round-off
MU = jnp.asarray([0.8, 0.36, 0.48, 0.0])
RATE_ERROR = jnp.asarray([0.2, -0.1, 0.3])
LAW = control.AccelerationLaw(2.0, 1.0)


@pytest.mark.parametrize("user_sign", [1.0, -1.0])
@pytest.mark.parametrize(("sign", "expected"), [("near", 1.0), ("far", -1.0), ("auto", 1.0)])
def test_place_gives_the_error_and_the_rate_error(user_sign, sign, expected):
    at = ThreeAxis()(1.3)
    quaternion, rate = control.place(LAW, at, user_sign * MU, RATE_ERROR, sign)
    np.testing.assert_allclose(control.error_quaternion(at, quaternion), expected * MU, atol=EXACT)
    own = Rotation.from_quat(np.array(MU), scalar_first=True).inv().apply(np.array(at.rate))
    np.testing.assert_allclose(rate, [0.0, *(own + RATE_ERROR)], atol=EXACT)


def test_the_automatic_sign_is_that_of_choose_sign():
    """With a fast rate towards −λ⁰ it is the far sign; for a baseline it is always the near one."""
    mu, fast = jnp.asarray([0.3, np.sqrt(1 - 0.09), 0, 0]), jnp.asarray([12.0, 0, 0])
    quaternion, rate = control.place(LAW, Rest()(0.0), mu, fast)
    np.testing.assert_array_equal(quaternion, control.choose_sign(LAW, Rest()(0.0), mu, rate))
    assert quaternion[0] < 0
    assert control.place(control.QuaternionFeedback(2.0, 1.0), Rest()(0.0), mu, fast)[0][0] > 0


def test_the_gibbs_normalization_has_a_unit_scalar_part_for_both_signs():
    at = ThreeAxis()(0.4)
    for sign in (1.0, -1.0):
        quaternion, rate = control.place(LAW, at, sign * MU, RATE_ERROR, "near", "gibbs")
        mu, slope = control.error_quaternion(at, quaternion), control.error_rate(at, quaternion, rate)
        np.testing.assert_allclose([mu[0], slope[0]], [1.0, 0.0], atol=EXACT)
        np.testing.assert_allclose(mu[1:], MU[1:] / MU[0], atol=EXACT)


def test_the_gibbs_vector_of_a_rate_law_decays_exponentially():
    """ġ + Kg = 0: with the Gibbs normalization, μ0 = 1 and μ_v = g at all times."""
    law, times = control.RateLaw(0.7), np.linspace(0.0, 3.0, 7)
    quaternion, rate = control.place(law, Rest()(0.0), MU, jnp.zeros(3), "near", "gibbs")
    motion = qt.simulate(Rest(), law, quaternion, rate, times, sign="as given")
    np.testing.assert_allclose(motion.error[:, 0], 1.0, atol=1e-9)
    expected = np.exp(-0.7 * times)[:, None] * np.asarray(MU[1:] / MU[0])
    np.testing.assert_allclose(motion.error[:, 1:], expected, atol=1e-9)


@pytest.mark.parametrize(
    "law", [control.AccelerationLaw(2.0, 1.0, "additive"), *(law(2.0, 1.0) for law in BASELINES.values())]
)
def test_the_gibbs_normalization_needs_a_linear_equation_of_the_gibbs_vector(law):
    with pytest.raises(ValueError, match="only for a law with the body or the inertial error"):
        control.place(law, Rest()(0.0), MU, RATE_ERROR, "near", "gibbs")


def test_without_an_attitude_error_the_body_has_the_attitude_of_the_program():
    at = ThreeAxis()(0.4)
    quaternion, rate = control.place(LAW, at, None, jnp.zeros(3))
    np.testing.assert_allclose(quaternion, at.quaternion, atol=EXACT)
    np.testing.assert_allclose(rate, [0.0, *at.rate], atol=EXACT)


@pytest.mark.parametrize(
    ("mu", "choices", "message"),
    [
        (MU, ("nearest",), "sign must be one of"),
        (MU, ("near", "euler"), "normalization must be one of"),
        (MU, ("far", "gibbs"), "contradicts the sign 'far'"),
        (jnp.asarray([0.0, 1.0, 0, 0]), ("near", "gibbs"), "half turn"),
    ],
)
def test_contradictory_choices_of_the_initial_state_are_refused(mu, choices, message):
    with pytest.raises(ValueError, match=message):
        control.place(LAW, Rest()(0.0), mu, RATE_ERROR, *choices)


@pytest.mark.parametrize("law", [control.AccelerationLaw(2.0, 1.5, kind) for kind in ("body", "inertial", "additive")])
def test_the_closed_motion_is_the_program_with_the_error_response(law):
    """`error` equals `error_response` and `quaternion` has that error; the first time is not zero."""
    program, times = ThreeAxis(), 2.0 + np.linspace(0.0, 4.0, 9)
    references = jax.jit(jax.vmap(program))(jnp.asarray(times))
    quaternion, rate = jnp.asarray([0.9, 0.7, -0.5, 0.6]), jnp.asarray([0.1, 0.6, -0.4, 0.9])
    motion = control.closed_motion(law, references, quaternion, rate, jnp.asarray(times))
    start = jax.tree.map(lambda x: x[0], references)
    x, v = (
        control.error_quaternion(start, quaternion, law.error),
        control.error_rate(start, quaternion, rate, law.error),
    )
    np.testing.assert_allclose(motion.error, qt.error_response(law, x, v, times - 2.0), atol=EXACT)
    np.testing.assert_allclose(motion.quaternion[0], quaternion, atol=EXACT)
    errors = jax.vmap(lambda r, q: control.error_quaternion(r, q, law.error))(references, motion.quaternion)
    np.testing.assert_allclose(errors, motion.error, atol=EXACT)
    rotations = [Rotation.from_quat(np.array(q), scalar_first=True) for q in (references.quaternion, motion.quaternion)]
    np.testing.assert_allclose(motion.angle, (rotations[0].inv() * rotations[1]).magnitude(), atol=1e-12)


def test_the_closed_motion_of_a_rate_law_needs_no_rate():
    times = jnp.linspace(0.0, 2.0, 3)
    references = jax.vmap(Rest())(times)
    motion = control.closed_motion(control.RateLaw(1.5), references, MU, jnp.full(4, jnp.nan), times)
    decay = np.exp(-1.5 * np.asarray(times))[:, None]
    np.testing.assert_allclose(motion.quaternion, np.eye(4)[0] + decay * (np.asarray(MU) - np.eye(4)[0]), atol=EXACT)


@pytest.fixture(scope="module")
def closed():
    """The closed form of one loop, and of a batch."""
    times = jnp.linspace(0.0, 2.0, 4)
    references = jax.vmap(ThreeAxis())(times)

    def motion(quaternion):
        return control.closed_motion(LAW, references, quaternion, jnp.zeros(4), times)

    return motion(MU), jax.vmap(motion)(jnp.stack([MU, -MU, RATE_ERROR[0] * MU]))


@pytest.mark.parametrize("suffix", [".toml", ".json"])
def test_closed_motions_are_stored_and_read_back(closed, suffix, tmp_path):
    for motion in closed:
        motion.save(tmp_path / f"motion{suffix}")
        back = qt.load(tmp_path / f"motion{suffix}")
        assert jax.tree.structure(back) == jax.tree.structure(motion)
        for a, b in zip(jax.tree.leaves(back), jax.tree.leaves(motion), strict=True):
            assert a.dtype == b.dtype == jnp.float64
            np.testing.assert_array_equal(a, b)


def test_closed_motions_are_labelled_data(closed):
    one, batch = closed
    dataset = one.to_xarray()
    np.testing.assert_array_equal(dataset["time"], one.times)
    np.testing.assert_array_equal(dataset["error"].sel(component="y"), one.error[:, 2])
    assert batch.to_xarray()["angle"].dims == ("batch", "sample")
    assert repr(one).startswith("ClosedMotion(4 instants, 0 … 2 s: attitude error ")
    assert repr(batch).startswith("ClosedMotion(batch of 3, 4 instants, ")


@pytest.mark.parametrize(("k1", "k2"), [(3.0, 2.0), (0.4, 9.0), (-0.4, 9.0), (1.0, -6.0)])
def test_the_spectral_abscissa_is_the_larger_root(k1, k2):
    expected = np.roots([1.0, k1, k2]).real.max()
    for law in (control.AccelerationLaw(k1, k2), control.GeometricFeedback(k1, k2)):
        assert control.spectral_abscissa(law) == pytest.approx(expected, rel=1e-12)
    assert control.spectral_abscissa(control.RateLaw([1.0, 2.0, k1, 3.0])) == pytest.approx(-min(1.0, k1))


def test_the_spectral_abscissa_of_full_gains_is_the_growth_rate_of_the_exponential():
    """ln|exp(At)|/t converges to the largest real part."""
    for k1, k2 in random_gains(np.random.default_rng(3))[2:]:
        block = np.block([[np.zeros((4, 4)), np.eye(4)], [-k2, -k1]])
        expected = np.log(np.linalg.norm(expm(60 * block)) / np.linalg.norm(expm(50 * block))) / 10
        assert control.spectral_abscissa(control.AccelerationLaw(k1, k2)) == pytest.approx(expected, rel=0.05)


def test_the_gain_of_a_rate_law_reaches_the_residual():
    k = gains.rate_from_settling_time(2.0, 0.01)
    assert float(jnp.exp(-2.0 * k)) == pytest.approx(0.01, rel=1e-14)
    slope = jax.grad(gains.rate_from_settling_time)(2.0, 0.01)
    assert float(slope) == pytest.approx(-float(k) / 2.0, rel=1e-14)


def test_the_spectral_abscissa_of_an_undamped_loop_is_zero():
    """Coupled gains: a real part within the eigenvalues' round-off counts as zero."""
    rng = np.random.default_rng(7)
    root = rng.normal(size=(4, 4))
    law = qt.AccelerationLaw(np.zeros((4, 4)), root @ root.T + np.eye(4))
    assert control.spectral_abscissa(law) == 0.0
    assert control.spectral_abscissa(qt.AccelerationLaw(0.1, root @ root.T + np.eye(4))) < 0


@pytest.mark.parametrize("kind", [list, np.array, jnp.asarray])
def test_the_state_of_lists_and_integers(kind):
    """Half a turn about x, and a rate about y, from integers."""
    law, at = qt.AccelerationLaw(2.0, 1.0), qt.Attitude(kind([1, 0, 0, 0]), kind([0, 0, 1]), kind([0, 0, 0]))
    quaternion, rate = qt.control.place(law, at, kind([0, 1, 0, 0]), kind([0, 2, 0]), "near")
    np.testing.assert_allclose(quaternion, [0, 1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(rate, [0, 0, 2, -1], atol=1e-15)  # the rate of the program in axes of the body
    with pytest.raises(ValueError, match="mu must have shape"):
        qt.control.place(law, at, kind([0, 1, 0]), kind([0, 2, 0]))
