"""Torques of slews: Euler's equations, integrated independently, reproduce the slew; limits are satisfied."""

import dataclasses

import jax
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import qtraj as qt

TENSOR = np.array([[10.0, 1.0, 0.5], [1.0, 14.0, -2.0], [0.5, -2.0, 20.0]])
START = [0.9, 0.1, -0.3, 0.2]
VECTOR = np.array([0.9, 0.7, -1.1])
END = qt.quaternion.product(np.array(START), np.asarray(qt.rotation.from_rotation_vector(VECTOR)))
LAWS = {
    "time-optimal": qt.TimeOptimal(1.0, 0.5),
    "no coast": qt.TimeOptimal(None, 0.5),
    "s-curve": qt.SCurve(1.0, 0.5, 0.4),
    "cubic": qt.Cubic(max_rate=1.0),
    "quintic": qt.Quintic(max_rate=1.0, max_acceleration=0.5),
    "septic": qt.Septic(max_jerk=1.0),
}
INERTIAS = {"sphere": 12.0, "principal": [10.0, 14.0, 20.0], "tensor": TENSOR}
LIMITS = {"length": 2.0, "axes": [1.0, 2.0, 2.5]}
SLEW = qt.EulerTurn(START, END, qt.Quintic(duration=3.0))


def tensor(inertia):
    J = np.asarray(inertia, float)
    return J if J.ndim == 2 else np.diag(np.broadcast_to(J, 3))


def torques(program, inertia, times):
    """J ε + ω × J ω by NumPy."""
    at = jax.vmap(program)(times)
    J, rate = tensor(inertia), np.asarray(at.rate)
    return np.asarray(at.acceleration) @ J + np.cross(rate, rate @ J)


