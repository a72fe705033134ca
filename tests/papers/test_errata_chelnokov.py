"""The errata of Chelnokov (1993): each printed formula fails here, and the corrected one holds.

The table is docs/errata.md.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.algebra import polynomial

ROUND_OFF = 1e-12
WRONG = 1e-2  # a printed formula is wrong where it misses by more than this, relatively

INSTANT = jnp.asarray(0.7)
GROWTH = 0.3  # |λ| = exp(0.3 t²)
AXIS = np.array([2.0, -1.0, 2.0]) / 3
START = qt.quaternion.exp(jnp.array([0.3, -0.8, 0.5]))


def miss(actual, expected):
    """The largest deviation, relative to the largest expected component."""
    expected = np.asarray(expected)
    return np.max(np.abs(np.asarray(actual) - expected)) / np.max(np.abs(expected))


def turn(angle):
    """The quaternion of a turn by `angle` about AXIS."""
    return qt.quaternion.exp(jnp.asarray(angle * AXIS / 2))


# Unnormalised kinematics


def attitude(t):
    """An attitude that turns and grows."""
    steady, accelerated = jnp.array([0.4, -0.2, 0.7]), jnp.array([-0.1, 0.5, 0.2])
    unit = qt.quaternion.product(qt.quaternion.exp(t * steady), qt.quaternion.exp(t**2 * accelerated))
    return jnp.exp(GROWTH * t**2) * unit


def derivative(f, t):
    return jax.jvp(f, (t,), (jnp.ones_like(t),))[1]


def body_rate(t):
    """ω_x = 2λ⁻¹∘λ̇, four components."""
    q = attitude(t)
    return 2 * qt.quaternion.product(qt.quaternion.inverse(q), derivative(attitude, t))


def inertial_rate(t):
    """ω_ξ = 2λ̇∘λ⁻¹, four components."""
    q = attitude(t)
    return 2 * qt.quaternion.product(derivative(attitude, t), qt.quaternion.inverse(q))


@pytest.fixture(scope="module")
def motion():
    """λ, λ̇, ω_x, ε_x, ω_ξ, ε_ξ at one instant."""

    @jax.jit
    def everything(t):
        return (
            attitude(t),
            derivative(attitude, t),
            body_rate(t),
            derivative(body_rate, t),
            inertial_rate(t),
            derivative(inertial_rate, t),
        )

    return everything(INSTANT)


def test_sign_of_the_scalar_rate(motion):
    _, _, omega, epsilon, _, _ = motion
    logarithm = derivative(lambda t: jnp.log(qt.quaternion.norm_squared(attitude(t))), INSTANT)
    assert miss(-logarithm, omega[0]) > WRONG
    assert miss(-logarithm, epsilon[0]) > WRONG  # the print also has a dot on ω0
    assert miss(logarithm, omega[0]) < ROUND_OFF
    assert miss(4 * GROWTH * INSTANT, omega[0]) < ROUND_OFF


def test_norm_relation_is_one_of_moduli(motion):
    """'2λ˙ = ω0 λ' is true of |λ|; of the quaternion it would mean a body that does not turn."""
    q, rate, omega, _, _, _ = motion
    modulus = derivative(lambda t: jnp.sqrt(qt.quaternion.norm_squared(attitude(t))), INSTANT)
    assert miss(omega[0] * q, 2 * rate) > WRONG
    assert miss(omega[0] * jnp.sqrt(q @ q), 2 * modulus) < ROUND_OFF
    assert miss(omega[0] * (q @ q), derivative(lambda t: attitude(t) @ attitude(t), INSTANT)) < ROUND_OFF


def test_scalar_equations_hold_as_printed(motion):
    """(1.3), line by line: nothing to correct."""
    q, rate, omega, _, _, _ = (np.asarray(x) for x in motion)
    (l0, l1, l2, l3), (w0, w1, w2, w3) = q, omega
    printed = [
        w0 * l0 - w1 * l1 - w2 * l2 - w3 * l3,
        w1 * l0 + w0 * l1 + w3 * l2 - w2 * l3,
        w2 * l0 - w3 * l1 + w0 * l2 + w1 * l3,
        w3 * l0 + w2 * l1 - w1 * l2 + w0 * l3,
    ]
    assert miss(printed, 2 * rate) < ROUND_OFF
    assert miss(2 * qt.quaternion.derivative(motion[0], motion[2]), printed) < ROUND_OFF


def test_changes_of_axes_need_the_inverse(motion):
    """The relations after (1.4) hold as printed, with λ⁻¹; the conjugate of (1.6) serves unit quaternions only."""
    q, _, omega, epsilon, omega_xi, epsilon_xi = motion
    inverse, conjugate = qt.quaternion.inverse(q), qt.quaternion.conjugate(q)
    for body, inertial in [(omega, omega_xi), (epsilon, epsilon_xi)]:
        turned = qt.quaternion.product(q, body)
        assert miss(qt.quaternion.product(turned, conjugate), inertial) > WRONG
        assert miss(qt.quaternion.product(turned, inverse), inertial) < ROUND_OFF


def test_free_scalar_acceleration_may_depend_on_all_of_the_rate(motion):
    """ε0(t, λ, λ̇) is printed as ε0(t, λ, ω0): one ω0 belongs to many λ̇, one ω to exactly one."""
    q, rate, omega, _, _, _ = motion
    other = omega.at[1:].multiply(-1.0)
    assert miss(qt.quaternion.derivative(q, other), rate) > WRONG
    recovered = 2 * qt.quaternion.product(qt.quaternion.inverse(q), rate)
    assert miss(recovered, omega) < ROUND_OFF


def test_inertial_command_is_the_vector_part(motion):
    """(2.2) equates all of ε_ξ with a sum over i_1 … i_3, which has no scalar part."""
    _, _, _, epsilon, _, epsilon_xi = motion
    printed = epsilon_xi.at[0].set(0.0)
    assert miss(printed[0], epsilon_xi[0]) > WRONG
    assert miss(epsilon[0], epsilon_xi[0]) < ROUND_OFF
    assert miss(printed[1:], epsilon_xi[1:]) < ROUND_OFF


# The plane Euler turn


def test_start_of_the_program_must_be_normalised():
    """λ0⁰ = λ(t0) is printed, but λ(t0) has any norm and the program the norm 1: cos(Φ/2) = a0 then fails."""
    angle = 1.2
    measured = 2.5 * START
    end = qt.quaternion.product(START, turn(angle))
    printed = qt.quaternion.product(qt.quaternion.conjugate(measured), end)
    start = measured / jnp.sqrt(qt.quaternion.norm_squared(measured))
    corrected = qt.quaternion.product(qt.quaternion.conjugate(start), end)
    assert printed[0] > 1  # no angle has this cosine
    assert miss(corrected[0], np.cos(angle / 2)) < ROUND_OFF


@pytest.mark.parametrize("angle", [1e-7, 1e-9])
def test_arccosine_loses_small_turns(angle):
    relative = qt.quaternion.product(qt.quaternion.conjugate(START), qt.quaternion.product(START, turn(angle)))
    with np.errstate(invalid="ignore"):
        printed = 2 * np.arccos(float(relative[0]))  # NaN where rounding puts a0 above 1
    corrected = np.linalg.norm(qt.rotation.to_rotation_vector(relative))
    assert not abs(printed - angle) < 1e-10
    assert abs(corrected - angle) < 1e-15


def test_no_turn_has_no_printed_axis():
    """(3.9), (3.10) are 0/0 for equal attitudes; the rotation vector and its derivative stay finite."""
    relative = turn(0.0)
    with np.errstate(invalid="ignore"):
        printed = np.asarray(relative[1:]) / np.sin(np.arccos(float(relative[0])))
    assert np.all(np.isnan(printed))
    assert not np.any(qt.rotation.to_rotation_vector(relative))
    slope = jax.jacfwd(qt.rotation.to_rotation_vector)(relative)
    assert miss(slope[:, 1:], 2 * np.eye(3)) < ROUND_OFF


def test_sine_of_the_half_angle():
    """(sin Φ/2)⁻¹ in (3.9), (3.10): the sine of the half angle, as (3.8) has it, not half the sine."""
    angle = 1.2
    vector = np.asarray(turn(angle)[1:])
    assert miss(vector / (np.sin(angle) / 2), AXIS) > WRONG
    assert miss(vector / np.sin(angle / 2), AXIS) < ROUND_OFF


LONG = np.deg2rad(250.0)  # a0 < 0: the other way round is shorter


def test_angles_up_to_two_pi_are_not_the_shortest_turn():
    """(3.7)–(3.10) with Φ in [0, 2π] give the long way; the paper's own last rule brings Φ into [0, π]."""
    printed = 2 * np.arccos(float(turn(LONG)[0]))
    shortest = qt.rotation.to_rotation_vector(turn(LONG))
    assert miss(printed, LONG) < ROUND_OFF
    assert miss(printed, np.linalg.norm(shortest)) > WRONG
    assert miss(2 * np.pi - printed, np.linalg.norm(shortest)) < ROUND_OFF
    assert miss(-(2 * np.pi - printed) * AXIS, shortest) < ROUND_OFF


