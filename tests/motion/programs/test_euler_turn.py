"""Eigenaxis slews: SciPy as the oracle, kinematic identities, equal attitudes and half turns as singular points."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.derivatives import with_jacobians

from qtraj.algebra import quaternion
from qtraj.foundation.document import load
from qtraj.motion.profiles.s_curve import SCurve
from qtraj.motion.profiles.smooth_step import Quintic, Septic
from qtraj.motion.profiles.time_optimal import TimeOptimal
from qtraj.motion.programs.euler_turn import EulerTurn, SlewSequence

ROUND_OFF = 2e-14
GRADIENT = 1e-8  # of central differences of a smooth function of size 1, step 1e-5, relative to its third derivative


def kinematics(program, t):
    """The attitude at `t`, 2λ̇ − λ∘ω and ω̇ − ε."""
    at, along = jax.jvp(program, (t,), (jnp.ones_like(t),))
    return at, along.quaternion - quaternion.derivative(at.quaternion, at.rate), along.rate - at.acceleration


def quaternions(*shape, seed=1):
    q = np.random.default_rng(seed).normal(size=(*shape, 4))
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def test_a_thousand_slews_agree_with_scipy():
    starts, ends = quaternions(1000), quaternions(1000, seed=2)
    lengths = np.random.default_rng(3).uniform(0.1, 9, (2, 1000, 1))

    @jax.jit
    @jax.vmap
    def slews(start, end):
        program = EulerTurn(start, end, TimeOptimal(0.5, 0.3))
        times = program.duration * jnp.asarray([0.0, 0.21, 0.5, 0.83, 1.0, 1.5])
        angles = jax.vmap(lambda t: program.profile.derivatives(t, 2))(times)
        return jax.vmap(lambda t: kinematics(program, t))(times), angles, program.end, program.angle

    (at, quaternion_residual, rate_residual), angles, end, angle = jax.tree.map(
        np.asarray, slews(lengths[0] * starts, lengths[1] * ends)
    )
    first, last = (Rotation.from_quat(q, scalar_first=True) for q in (starts, ends))
    vectors = (first.inv() * last).as_rotvec()
    axes = vectors / np.linalg.norm(vectors, axis=1)[:, None]
    np.testing.assert_allclose(angle, np.linalg.norm(vectors, axis=1), atol=ROUND_OFF)
    for k in range(6):
        expected = first * Rotation.from_rotvec(angles[:, k, :1] * axes)
        gap = (Rotation.from_quat(at.quaternion[:, k], scalar_first=True).inv() * expected).magnitude()
        assert gap.max() < ROUND_OFF
        np.testing.assert_allclose(at.rate[:, k], angles[:, k, 1:2] * axes, atol=ROUND_OFF)
        np.testing.assert_allclose(at.acceleration[:, k], angles[:, k, 2:] * axes, atol=ROUND_OFF)
    np.testing.assert_allclose(quaternion_residual, 0, atol=ROUND_OFF)
    np.testing.assert_allclose(rate_residual, 0, atol=ROUND_OFF)
    # It starts at start_q, ends at ±end_q, whichever is nearer, and rests there.
    np.testing.assert_allclose(at.quaternion[:, 0], starts, atol=ROUND_OFF)
    sign = np.where(np.sum(starts * ends, axis=1) < 0, -1.0, 1.0)[:, None]
    np.testing.assert_allclose(end, sign * ends, atol=ROUND_OFF)
    np.testing.assert_allclose(at.quaternion[:, 4], end, atol=ROUND_OFF)
    np.testing.assert_array_equal(at.quaternion[:, 5], at.quaternion[:, 4])
    np.testing.assert_array_equal([at.rate[:, 5], at.acceleration[:, 4]], 0)


def test_the_axis_in_body_and_inertial_axes():
    start, end = quaternions(2)
    program = EulerTurn(3 * start, end, SCurve(1.0, 1.0, 1.0))
    inertial = (
        Rotation.from_quat(end, scalar_first=True) * Rotation.from_quat(start, scalar_first=True).inv()
    ).as_rotvec()
    np.testing.assert_allclose(program.angle * program.axis("inertial"), inertial, atol=ROUND_OFF)
    np.testing.assert_allclose(
        quaternion.rotate(jnp.asarray(end), program.axis()), program.axis("inertial"), atol=ROUND_OFF
    )
    with pytest.raises(ValueError, match="axes must be"):
        program.axis("world")


BASE = np.array([0.5, -0.5, 0.1, 0.7])
HALF = np.array([0.0, 0.6, 0.0, 0.8])  # a half slew about its vector part


@pytest.mark.parametrize("law", [Quintic(duration=2.0), TimeOptimal(3.0, 3.0, duration=2.5), SCurve(2.0, 3.0, 9.0)])
def test_equal_attitudes(law):
    def f(end, t):
        at = EulerTurn(BASE, end, law)(t)
        return jnp.concatenate([at.quaternion, at.rate])

    ends, h, t = np.stack([2 * BASE, -2 * BASE]), 1e-7, 0.9
    resting = np.concatenate([BASE / np.linalg.norm(BASE), np.zeros(3)])
    both = jax.vmap(with_jacobians(lambda e: f(e, t)))
    values, forward, reverse = jax.jit(both)(ends)
    np.testing.assert_allclose(values, [resting, resting], atol=ROUND_OFF)
    np.testing.assert_allclose(forward, reverse, atol=1e-12)
    assert np.isfinite(forward).all()
    if law.duration is None:  # the slew ends at once; a finite difference would see its beginning
        return
    steps = h * np.concatenate([np.eye(4), -np.eye(4)])
    near = jax.jit(jax.vmap(jax.vmap(lambda e: f(e, t))))(ends[:, None] + steps)
    difference = np.swapaxes(near[:, :4] - near[:, 4:], 1, 2) / (2 * h)
    np.testing.assert_allclose(forward, difference, atol=1e-7)
    assert np.abs(forward[:, 4:]).max() > 0.1


def test_half_turns():
    start = BASE / np.linalg.norm(BASE)
    end = np.asarray(quaternion.product(jnp.asarray(start), jnp.asarray(HALF)))

    def f(end):
        program = EulerTurn(start, end, Septic(duration=2.0))
        at = program(0.8)
        return jnp.concatenate([at.quaternion, at.rate, program.angle[None]])

    values, gradient, reverse = jax.jit(with_jacobians(f))(end)
    np.testing.assert_allclose(values[-1], math.pi, atol=ROUND_OFF)
    np.testing.assert_allclose(values[4:7] / np.linalg.norm(values[4:7]), HALF[1:], atol=ROUND_OFF)
    np.testing.assert_allclose(gradient, reverse, atol=1e-12)
    assert np.isfinite(gradient).all()
    # Along the axis of rotation the derivative is one-sided; across it, it is two-sided.
    side, h = np.asarray(quaternion.product(jnp.asarray(start), jnp.asarray([0.0, 0.0, 1.0, 0.0]))), 1e-6
    f = jax.jit(f)
    np.testing.assert_allclose(gradient @ side, (f(end + h * side) - f(end - h * side)) / (2 * h), atol=1e-8)


def test_gradients_of_a_slew():
    law = SCurve(0.9, 0.7, 2.0)
    x = np.concatenate([BASE, [0.1, 0.9, -0.3, 0.4]])

    def f(x):
        program = EulerTurn(x[:4], x[4:], law)
        at = program(1.3)
        return jnp.concatenate([at.quaternion, at.rate, at.acceleration, program.duration[None]])

    _, forward, reverse = jax.jit(with_jacobians(f))(x)
    h = 1e-5
    near = jax.jit(jax.vmap(f))(x + h * np.concatenate([np.eye(8), -np.eye(8)]))
    np.testing.assert_allclose(forward, (near[:8] - near[8:]).T / (2 * h), atol=GRADIENT)
    np.testing.assert_allclose(reverse, forward, atol=1e-12)


def test_end_rates_along_the_axis():
    start, end = quaternions(2, seed=9)
    program = EulerTurn(start, end, TimeOptimal(1.0, 0.5, start_rate=0.2, end_rate=-0.1))
    np.testing.assert_allclose(program(0.0).rate, 0.2 * program.axis(), atol=ROUND_OFF)
    np.testing.assert_allclose(program(program.duration).rate, -0.1 * program.axis(), atol=ROUND_OFF)
    np.testing.assert_allclose(program(program.duration).quaternion, program.end, atol=ROUND_OFF)


def test_a_slew_sequence_rests_at_its_attitudes():
    attitudes = quaternions(6, seed=4) * np.array([1.0, -2.0, 1.0, 0.5, -1.0, 1.0])[:, None]
    attitudes[3] = -attitudes[2]  # the same attitude: no slew in between
    sequence = SlewSequence(attitudes, SCurve(1.0, 0.8, 2.0))
    times = np.asarray(sequence.times)
    singles = jax.vmap(lambda a, b: EulerTurn(a, b, sequence.law)(0.3).quaternion)
    durations = jax.vmap(lambda a, b: EulerTurn(a, b, sequence.law).duration)
    np.testing.assert_allclose(np.diff(times), jax.jit(durations)(attitudes[:-1], attitudes[1:]), rtol=1e-13)
    assert times[2] == times[3]

    def at_times(sequence, times):
        return jax.vmap(lambda t: kinematics(sequence, t))(times)

    grid = np.linspace(0, times[-1], 2001)
    at, quaternion_residual, rate_residual = jax.jit(at_times)(sequence, np.concatenate([times, grid]))
    np.testing.assert_allclose(np.abs(np.sum(at.quaternion[:6] * attitudes, axis=1)), np.linalg.norm(attitudes, axis=1))
    np.testing.assert_allclose(at.rate[:6], 0, atol=ROUND_OFF)
    np.testing.assert_allclose(quaternion_residual, 0, atol=ROUND_OFF)
    np.testing.assert_allclose(rate_residual, 0, atol=ROUND_OFF)
    steps = np.linalg.norm(np.diff(at.quaternion[6:], axis=0), axis=1)
    assert steps.max() <= 0.5 * np.linalg.norm(at.rate, axis=1).max() * grid[1] * 1.001  # the sign is continuous
    alone, within = jax.jit(singles)(attitudes[:-1], attitudes[1:])[4], sequence(times[4] + 0.3).quaternion
    np.testing.assert_allclose(alone * np.sign(alone @ within), within, atol=ROUND_OFF)


def test_the_switches_of_a_slew_sequence_are_those_of_its_slews():
    attitudes = quaternions(4, seed=6)
    attitudes[2] = -attitudes[1]  # the same attitude: its switches coincide
    law = SCurve(1.0, 0.8, 2.0)
    sequence, singles = SlewSequence(attitudes, law), [EulerTurn(attitudes[k], attitudes[k + 1], law) for k in range(3)]
    shifted = [float(t) + single.switches for t, single in zip(sequence.times, singles, strict=False)]
    np.testing.assert_allclose(sequence.switches, np.concatenate(shifted), rtol=1e-14)
    np.testing.assert_array_equal(sequence.switches[7:14], sequence.times[1])
    assert sequence.switches[-1] == sequence.duration
    # The jerk is constant between two switches.
    edges = np.concatenate([[0.0], sequence.switches])
    assert np.all(np.diff(edges) >= 0)
    long = np.diff(edges) > 1e-6
    inner = edges[:-1, None] + np.diff(edges)[:, None] * np.linspace(0.01, 0.99, 5)
    acceleration = np.asarray(jax.jit(jax.vmap(lambda t: sequence(t).acceleration))(inner[long].ravel())).reshape(
        -1, 5, 3
    )
    np.testing.assert_allclose(np.diff(acceleration, n=2, axis=1), 0, atol=1e-12)


@pytest.mark.parametrize("whole_turns", [1, 2])
def test_round_off_is_not_a_slew(whole_turns):
    """After whole turns the attitude differs by round-off: the slew takes no time, but its gradient is kept."""
    start, half = jnp.asarray(BASE / np.linalg.norm(BASE)), whole_turns * math.pi
    spun = quaternion.product(start, jnp.asarray([math.cos(half), 0.0, 0.0, math.sin(half)]))
    slew = EulerTurn(start, spun, TimeOptimal(1.0, 1.0))
    assert (slew.angle, slew.duration) == (0.0, 0.0)
    gradient = jax.jacfwd(lambda q: EulerTurn(start, q, slew.law).rotation_vector)(spun)
    np.testing.assert_allclose(np.linalg.svd(gradient)[1], 2.0, rtol=1e-12)  # as for any small rotation
    assert EulerTurn([1.0, 0, 0, 0], [1.0, 1e-12, 0, 0], slew.law).angle == pytest.approx(2e-12)


@pytest.mark.parametrize("suffix", [".toml", ".json"])
def test_programs_are_stored_exactly(suffix, tmp_path):
    law = TimeOptimal(0.3, 0.2)
    for program in (EulerTurn(BASE, HALF, law), SlewSequence([BASE, HALF, -BASE], law)):
        program.save(tmp_path / f"program{suffix}")
        again = load(tmp_path / f"program{suffix}")
        assert jax.tree.structure(again) == jax.tree.structure(program)
        assert jax.tree.all(jax.tree.map(np.array_equal, again, program))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: EulerTurn([0.0, 0, 0, 0], BASE, Quintic(1.0)), "start_q: quaternion 0 is zero"),
        (lambda: EulerTurn(BASE, [1.0, 0, 0], Quintic(1.0)), r"end_q must have shape \(4,\)"),
        (lambda: EulerTurn(BASE, [math.nan, 0, 0, 0], Quintic(1.0)), "end_q must be finite"),
        (lambda: EulerTurn(BASE, HALF, TimeOptimal(1.0, 1.0, duration=0.1)), r"rad with .*max_rate = 1 rad/s"),
        (lambda: SlewSequence([BASE], Quintic(1.0)), "at least two quaternions"),
        (lambda: SlewSequence([BASE, 0 * BASE], Quintic(1.0)), "quaternion 1 is zero"),
        (lambda: SlewSequence([BASE, BASE, HALF], SCurve(1.0, 1.0, 1.0, duration=1.0)), "needs at least"),
        (lambda: SlewSequence([BASE, HALF], TimeOptimal(1.0, 1.0, end_rate=0.0)), "is at rest at each attitude"),
    ],
)
def test_bad_input_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize("angle", [4.0, -4.0, 2 * math.pi, 20.0, 0.5, 0.0])
@pytest.mark.parametrize("axes", ["body", "inertial"])
def test_a_slew_about_an_axis_turns_by_any_angle(angle, axes):
    """SciPy is the oracle for the attitude; the rate is the derivative of the angle along the axis."""
    start, axis = quaternions(seed=5), np.array([1.0, -2.0, 0.5])
    program = EulerTurn.about(axis, angle, 3 * start, Quintic(duration=8.0), axes)
    assert float(program.angle) == pytest.approx(abs(angle), abs=1e-15)
    body = axis if axes == "body" else quaternion.rotate(quaternion.conjugate(start), axis)
    e = np.asarray(body) / np.linalg.norm(body)
    first = Rotation.from_quat(start, scalar_first=True)
    for t in (0.0, 1.7, 4.0, 8.0, 9.0):
        share = float(Quintic(duration=8.0).profile(1.0).angle(t))
        right = (first * Rotation.from_rotvec(share * angle * e)).as_quat(scalar_first=True)
        at = program(t)
        assert abs(np.dot(at.quaternion, right)) == pytest.approx(1.0, abs=ROUND_OFF)
        np.testing.assert_allclose(at.rate, angle * e * float(Quintic(duration=8.0).profile(1.0).rate(t)), atol=1e-13)
        at, derivative, second = kinematics(program, jnp.asarray(t))
        np.testing.assert_allclose(derivative, 0, atol=1e-13)
        np.testing.assert_allclose(second, 0, atol=1e-13)
    np.testing.assert_allclose(program.end, program(8.0).quaternion, atol=1e-14)


def test_a_slew_about_an_axis_is_continuous_saved_and_differentiable(tmp_path):
    start = np.array([1.0, 0.0, 0.0, 0.0])
    program = EulerTurn.about([0, 0, 2], 2 * math.pi, start, SCurve(1.0, 0.5, 1.0))
    np.testing.assert_allclose(program.end, -start, atol=1e-15)  # a whole turn changes the sign of λ
    program.save(tmp_path / "turn.toml")
    np.testing.assert_array_equal(load(tmp_path / "turn.toml")(2.0).quaternion, program(2.0).quaternion)

    def third(angle):
        return EulerTurn.about([0.0, 1.0, 2.0], angle, start, Quintic(duration=8.0))(3.0).quaternion[3]

    derivatives = jax.jit(with_jacobians(third))
    for angle in (0.0, 5.0):
        slope = (float(third(angle + 1e-5)) - float(third(angle - 1e-5))) / 2e-5
        for derivative in derivatives(angle)[1:]:
            assert float(derivative) == pytest.approx(slope, abs=GRADIENT)
    np.testing.assert_allclose(jax.vmap(third)(jnp.array([1.0, 5.0])), [third(1.0), third(5.0)], atol=1e-15)


def test_slews_about_no_axis_or_to_another_end_are_refused():
    start, law = [1.0, 0.0, 0.0, 0.0], Quintic(duration=8.0)
    with pytest.raises(ValueError, match="axis must not be zero"):
        EulerTurn.about([0, 0, 0], 1.0, start, law)
    with pytest.raises(ValueError, match="the angle of a slew must be finite"):
        EulerTurn.about([0, 0, 1], math.nan, start, law)
    with pytest.raises(ValueError, match="vector must be a rotation from start_q to end_q, but it ends"):
        EulerTurn(start, [0.0, 1.0, 0.0, 0.0], law, [0.0, 0.0, 1.0])
    with pytest.raises(ValueError, match="needs at least"):
        EulerTurn.about([0, 0, 1], 20.0, start, TimeOptimal(0.5, 0.3, duration=5.0))
