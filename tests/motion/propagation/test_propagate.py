"""λ(t) from a known ω(t): published errors of coning, |λ|, axes, and tolerances that are reached or reported."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.foundation.outcome import ResultCode
from qtraj.motion.propagation.gauss_legendre import GaussLegendre
from qtraj.motion.propagation.magnus import Magnus
from qtraj.motion.propagation.propagate import propagate, propagate_with_estimate

from ...path.test_reference import CASES, build
from .coning import FAST, SLOW, Coning, angles

TOLERANCE = 1e-12
"""[rad] The default tolerance."""
ROUND_OFF = 1e-14
REFERENCE_ROUND_OFF = 3e-14
"""[rad] Round-off of the closed form: one rounding of a phase of 65 rad."""
FACTOR = 2.0
"""Allowed ratio between a published error and ours."""
ORDER_MARGIN = 0.4
"""By which the observed order may be too low: the coarsest steps span a large part of a cone."""

EVALUATIONS = (48, 96, 192, 384, 768)
TABLE = {
    Magnus(4): (4.2e-4, 2.6e-5, 1.6e-6, 1.0e-7, 6.3e-9),
    Magnus(6): (1.0e-5, 2.0e-7, 3.4e-9, 5.3e-11, 8.4e-13),
    GaussLegendre(4): (2.6e-6, 1.1e-8, 4.2e-11, 1.6e-13, 7e-16),
    GaussLegendre(8): (1.7e-10, 3.0e-15),
}
FAST_TABLE = {Magnus(6): {192: 5.0e-3, 768: 1.3e-6, 3072: 3.1e-10}, GaussLegendre(8): {192: 3.6e-11, 768: 1e-14}}
QUATERNION = np.array([0.1, -0.7, 0.5, 0.4])
TIMES = np.array([0.0, 0.4, 1.0, 2.5])


def final_errors(coning, end, method, evaluations):
    """Errors with these numbers of rate evaluations, in equal steps."""
    steps = [count // len(method.nodes) for count in evaluations]
    first = coning.quaternions([0.0])[0]
    qs = [propagate(coning.rate, first, [0.0, end], method, steps=count)[-1] for count in steps]
    return angles(np.stack(qs), coning.quaternions(np.full(len(qs), end)))


@pytest.mark.parametrize("method", TABLE, ids=str)
def test_the_table_of_coning(method):
    """β = 10°, Ω = 0.74π, 10 s, with the orders of convergence."""
    errors = final_errors(SLOW, 10.0, method, EVALUATIONS[: len(TABLE[method])])
    np.testing.assert_array_less(errors, FACTOR * np.array(TABLE[method]) + ROUND_OFF)
    np.testing.assert_array_less(np.array(TABLE[method]) / FACTOR, errors + ROUND_OFF)
    regular = errors[errors > 10 * ROUND_OFF]
    assert np.all(np.log2(regular[:-1] / regular[1:]) > method.order - ORDER_MARGIN)


@pytest.mark.parametrize(("stages", "steps"), [(1, 2048), (2, 256), (3, 64), (5, 24), (8, 12)])
def test_the_order_of_collocation_is_twice_the_number_of_stages(stages, steps):
    errors = final_errors(FAST, 10.3, GaussLegendre(stages), [stages * steps, 2 * stages * steps])
    assert errors[1] > 10 * REFERENCE_ROUND_OFF
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2 * stages, abs=ORDER_MARGIN)


@pytest.mark.parametrize("method", FAST_TABLE, ids=str)
def test_the_table_of_fast_coning(method):
    """β = 50°, Ω = 2π, 10.3 s. The last error of Gauss–Legendre is round-off."""
    figures = np.array(list(FAST_TABLE[method].values()))
    errors = final_errors(FAST, 10.3, method, FAST_TABLE[method])
    np.testing.assert_array_less(errors, FACTOR * figures + REFERENCE_ROUND_OFF)
    np.testing.assert_array_less(figures / FACTOR, errors + REFERENCE_ROUND_OFF)


@pytest.mark.parametrize(
    ("method", "tolerance"),
    [(GaussLegendre(8), 1e-4), (GaussLegendre(8), 1e-8), (GaussLegendre(8), 1e-12), (Magnus(6), 1e-5)],
    ids=str,
)
def test_the_tolerance_is_reached_and_the_estimate_is_a_bound(method, tolerance):
    times = np.array([0.0, 0.5, 10.3])
    q0 = FAST.quaternions([0.0])[0]
    solution = propagate_with_estimate(FAST, q0, times, method, tolerance=tolerance)
    error = angles(solution.quaternion, FAST.quaternions(times))[-1]
    assert solution.code == ResultCode.successful
    assert error <= solution.estimate + REFERENCE_ROUND_OFF
    assert solution.estimate < min(1.5 * tolerance, 20 * error + 30 * ROUND_OFF)
    np.testing.assert_array_equal(propagate(FAST, q0, times, method, tolerance=tolerance), solution.quaternion)


def test_times_are_output_instants_only():
    """Uneven times that do not start at zero: λ(times[0]) = q0, and every instant is accurate."""
    times = np.array([5.0, 5.001, 5.8, 6.0, 9.7, 9.70001, 15.3])
    qs = propagate(FAST, FAST.quaternions([5.0])[0], times)
    assert angles(qs, FAST.quaternions(times)).max() < TOLERANCE
    np.testing.assert_array_equal(qs[0], FAST.quaternions([5.0])[0])
    np.testing.assert_array_equal(propagate(FAST, QUATERNION, [5.0]), QUATERNION[None])


def test_body_and_inertial_axes_agree():
    q0 = FAST.quaternions([0.0])[0]
    body, inertial = propagate(FAST, q0, TIMES), propagate(FAST.inertial, q0, TIMES, axes="inertial")
    np.testing.assert_allclose(inertial, body, rtol=0, atol=TOLERANCE)
    assert np.abs(propagate(FAST.inertial, q0, TIMES) - body)[-1].max() > 0.1  # the choice of axes matters


@pytest.mark.parametrize("axes", ["body", "inertial"])
@pytest.mark.parametrize("scale", [1.0, -3.0, 1e-3, 1e6])
def test_the_scalar_part_determines_the_length(axes, scale):
    """|λ|² = |λ0|² exp ∫ω0 in either axes, and ω0 does not change the attitude."""

    def omega(t):
        return jnp.concatenate([jnp.sin(3 * t)[None], FAST(t)])

    q0 = scale * QUATERNION
    qs = propagate(omega, q0, TIMES, axes=axes)
    log_scale = (1 - np.cos(3 * TIMES)) / 3
    np.testing.assert_allclose(np.sum(qs**2, axis=1), np.sum(q0**2) * np.exp(log_scale), rtol=TOLERANCE, atol=0)
    plain = propagate(FAST, q0, TIMES, axes=axes)
    np.testing.assert_allclose(np.linalg.norm(plain, axis=1), np.linalg.norm(q0), rtol=ROUND_OFF, atol=0)
    np.testing.assert_allclose(
        qs, plain * np.exp(log_scale / 2)[:, None], rtol=0, atol=TOLERANCE * np.linalg.norm(qs[-1])
    )


class ProgramRate(eqx.Module):
    """ω⁰ of a program, as a Module, so that many paths share one compilation."""

    program: qt.FrameProgram

    def __call__(self, t):
        return self.program(t).rate


FRAMES = {"natural": qt.Natural(), "upright": qt.Upright(), "minimizing": qt.RotationMinimizing()}


def padded(path):
    """The path with polynomials of equal length, so that all share one compilation."""
    polynomials = (jnp.pad(c, (0, 4 - c.shape[0])) for c in (path.radius, path.angle, path.height))
    return qt.SpiralHelix(*polynomials, path.duration)


ALL = [(i, "natural") for i in range(len(CASES))]
SOME = [(i, name) for i in range(0, len(CASES), 7) for name in ("upright", "minimizing")]


@pytest.mark.parametrize(("index", "name"), ALL + SOME, ids=lambda x: CASES[x]["kind"] if isinstance(x, int) else x)
def test_trihedral_is_the_flow_of_its_own_rate(index, name):
    """Integrating the program's rate from its first attitude reproduces its last, with its sign, at any scale of λ."""
    program = qt.FrameProgram(padded(build(CASES[index])), FRAMES[name])
    times = np.array([0.0, float(program.duration)])
    first, last = (program(t).quaternion for t in times)
    for scale in (1.0, -3.0, 1e-3, 1e6):
        qs = propagate(ProgramRate(program), scale * first, times)
        np.testing.assert_allclose(qs[-1] / scale, last, rtol=0, atol=TOLERANCE)
        np.testing.assert_allclose(np.linalg.norm(qs, axis=1), abs(scale), rtol=ROUND_OFF, atol=0)


