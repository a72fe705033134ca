"""Spins, and sequences of programs that meet in attitude and rate."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import qtraj as qt

START = np.array([0.4, -1.0, 0.3, 2.0])
RATE = np.array([0.2, -0.5, 0.4])


def attitude(q):
    return Rotation.from_quat(np.asarray(q), scalar_first=True)


@pytest.mark.parametrize("axes", ["body", "inertial"])
def test_a_spin_is_scipys_rotation_by_rate_times_time(axes):
    spin = qt.Spin(RATE, 30.0, START, axes)
    for t in (-1.0, 0.0, 3.3, 30.0):
        turn, first = Rotation.from_rotvec(t * RATE), attitude(START)
        right = first * turn if axes == "body" else turn * first
        at = spin.at(t, axes)
        assert (attitude(at.quaternion).inv() * right).magnitude() < 1e-14
        np.testing.assert_allclose(at.rate, RATE, atol=1e-15)
        np.testing.assert_array_equal(at.acceleration, np.zeros(3))
    np.testing.assert_array_equal(spin.end, spin(30.0).quaternion)


def test_a_spin_changes_the_sign_of_its_quaternion_with_every_turn():
    spin = qt.Spin([0, 0, 2 * np.pi], 5.0)
    np.testing.assert_allclose([spin(t).quaternion[0] for t in (0, 1, 2)], [1, -1, 1], atol=1e-15)
    assert isinstance(spin(1.0).quaternion, np.ndarray)
    still = qt.Spin([0, 0, 0], 5.0, START)(3.0)
    np.testing.assert_allclose(still.quaternion, START / np.linalg.norm(START), atol=1e-15)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (([1, 2], 1.0), "the rate of a spin"),
        ((RATE, 0.0), "the duration of a spin must be"),
        ((RATE, 1.0, [0, 0, 0, 0]), "start_q must not be zero"),
        ((RATE, 1.0, START, "world"), "axes"),
    ],
)
def test_what_is_not_a_spin_is_refused(arguments, text):
    with pytest.raises(ValueError, match=text):
        qt.Spin(*arguments)


def spun_up():
    """From rest to 0.1 rad/s, a spin of more than a turn, to a spin about another axis, and to rest again."""
    up = qt.EulerTurn.about([0, 0, 1], 0.5, START, qt.TimeOptimal(max_acceleration=0.01, end_rate=0.1))
    spin = qt.Spin([0, 0, 0.1], 80.0, up.end)
    other = np.asarray(qt.quaternion.product(-spin.end, qt.rotation.from_rotation_vector([0.3, 0.8, 0.6])))
    table = qt.TableProgram([0.0, 12.0], [spin.end, other], rates=[[0, 0, 0.1], [0, 0.2, 0]])
    again = qt.Spin([0, 0.2, 0], 9.0, other)
    down = qt.EulerTurn.about([0, 1, 0], 1.0, again.end, qt.TimeOptimal(max_acceleration=0.02, start_rate=0.2))
    return qt.ProgramSequence([up, spin, table, again, down])


SEQUENCE = spun_up()


def test_a_sequence_is_continuous_with_its_rates_as_derivatives():
    assert float(SEQUENCE.duration) == pytest.approx(10.0 + 80.0 + 12.0 + 9.0 + 10.0)
    times = np.asarray(SEQUENCE.times)
    for t in times[1:-1]:
        before, after = SEQUENCE(t - 1e-9), SEQUENCE(t + 1e-9)
        np.testing.assert_allclose(before.quaternion, after.quaternion, atol=1e-8)
        np.testing.assert_allclose(before.rate, after.rate, atol=1e-8)
    step = 1e-4
    for t in (3.0, 50.0, 95.0, 105.0, 115.0):
        before, at, after = (SEQUENCE(x) for x in (t - step, t, t + step))
        slope = (np.asarray(after.quaternion) - np.asarray(before.quaternion)) / (2 * step)
        np.testing.assert_allclose(qt.quaternion.rate(np.asarray(at.quaternion), slope), at.rate, atol=1e-8)
        slope = (np.asarray(after.rate) - np.asarray(before.rate)) / (2 * step)
        np.testing.assert_allclose(slope, at.acceleration, atol=1e-7)


def test_s_curves_join_a_spin_with_continuous_accelerations():
    limits = {"max_acceleration": 0.01, "max_jerk": 0.005}
    up = qt.EulerTurn.about([0, 0, 1], 1.0, START, qt.SCurve(**limits, end_rate=0.1))
    spin = qt.Spin([0, 0, 0.1], 20.0, up.end)
    down = qt.EulerTurn.about([0, 0, 1], 1.0, spin.end, qt.SCurve(**limits, start_rate=0.1))
    program = qt.ProgramSequence([up, spin, down])
    times = np.asarray(program.times)
    np.testing.assert_allclose(times[1], times[3] - times[2], rtol=1e-14)
    for t in times[1:-1]:
        for x in (program(t - 1e-9), program(t + 1e-9)):
            np.testing.assert_allclose(x.rate, [0, 0, 0.1], atol=1e-10)
            np.testing.assert_allclose(x.acceleration, [0, 0, 0], atol=1e-10)


def test_a_sequence_is_the_integral_of_its_rate():
    end = qt.propagate(lambda t: SEQUENCE(t).rate, SEQUENCE(0.0).quaternion, SEQUENCE.times)[-1]
    np.testing.assert_allclose(end, SEQUENCE(SEQUENCE.duration).quaternion, atol=1e-7)


def test_a_sequence_inside_jit_and_vmap_with_derivatives():
    times = np.array([-1.0, 5.0, 10.0, 60.0, 99.0, 104.0, 120.0, 125.0])
    found = jax.jit(jax.vmap(lambda t: SEQUENCE(t)))(times)
    for k, t in enumerate(times):
        for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(SEQUENCE(t)), strict=True):
            np.testing.assert_allclose(a[k], b, atol=1e-12)

    def middle(rate):
        spin = qt.Spin(rate * jnp.array([0, 0, 1.0]), 10.0)
        return qt.ProgramSequence([spin, qt.Spin(rate * jnp.array([0, 0, 1.0]), 5.0, spin.end)])(12.0).quaternion[3]

    assert float(jax.jit(jax.grad(middle))(0.1)) == pytest.approx(6.0 * np.cos(0.6), rel=1e-12)  # sin(6 rate)


def test_instants_at_which_the_acceleration_may_jump():
    switches = np.asarray(SEQUENCE.switches)
    assert (np.diff(switches) >= 0).all()
    assert set(np.round(np.asarray(SEQUENCE.times)[1:], 9)) <= set(np.round(switches, 9))


def test_a_sequence_can_be_saved_simulated_and_evaluated(tmp_path):
    SEQUENCE.save(tmp_path / "sequence.toml")
    np.testing.assert_array_equal(qt.load(tmp_path / "sequence.toml")(97.0).quaternion, SEQUENCE(97.0).quaternion)
    table = qt.evaluate(SEQUENCE, np.linspace(0.0, 100.0, 5))
    np.testing.assert_allclose(table.quaternion[2], SEQUENCE(50.0).quaternion, atol=1e-12)
    law = qt.AccelerationLaw(*qt.control.from_settling_time(3.0))
    start = SEQUENCE(0.0)
    flight = qt.simulate(SEQUENCE, law, start.quaternion, start.rate, np.linspace(0.0, 20.0, 5))
    np.testing.assert_allclose(flight.angle, np.zeros(5), atol=1e-6)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_an_angle_that_determines_no_attitude_is_refused(dtype):
    largest, law = 0.01 / np.finfo(dtype).eps, qt.Quintic(duration=1.0)
    start = jnp.array([1, 0, 0, 0], dtype)
    for build in (
        lambda angle: qt.Spin(jnp.array([0, 0, -angle], dtype), jnp.asarray(2, dtype), start),
        lambda angle: qt.EulerTurn.about([0, 0, 1], jnp.asarray(-2 * angle, dtype), start, law),
    ):
        build(0.4 * largest)
        with pytest.raises(ValueError, match=r"must be at most .* rounding errors of more than 0.01 rad"):
            build(0.6 * largest)


def test_programs_that_do_not_meet_are_refused():
    spin = qt.Spin([0, 0, 0.1], 10.0)
    with pytest.raises(ValueError, match=r"program 1 .* attitude at the end of program 0, but the angle .* is 1 rad"):
        qt.ProgramSequence([spin, spin])
    with pytest.raises(ValueError, match=r"rate at the end of program 0, .* but starts with .*start_rate or end_rate"):
        qt.ProgramSequence([spin, qt.Spin([0, 0.1, 0], 10.0, spin.end)])
    with pytest.raises(ValueError, match="must be a program"):
        qt.ProgramSequence([spin, 3])
    for wrong in ([], spin, None):
        with pytest.raises(ValueError, match="non-empty sequence of programs"):
            qt.ProgramSequence(wrong)