def test_shortest_turn_ends_at_the_other_sign():
    """With Φ = 2π − 2α the program ends at −λ*, and a0 = −cos(Φ/2): λ⁰(t*) = λ* and (3.8) hold up to sign only."""
    end = qt.quaternion.product(START, turn(LONG))
    relative = qt.quaternion.product(qt.quaternion.conjugate(START), end)
    alpha = np.arccos(float(relative[0]))
    angle, axis = 2 * np.pi - 2 * alpha, -np.asarray(relative[1:]) / np.sin(alpha)
    final = qt.quaternion.product(START, qt.quaternion.exp(jnp.asarray(angle * axis / 2)))
    assert miss(np.cos(angle / 2), relative[0]) > WRONG
    assert miss(np.cos(angle / 2), abs(relative[0])) < ROUND_OFF
    assert miss(final, end) > WRONG
    assert miss(final, -end) < ROUND_OFF
    assert miss(qt.rotation.to_dcm(final), qt.rotation.to_dcm(end)) < ROUND_OFF


def test_half_turn_has_two_axes():
    """At a0 = 0 the rule takes the axis from the sign of λ*, which is no property of the attitude."""
    end = jnp.concatenate([jnp.zeros(1), AXIS])
    printed = [np.asarray(q[1:]) / np.sin(np.arccos(float(q[0]))) for q in (end, -end)]
    assert miss(printed[0], printed[1]) > WRONG
    chosen = [qt.rotation.to_rotation_vector(q) for q in (end, -end)]
    assert miss(chosen[0], chosen[1]) < ROUND_OFF
    assert miss(chosen[0], np.pi * AXIS) < ROUND_OFF


def test_cubic_of_given_duration_cannot_also_meet_limits():
    """A rest-to-rest cubic has no coefficient left: its peaks are 1.5Φ/T and 6Φ/T², so T must be long enough."""
    angle, rate, acceleration = np.deg2rad([90.0, 1.0, 0.05])
    rest = jnp.zeros(2)

    def peaks(duration):
        cubic = polynomial.hermite(rest, jnp.array([angle, 0.0]), duration)
        times = np.linspace(0.0, duration, 201)
        slope = np.polynomial.Polynomial(np.asarray(cubic)).deriv()
        return np.array([np.max(np.abs(slope(times))), np.max(np.abs(slope.deriv()(times)))])

    given = peaks(60.0)
    least = max(1.5 * angle / rate, np.sqrt(6 * angle / acceleration))
    assert np.all(given > np.array([rate, acceleration]) * (1 + WRONG))
    assert miss(given, [1.5 * angle / 60, 6 * angle / 60**2]) < ROUND_OFF
    assert np.all(peaks(least) <= np.array([rate, acceleration]) * (1 + ROUND_OFF))