@pytest.mark.parametrize("switch", [1.2345, 0.7, 1.5])
def test_a_jump_between_the_nodes_is_noticed(switch):
    """A jump at 1.2345 s is 3e-6 s from the end of a step, beyond the last Gauss point."""

    def omega(t):
        return jnp.where(t < switch, 1.0, -1.0) * jnp.asarray([1.0, 2.0, -2.0]) / 3

    times = np.array([0.0, 3.0])
    angle = switch - (3.0 - switch)
    expected = qt.rotation.from_rotation_vector(jnp.asarray(angle * np.array([1.0, 2.0, -2.0]) / 3))
    qs = propagate(omega, [1.0, 0, 0, 0], times)
    assert angles(qs[-1:], expected[None]) < TOLERANCE
    solution = propagate_with_estimate(omega, [1.0, 0, 0, 0], np.array([0.0, switch, 3.0]))
    assert angles(solution.quaternion[-1:], expected[None]) < TOLERANCE
    assert solution.steps == 8  # the switch is an output time: no refinement is needed


def test_a_missed_tolerance_is_reported():
    q0 = FAST.quaternions([0.0])[0]
    times = np.array([0.0, 10.3])
    assert np.isnan(propagate(FAST, q0, times, max_steps=20)).all()
    with pytest.raises(RuntimeError, match=r"the tolerance was not reached\. Try a larger max_steps.* after 8 steps"):
        propagate(FAST, q0, times, max_steps=20, throw=True)
    solution = propagate_with_estimate(FAST, q0, times, max_steps=20)
    assert solution.code == ResultCode.tolerance_not_reached
    assert "max_steps" in solution.result
    assert solution.estimate > 0.1 * angles(solution.quaternion, FAST.quaternions(times))[-1] > TOLERANCE
    fixed = propagate_with_estimate(FAST, q0, times, steps=24)
    assert fixed.code == ResultCode.tolerance_not_reached
    assert fixed.estimate == pytest.approx(3.6e-11, rel=1.0)
    with pytest.raises(RuntimeError, match="NaN or infinite"):
        propagate(lambda t: FAST(t) / (t - t), q0, times, throw=True)