def dense(program):
    """Instants on both sides of every switch."""
    switches = np.asarray(program.switches)
    both = np.concatenate([switches, switches - 1e-9])
    return np.unique(np.concatenate([np.linspace(0, float(program.duration), 4001), both]))[:-1]


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("inertia", INERTIAS)
@pytest.mark.parametrize("limit", LIMITS)
def test_the_limit_is_satisfied_on_the_whole_slew_and_active(name, inertia, limit):
    plain = qt.EulerTurn(START, END, LAWS[name])
    slew = qt.within_torque(plain, INERTIAS[inertia], LIMITS[limit])
    torque, bound = torques(slew, INERTIAS[inertia], dense(slew)), np.asarray(LIMITS[limit])
    used = np.linalg.norm(torque, axis=1) / bound if bound.ndim == 0 else np.abs(torque) / bound
    assert used.max() <= 1 + 1e-11
    assert used.max() > 1 - 1e-5
    assert float(slew.duration) > float(plain.duration)
    peak = qt.peak_torque(slew, INERTIAS[inertia])
    assert peak.norm == pytest.approx(np.linalg.norm(torque, axis=1).max(), rel=1e-5)
    np.testing.assert_allclose(peak.axes, np.abs(torque).max(axis=0), rtol=1e-4, atol=1e-6)
    for k, t in enumerate(peak.axes_times):
        sides = np.abs(torques(slew, INERTIAS[inertia], np.array([t, max(t - 1e-9, 0.0)]))[:, k])
        assert sides.max() == pytest.approx(peak.axes[k], rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("name", ["time-optimal", "s-curve", "quintic"])
def test_a_body_under_these_torques_performs_the_slew(name):
    """SciPy integrates J ω' = M(t) − ω × Jω and the attitude: both end at the end of the slew, at rest."""
    slew = qt.within_torque(qt.EulerTurn(START, END, LAWS[name]), TENSOR, LIMITS["axes"])
    program, J = jax.jit(lambda t: slew(t)), TENSOR
    e = VECTOR / np.linalg.norm(VECTOR)

    def moment(t):
        at = program(t)
        acceleration, rate = np.asarray(at.acceleration) @ e, np.asarray(at.rate) @ e
        return acceleration * (J @ e) + rate**2 * np.cross(e, J @ e)

    def motion(t, state):
        q, w = state[:4], state[4:]
        derivative = 0.5 * np.asarray(
            [
                -q[1:] @ w,
                *(q[0] * w + np.cross(q[1:], w)),
            ]
        )
        return np.concatenate([derivative, np.linalg.solve(J, moment(t) - np.cross(w, J @ w))])

    state, before = np.concatenate([np.array(START) / np.linalg.norm(START), np.zeros(3)]), 0.0
    for switch in np.unique(np.asarray(slew.switches)):  # torques jump there
        # At its end the next piece would count.
        span = (before, switch * (1 - 1e-12))
        state = solve_ivp(motion, span, state, rtol=1e-11, atol=1e-12, method="DOP853").y[:, -1]
        before = switch
    expected = Rotation.from_quat(np.asarray(END), scalar_first=True)
    result = Rotation.from_quat(state[:4], scalar_first=True)
    assert (expected.inv() * result).magnitude() < 1e-8
    np.testing.assert_allclose(state[4:], 0.0, atol=1e-8)


@pytest.mark.parametrize("limit", LIMITS)
@pytest.mark.parametrize("rate", [0.3, 1.0, None])
def test_no_trapezoid_within_the_limits_is_shorter(limit, rate):
    """Compared with a fine grid of coasting rates and accelerations."""
    law = qt.TimeOptimal(rate, 0.3)
    slew = qt.within_torque(qt.EulerTurn(START, END, law), TENSOR, LIMITS[limit])
    angle = np.linalg.norm(VECTOR)
    e, bound = VECTOR / angle, np.asarray(LIMITS[limit])
    p, q = TENSOR @ e, np.cross(e, TENSOR @ e)
    V, A = np.meshgrid(np.linspace(0.005, min(rate or 2.0, 2.0), 1500), np.linspace(0.0005, 0.3, 1500))
    if bound.ndim == 0:
        satisfied = np.sqrt(A**2 * (p @ p) + V**4 * (q @ q)) <= bound
    else:
        satisfied = (A[..., None] * np.abs(p) + V[..., None] ** 2 * np.abs(q) <= bound).all(axis=-1)
    possible = satisfied & (A * angle >= V**2)
    best = (angle / V + V / A)[possible].min()
    assert best * (1 - 2e-3) < float(slew.duration) < best * (1 + 1e-9)


def test_a_slew_sequence_satisfies_the_limit_in_every_slew():
    attitudes = [START, END, [0.2, 0.9, 0.1, -0.3]]
    sequence = qt.within_torque(qt.SlewSequence(attitudes, LAWS["quintic"]), TENSOR, LIMITS["axes"])
    used = np.abs(torques(sequence, TENSOR, np.linspace(0, float(sequence.duration), 5001)[:-1])) / LIMITS["axes"]
    assert 0.999 < used.max() <= 1 + 1e-11
    peak = qt.peak_torque(sequence, TENSOR)
    assert (np.array(peak.axes) / LIMITS["axes"]).max() == pytest.approx(1.0, rel=1e-9)


def test_a_slew_that_satisfies_the_limit_is_unchanged():
    slew = qt.EulerTurn(START, END, LAWS["quintic"])
    assert qt.within_torque(slew, TENSOR, 100.0) is slew
    still = qt.EulerTurn(START, START, LAWS["time-optimal"])
    assert qt.peak_torque(still, TENSOR).norm == 0.0
    assert qt.within_torque(still, TENSOR, 1e-3) is still


def test_about_a_principal_axis_the_torque_is_along_it():
    slew = qt.EulerTurn([1, 0, 0, 0], qt.rotation.from_rotation_vector(np.array([0, 0, 1.0])), LAWS["time-optimal"])
    limited = qt.within_torque(slew, [10.0, 14.0, 20.0], [1e-9, 1e-9, 2.0])
    assert float(limited.law.max_acceleration) == pytest.approx(0.1)
    assert float(limited.duration) == pytest.approx(2 * (1.0 / 0.1) ** 0.5)


@pytest.mark.parametrize(
    ("law", "inertia", "limit", "message"),
    [
        (
            qt.Quintic(duration=1.0),
            TENSOR,
            2.0,
            "cannot satisfy the limit .* Increase the duration to at least",
        ),
        (qt.TimeOptimal(1.0, 0.5, end_rate=0.1), TENSOR, 2.0, "because the profile has end_rate"),
        (LAWS["quintic"], TENSOR, [1.0, 0.0, 1.0], "must be a positive number, or three positive numbers"),
        (LAWS["quintic"], -1.0, 2.0, "positive principal moments"),
    ],
)
def test_impossible_limits_are_refused(law, inertia, limit, message):
    with pytest.raises(ValueError, match=message):
        qt.within_torque(qt.EulerTurn(START, END, law), inertia, limit)


FIVE_DEGREES, DEGREE = [np.cos(np.pi / 72), 0.0, 0.0, np.sin(np.pi / 72)], np.pi / 180


def test_in_a_fixed_time_the_acceleration_is_reduced():
    """A slew about a principal axis that coasts: the torque is J·acceleration."""
    slew = qt.EulerTurn([1, 0, 0, 0], FIVE_DEGREES, qt.TimeOptimal(None, DEGREE, duration=600.0))
    limited = qt.within_torque(slew, [5.0, 4.0, 3.0], 0.01)
    assert float(limited.law.max_acceleration) == pytest.approx(0.01 / 3, rel=1e-8)
    assert float(limited.duration) == 600.0
    assert qt.peak_torque(limited, [5.0, 4.0, 3.0]).norm <= 0.01


@pytest.mark.parametrize("law", [qt.TimeOptimal(0.2, 0.2, duration=30.0), qt.SCurve(0.2, 0.2, 0.2, duration=30.0)])
@pytest.mark.parametrize("limit", [0.6, [0.35, 0.5, 0.5]])
def test_the_reduced_acceleration_is_the_largest(law, limit):
    slew = qt.EulerTurn(START, END, law)
    for program in (slew, qt.SlewSequence([START, END, START], law)):
        limited = qt.within_torque(program, TENSOR, limit)
        assert float(limited.duration) == float(program.duration)
        assert limited.law.max_acceleration < 0.99 * law.max_acceleration
        below = qt.peak_torque(limited, TENSOR)
        more = dataclasses.replace(limited.law, max_acceleration=limited.law.max_acceleration * (1 + 1e-6))
        above = qt.peak_torque(dataclasses.replace(program, law=more), TENSOR)
        used = [(peak.norm if np.ndim(limit) == 0 else np.array(peak.axes)) / limit for peak in (below, above)]
        assert np.max(used[0]) <= 1 < np.max(used[1])


@pytest.mark.parametrize("law", [qt.TimeOptimal(0.5, 0.5, duration=8.0), qt.SCurve(0.5, 0.5, 0.5, duration=9.0)])
def test_the_recommended_duration_suffices(law):
    slew = qt.EulerTurn(START, END, law)
    with pytest.raises(ValueError, match="Increase the duration to at least") as error:
        qt.within_torque(slew, TENSOR, 0.2)
    duration = float(str(error.value).split("at least ")[1].removesuffix(" s."))
    for factor, enough in ((1 + 1e-8, True), (0.98, False)):
        longer = qt.EulerTurn(START, END, dataclasses.replace(law, duration=duration * factor))
        if enough:
            assert qt.peak_torque(qt.within_torque(longer, TENSOR, 0.2), TENSOR).norm <= 0.2
        elif isinstance(law, qt.TimeOptimal):  # whose slew of minimum duration is exact
            with pytest.raises(ValueError, match="Increase the duration"):
                qt.within_torque(longer, TENSOR, 0.2)


def test_other_programs_are_refused():
    with pytest.raises(ValueError, match="an EulerTurn or a SlewSequence was expected"):
        qt.peak_torque(qt.FrameProgram(qt.SpiralHelix([10.0], [0.0, 0.4], [0.0], 5.0)), 1.0)


@pytest.mark.parametrize("transform", [jax.jit, jax.grad], ids=["jit", "grad"])
@pytest.mark.parametrize(
    "call",
    [
        lambda x: qt.peak_torque(SLEW, x).norm,
        lambda x: qt.within_torque(SLEW, x, 2.0).duration,
        lambda x: qt.within_torque(SLEW, 9.0, x).duration,
        lambda x: qt.judge_slew(SLEW, inertia=x).peaks[0],
        lambda x: qt.slew_history(SLEW, [0.0, x], 9.0).torque[0, 0],
        lambda x: qt.peak_torque(qt.EulerTurn(START, END, qt.Cubic(duration=x)), 9.0).norm,
        lambda x: qt.slew_history(qt.EulerTurn(START, END, qt.Cubic(duration=x)), [0.0, 1.0], 9.0).angle[0],
    ],
)
def test_traced_arguments_are_refused_with_advice(transform, call):
    with pytest.raises(ValueError, match="needs concrete values, but traced values were given: call it outside jit"):
        transform(call)(2.0)


def test_the_history_inside_jit_is_refused_and_its_torque_may_be_differentiated():
    times = np.array([0.1, 0.7])
    with pytest.raises(ValueError, match="slew_history needs concrete values"):
        jax.jit(lambda J: qt.slew_history(SLEW, times, J).torque)(9.0)
    slope = jax.jacfwd(lambda J: qt.slew_history(SLEW, times, J).torque)(9.0)  # the torque is linear in the inertia
    np.testing.assert_allclose(slope, np.asarray(qt.slew_history(SLEW, times, 9.0).torque) / 9.0, rtol=1e-12)
