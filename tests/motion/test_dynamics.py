"""Torques on a body, and the forces that a vehicle needs to follow a path."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import qtraj as qt
from qtraj.motion import dynamics
from qtraj.motion.attitude import Attitude

EXACT = 1e-12
MASS, G = 1200.0, 9.80665
INERTIA = np.array([[3.0, 0.2, -0.1], [0.2, 2.0, 0.3], [-0.1, 0.3, 4.0]])


def attitude(rate, acceleration):
    return Attitude(jnp.asarray([1.0, 0, 0, 0]), jnp.asarray(rate), jnp.asarray(acceleration))


def test_a_spherical_body_needs_the_torque_along_the_acceleration():
    """Paper C, remark 2: ε_k = M_k/J."""
    at = attitude([0.3, -2.0, 1.0], [0.5, 0.1, -0.7])
    np.testing.assert_allclose(dynamics.torque(at, 2.5), 2.5 * np.array([0.5, 0.1, -0.7]), atol=EXACT)


def test_the_torque_is_the_rate_of_the_inertial_momentum():
    rng = np.random.default_rng(4)
    rate, acceleration = rng.normal(size=(2, 3))

    def momentum(s):
        """R(s) J ω(s) in the axes of s = 0."""
        moved = qt.rotation.from_rotation_vector(s * rate)
        return qt.quaternion.rotate(moved, INERTIA @ (rate + s * acceleration))

    _, change = jax.jvp(momentum, (jnp.asarray(0.0),), (jnp.asarray(1.0),))
    at = attitude(rate, acceleration)
    np.testing.assert_allclose(dynamics.torque(at, INERTIA), change, atol=EXACT)
    np.testing.assert_allclose(dynamics.acceleration(dynamics.torque(at, INERTIA), at.rate, INERTIA), acceleration)
    principal = np.array([3.0, 2.0, 4.0])
    np.testing.assert_allclose(dynamics.torque(at, principal), dynamics.torque(at, np.diag(principal)), rtol=EXACT)


def test_free_motion_keeps_momentum_and_energy():
    def flow(t, rate):
        return np.asarray(free(jnp.asarray(rate)))

    free = jax.jit(lambda rate: dynamics.acceleration(jnp.zeros(3), rate, INERTIA))
    end = solve_ivp(flow, (0, 5), [1.0, 0.2, -0.5], rtol=1e-10, atol=1e-10).y[:, -1]
    start = np.array([1.0, 0.2, -0.5])
    np.testing.assert_allclose(end @ INERTIA @ end, start @ INERTIA @ start, rtol=1e-7)
    np.testing.assert_allclose(np.linalg.norm(INERTIA @ end), np.linalg.norm(INERTIA @ start), rtol=1e-7)


def test_the_power_of_the_torque_is_the_rate_of_the_energy():
    rate, acceleration = np.array([0.3, -2.0, 1.0]), np.array([0.5, 0.1, -0.7])
    power = dynamics.rotational_power(attitude(rate, acceleration), INERTIA)
    np.testing.assert_allclose(power, rate @ INERTIA @ acceleration, rtol=EXACT)


@pytest.mark.parametrize(
    "inertia", [np.ones(2), -1.0, [1.0, 0.0, 1.0], np.array([[1.0, 0.5, 0], [0, 1, 0], [0, 0, 1]]), np.nan]
)
def test_invalid_inertias_are_refused(inertia):
    with pytest.raises(ValueError, match="inertia"):
        dynamics.torque(attitude([0.0, 0, 1], [0.0, 0, 0]), inertia)


@pytest.fixture(scope="module")
def circle():
    """A level turn to the left at constant speed: radius 50 m, 15 m/s."""
    return qt.SpiralHelix([50.0], [0.0, 0.3], [0.0], 5.0)


@pytest.fixture(scope="module")
def ramp():
    """A widening turn that climbs and slows down."""
    return qt.SpiralHelix([40.0, 1.0], [0.2, 0.3, -0.02], [0.0, 0.8, 0.1], 5.0)


def test_on_a_level_circle_the_side_force_is_centripetal_and_the_road_carries_the_weight(circle):
    centripetal = MASS * 15.0**2 / 50.0
    for gravity in (G, [0.0, 0.0, -G]):
        force = dynamics.forces(circle, 1.0, MASS, gravity)
        np.testing.assert_allclose(force, [0, centripetal, MASS * G], atol=1e-9)
    np.testing.assert_allclose(dynamics.power(circle, 1.0, MASS, G), 0, atol=1e-9)
    demand = dynamics.friction_demand(circle, 1.0, MASS, G)
    np.testing.assert_allclose([demand.side, demand.total], 15.0**2 / 50 / G, rtol=EXACT)


def test_a_road_banked_for_its_speed_needs_no_side_force(circle):
    """tan(bank) = v²/(R g), towards the centre: at t = 0 the centre lies along −x."""
    up = np.array([-(15.0**2) / 50.0, 0.0, G])
    demand = dynamics.friction_demand(circle, 0.0, MASS, G, qt.Upright(up))
    np.testing.assert_allclose([demand.side, demand.total], 0, atol=EXACT)


def test_forces_are_the_components_of_the_world_force(ramp):
    t, gravity = 1.7, np.array([0.3, -0.2, -9.5])
    world = MASS * (np.asarray(ramp.acceleration(t)) - gravity)
    for frame in (qt.Natural(), qt.Upright()):
        alpha = qt.trihedral(ramp, t, frame).dcm()
        np.testing.assert_allclose(dynamics.forces(ramp, t, MASS, gravity, frame), alpha @ world, rtol=EXACT)
    side = dynamics.forces(ramp, t, MASS, gravity, qt.Upright())
    demand = dynamics.friction_demand(ramp, t, MASS, gravity)
    np.testing.assert_allclose(demand.side, abs(side[1]) / side[2], rtol=EXACT)
    np.testing.assert_allclose(demand.total, np.hypot(side[0], side[1]) / side[2], rtol=EXACT)


def test_the_power_is_the_rate_of_kinetic_and_potential_energy(ramp):
    def energy(t):
        r = ramp.derivatives(t, 1)
        return MASS * (0.5 * r[1] @ r[1] + G * r[0, 2])

    _, change = jax.jvp(energy, (2.2,), (1.0,))
    power = dynamics.power(ramp, 2.2, MASS, G)
    np.testing.assert_allclose(power, change, rtol=EXACT)
    tangential = dynamics.forces(ramp, 2.2, MASS, G)[0]
    np.testing.assert_allclose(power, tangential * qt.trihedral(ramp, 2.2).speed, rtol=EXACT)


def test_a_vehicle_without_contact_has_infinite_demand_and_finite_derivatives():
    hop = qt.SpiralHelix([50.0], [0.0, 0.3], [0.0, 5.0, -6.0], 1.0)  # falls at 12 m/s², faster than g

    def side(g):
        return dynamics.friction_demand(hop, 0.5, MASS, g).side

    assert side(G) == np.inf
    assert np.isfinite(jax.grad(side)(G))
    assert np.isfinite(jax.grad(side)(20.0))


def test_the_demand_over_a_path_is_labelled_data(ramp):
    times = jnp.linspace(0.5, 4.5, 5)
    demand = jax.vmap(lambda t: dynamics.friction_demand(ramp, t, MASS, G))(times)
    dataset = demand.to_xarray()
    for name in ("side", "total"):
        assert dataset[name].dims == ("batch",)
        assert dataset[name].attrs["units"] == "1"
        assert dataset[name].dtype == np.float64
        np.testing.assert_array_equal(dataset[name], getattr(demand, name))
    assert repr(demand).startswith("FrictionDemand(batch of 5, side ")


def test_wrong_masses_and_gravities_are_refused(circle):
    with pytest.raises(ValueError, match="mass must be positive"):
        dynamics.forces(circle, 0.0, 0.0, G)
    with pytest.raises(ValueError, match="gravity"):
        dynamics.forces(circle, 0.0, MASS, [0.0, G])
    with pytest.raises(ValueError, match="gravity"):
        dynamics.power(circle, 0.0, MASS, np.inf)