def test_under_jit_and_vmap():
    """The steps of a traced rate are chosen at run time, for each batch element: failures do not affect others."""
    times = np.array([0.0, 1.0, 2.0])
    speeds = jnp.asarray([1.0, np.nan, 16.0, 1e5])

    @jax.jit
    @jax.vmap
    def traced(speed):
        coning = eqx.tree_at(lambda c: c.speed, FAST, speed)
        return propagate_with_estimate(coning, QUATERNION, times, max_steps=64)

    batch = traced(speeds)
    plain = jnp.stack([propagate(Coning(50.0, speed), QUATERNION, times) for speed in speeds[::2]])
    np.testing.assert_allclose(batch.quaternion[::2], plain, rtol=0, atol=TOLERANCE)
    reached, missed, not_finite = ResultCode.successful, ResultCode.tolerance_not_reached, ResultCode.not_finite
    assert batch.code.tolist() == [reached, not_finite, reached, missed]
    assert [text.split(".")[0] for text in batch.result][::3] == [
        "the propagation reached its tolerance",
        "the tolerance was not reached",
    ]
    assert batch.steps[0] < batch.steps[2]


def test_with_a_known_rate_the_steps_are_chosen_while_tracing():
    """The number of steps is then known, so the executable has no search and no empty slots."""
    plain, steps = propagate_with_estimate(FAST, QUATERNION, TIMES), []

    @jax.jit
    def staged(q):
        solution = propagate_with_estimate(FAST, q, TIMES)
        steps.append(int(solution.steps))
        return solution.quaternion

    np.testing.assert_allclose(staged(jnp.asarray(2 * QUATERNION)), 2 * plain.quaternion, rtol=0, atol=TOLERANCE)
    assert steps == [plain.steps]


