"""Torques that depend on the state: closed forms of free bodies, derivatives, batches and refusals."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


def test_the_libration_in_pitch_has_the_frequency_of_a_gravity_gradient():
    """A small pitch angle in a circular orbit oscillates with √(3n²(I_x − I_z)/I_y) (Wie, section 6.10)."""
    inertia, orbit, small = np.array([12.0, 10.0, 5.0]), qt.torques.CircularOrbit(7e6), 1e-5
    n = float(orbit.rate)
    ahead = qt.rotation.from_dcm(np.array([[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]]))  # x ahead, y along −normal, z down
    tilted = qt.quaternion.product(ahead, qt.rotation.from_rotation_vector([0.0, small, 0.0]))
    frequency = np.sqrt(3 * n**2 * (inertia[0] - inertia[2]) / inertia[1])
    times = np.linspace(0.0, 3 * 2 * np.pi / frequency, 13)
    body = qt.RigidBody(inertia, torque=qt.torques.GravityGradient(inertia, orbit))
    motion = qt.integrate(body.free, tilted, [0.0, 0.0, -n, 0.0], times, rtol=1e-11, atol=1e-13)
    turned = qt.rotation.from_rotation_vector(np.stack([0 * times, 0 * times, n * times], -1))
    local = qt.quaternion.product(ahead, IDENTITY)
    errors = [
        qt.rotation.to_rotation_vector(
            qt.quaternion.product(qt.quaternion.conjugate(qt.quaternion.product(turn, local)), q)
        )[1]
        for turn, q in zip(turned, np.asarray(motion.quaternion), strict=True)
    ]
    np.testing.assert_allclose(errors, small * np.cos(frequency * times), atol=1e-6 * small)


def test_a_free_axisymmetric_body_precesses():
    """ω_1 + iω_2 rotates with the rate (I_z/I_x − 1)ω_3 about the axis of symmetry."""
    transverse, axial, rate = 4.0, 6.0, np.array([0.3, 0.0, 2.0])
    times = np.linspace(0.0, 20.0, 41)
    body = qt.RigidBody([transverse, transverse, axial])
    motion = qt.integrate(body.free, IDENTITY, [0.0, *rate], times)
    angle = (axial / transverse - 1) * rate[2] * times
    expected = np.stack([rate[0] * np.cos(angle), rate[0] * np.sin(angle), np.full_like(times, rate[2])], -1)
    np.testing.assert_allclose(motion.rate[:, 1:], expected, atol=1e-9)
    momentum = jax.vmap(qt.quaternion.rotate)(
        np.asarray(motion.quaternion), np.asarray(motion.rate)[:, 1:] * [4.0, 4.0, 6.0]
    )
    np.testing.assert_allclose(momentum, np.broadcast_to(momentum[0], (41, 3)), atol=1e-8)


def test_a_constant_torque_about_a_principal_axis():
    body = qt.RigidBody([2.0, 3.0, 4.0], torque=[0.0, 0.0, 0.2])
    times = np.linspace(0.0, 8.0, 5)
    motion = qt.integrate(body.free, IDENTITY, [0.0, 0.0, 0.0, 0.1], times)
    np.testing.assert_allclose(motion.rate[:, 3], 0.1 + 0.05 * times, rtol=1e-10)
    angle = 0.1 * times + 0.025 * times**2
    np.testing.assert_allclose(motion.quaternion[:, 0], np.cos(angle / 2), atol=1e-9)


def test_a_damping_disturbance_decays_like_the_exponential():
    """Without restoring acceleration the law only feeds forward, so ω̇ = −cω."""
    program, law = qt.EulerTurn(IDENTITY, IDENTITY, qt.Cubic(duration=5.0)), qt.AccelerationLaw(0.0, 0.0, "additive")
    times = np.linspace(0.0, 2.0, 5)
    free = qt.simulate(program, law, IDENTITY, [0.0, 0.0, 0.0, 0.1], times)
    damped = qt.simulate(program, law, IDENTITY, [0.0, 0.0, 0.0, 0.1], times, lambda t, q, w: -0.7 * w)
    feed = np.asarray(free.rate)
    assert np.all(np.abs(damped.rate[1:, 3]) < np.abs(feed[1:, 3]))

    class Zero(qt.control.AbstractLaw):
        def __call__(self, reference, quaternion, rate):
            return jnp.zeros(3)

    exact = qt.simulate(program, Zero(), IDENTITY, [0.0, 0.1, 0.2, 0.3], times, lambda t, q, w: -0.7 * w)
    np.testing.assert_allclose(exact.rate[:, 1:], np.outer(np.exp(-0.7 * times), [0.1, 0.2, 0.3]), rtol=1e-9)


def test_a_state_torque_acts_alike_as_acceleration_torque_and_on_the_body():
    program, law = qt.EulerTurn(IDENTITY, [1.0, 0.2, 0, 0.1], qt.Quintic(duration=4.0)), qt.AccelerationLaw(2.0, 1.0)
    inertia, times = np.array([1.0, 2.0, 3.0]), np.linspace(0.0, 4.0, 5)
    dipole = qt.torques.MagneticDipole([0.1, 0.0, 0.3], [0.2, 0.3, -0.1])
    start = (IDENTITY, [0.0, 0.1, 0.0, 0.0], times)
    one = qt.simulate(program, law, *start, qt.DisturbanceTorque(dipole, inertia))
    two = qt.simulate(program, law, *start, body=qt.RigidBody(inertia, torque=dipole))
    three = qt.simulate(program, law, *start, lambda t, q, w: dipole(t, q, w) / inertia)
    for other in (two, three):
        np.testing.assert_allclose(one.quaternion, other.quaternion, atol=1e-9)
    alone = qt.open_loop(program, times, disturbance=qt.DisturbanceTorque(dipole, inertia))
    world = qt.open_loop(program, times, axes="inertial", disturbance=lambda t, q, w: 0 * w)
    assert np.max(alone.angle) > 1e-2
    assert np.max(world.angle) < 1e-8


def test_formulas_of_the_torques():
    q = qt.rotation.from_rotation_vector([0.3, -0.2, 0.5])
    dcm = np.asarray(qt.rotation.to_dcm(q))
    t, rest = jnp.asarray(0.0), jnp.zeros(3)
    r, inertia = np.array([4e6, -5e6, 3e6]), np.diag([3.0, 4.0, 6.0]) + 0.1
    body = dcm @ r
    expected = 3 * 3.986004418e14 / np.linalg.norm(r) ** 5 * np.cross(body, inertia @ body)
    for scale in (1.0, -3.0):
        torque = qt.torques.GravityGradient(inertia, r)(t, scale * jnp.asarray(q), rest)
        np.testing.assert_allclose(torque, expected, rtol=1e-10)
    v, s = np.array([100.0, 7000.0, -50.0]), np.array([0.1, 0.2, -0.3])
    drag = -0.5 * 1e-11 * 2.2 * 1.5 * np.linalg.norm(v) * v
    air = qt.torques.AerodynamicTorque(s, 1.5, 1e-11, v)(t, jnp.asarray(q), rest)
    np.testing.assert_allclose(air, np.cross(s, dcm @ drag), rtol=1e-10)
    orbit = qt.torques.CircularOrbit(7e6, start=[0.0, 2.0, 0.0], normal=[1.0, 0.5, 0.0])
    np.testing.assert_allclose(orbit(t), [0.0, 7e6, 0.0], atol=1e-6)
    np.testing.assert_allclose(orbit.velocity(t), jax.jacfwd(orbit)(t), rtol=1e-12, atol=1e-6)
    np.testing.assert_allclose(orbit.velocity(t)[2], np.sqrt(3.986004418e14 / 7e6), rtol=1e-12)


def test_derivatives_in_the_parameters_of_an_own_torque_and_in_the_assumed_inertia():
    program, law = qt.EulerTurn(IDENTITY, [1.0, 0.2, 0, 0.1], qt.Quintic(duration=2.0)), qt.AccelerationLaw(2.0, 1.0)

    def end(stiffness, scale):
        def spring(t, quaternion, rate):
            return -stiffness * qt.quaternion.rotate(qt.quaternion.conjugate(quaternion), jnp.array([0.0, 1.0, 0.0]))

        body = qt.RigidBody([1.0, 2.0, 3.0], scale * jnp.array([1.2, 1.7, 2.9]), torque=spring)
        motion = qt.simulate(program, law, IDENTITY, np.zeros(4), jnp.array([0.0, 1.0]), body=body, rtol=1e-8)
        return motion.quaternion[-1, 1]

    step, compiled = 1e-4, jax.jit(jax.value_and_grad(end, (0, 1)))
    for at in (np.array([0.1, 1.0]), np.array([0.3, 0.9])):
        slopes = compiled(*at)[1]
        for slope, change in zip(slopes, step * np.eye(2), strict=True):
            difference = (compiled(*(at + change))[0] - compiled(*(at - change))[0]) / (2 * step)
            assert abs(difference) > 1e-3
            np.testing.assert_allclose(slope, difference, atol=1e-8)


def test_invalid_torques_are_refused():
    with pytest.raises(ValueError, match="inertia"):
        qt.torques.GravityGradient([1.0, -1.0, 1.0], [7e6, 0, 0])
    with pytest.raises(ValueError, match="normal must not be zero or along start"):
        qt.torques.CircularOrbit(7e6, normal=[2.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="the area must be positive"):
        qt.torques.AerodynamicTorque([0.1, 0, 0], 0.0, 1e-11, [1.0, 0, 0])
    with pytest.raises(ValueError, match="the position must be a function t"):
        qt.torques.GravityGradient(1.0, lambda t, q, w: jnp.zeros(3))
    with pytest.raises(ValueError, match="depends on the state"):
        qt.DisturbanceAcceleration(lambda t, q, w: w).acceleration(0.0)


def test_torques_are_saved_and_loaded(tmp_path):
    torque = qt.torques.GravityGradient([1.0, 2.0, 3.0], qt.torques.CircularOrbit(7e6))
    body = qt.RigidBody([1.0, 2.0, 3.0], torque=torque)
    qt.foundation.document.save(body, tmp_path / "body.toml")
    loaded = qt.load(tmp_path / "body.toml").torque
    t, q, w = jnp.asarray(100.0), jnp.array([1.0, 0.2, 0.3, 0.4]), jnp.zeros(3)
    np.testing.assert_array_equal(loaded(t, q, w), torque(t, q, w))


def test_torques_accept_lists_and_integers():
    """A torque alone, as a user tries it: the value of floats."""
    orbit, whole, floats = qt.torques.CircularOrbit(7e6), [1, 0, 1, 0], np.array([1.0, 0.0, 1.0, 0.0])
    for torque in (
        qt.torques.GravityGradient([10, 12, 5], orbit),
        qt.torques.MagneticDipole([0, 0, 2], [3e-5, 0, 0]),
        qt.torques.AerodynamicTorque([1, 0, 0], 1, 1e-11, orbit.velocity),
    ):
        right = torque(1.0, floats, np.zeros(3))
        for given in (whole, np.array(whole), jnp.asarray(whole)):
            np.testing.assert_allclose(torque(1, given, [0, 0, 0]), right, rtol=1e-14)


def test_orbits_and_positions_that_define_no_torque_are_refused():
    with pytest.raises(ValueError, match="normal must not be zero or along start"):
        qt.torques.CircularOrbit(7e6, [0.1, 0.2, 0.3], [0.2, 0.4, 0.6])  # parallel, with a cross product of round-off
    with pytest.raises(ValueError, match="the position must not be zero"):
        qt.torques.GravityGradient([10.0, 12.0, 5.0], np.zeros(3))
    with pytest.raises(ValueError, match="one instant t was expected"):
        qt.torques.CircularOrbit(7e6)([0.0, 1.0])