def test_a_missed_tolerance_under_jit_is_nan_or_raises():
    @eqx.filter_jit
    def run(coning, throw):
        return propagate(coning, QUATERNION, [0.0, 10.3], max_steps=8, throw=throw)

    assert np.isnan(run(FAST, False)).all()
    with pytest.raises(RuntimeError, match="the tolerance was not reached"):
        run(FAST, True).block_until_ready()


def test_in_a_batch_only_the_element_that_fails_is_nan():
    times = np.array([0.0, 1.0])
    qs = jax.vmap(lambda speed: propagate(eqx.tree_at(lambda c: c.speed, FAST, speed), QUATERNION, times))(
        jnp.asarray([1.0, np.nan, 2.0])
    )
    assert np.isnan(qs).all(axis=(1, 2)).tolist() == [False, True, False]
    assert np.isfinite(qs[::2]).all()


def test_float32():
    coning = Coning(50.0, 2 * np.pi, jnp.float32)
    times = jnp.linspace(0.0, 3.0, 4, dtype=jnp.float32)
    qs = propagate(coning, jnp.asarray(coning.quaternions([0.0])[0], jnp.float32), times)
    assert qs.dtype == jnp.float32
    assert angles(np.asarray(qs, float), FAST.quaternions(times)).max() < 1e-5
    np.testing.assert_allclose(np.linalg.norm(qs, axis=1), 1.0, rtol=1e-6, atol=0)
    staged = jax.jit(lambda q: propagate(coning, q, times))(qs[0])
    np.testing.assert_allclose(staged, qs, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"times": [0.0, 1.0, 1.0]}, r"times\[2\] = 1 s follows times\[1\] = 1 s"),
        ({"times": [[0.0, 1.0]]}, "non-empty vector of instants"),
        ({"times": []}, "non-empty vector of instants"),
        ({"times": [0.0, np.nan]}, "times must be finite"),
        ({"q0": np.zeros(4)}, "must not be zero"),
        ({"q0": np.ones(3)}, r"shape \(4,\)"),
        ({"axes": "world"}, "'body' or 'inertial', but 'world'"),
        ({"omega": lambda t: jnp.ones(5)}, r"omega\(t\) must have shape"),
        ({"omega": np.zeros((4, 3))}, r"must be a function of time, but ndarray .* call propagate_samples\("),
        ({"tolerance": 0.0}, "tolerance must be positive"),
        ({"steps": 0}, "at least 1 in each interval"),
        ({"max_steps": 2}, "at least the number of intervals between the times, 3, but 2"),
    ],
)
def test_bad_input(change, message):
    arguments = {"omega": FAST, "q0": QUATERNION, "times": TIMES} | change
    with pytest.raises(ValueError, match=message):
        propagate(**arguments)
