"""A Monte-Carlo study: distribution, worst flights and their causes, repetition of one flight, refusals."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])
TIMES = np.linspace(0.0, 12.0, 13)
PROGRAM = qt.EulerTurn(IDENTITY, [1.0, 0.2, 0.0, 0.1], qt.Quintic(duration=4.0))
LAW = qt.AccelerationLaw(2.0, 1.0)


def flight(torque, tilt):
    start = qt.rotation.from_rotation_vector(tilt)
    return qt.simulate(PROGRAM, LAW, start, jnp.zeros(4), TIMES, qt.DisturbanceAcceleration(torque), rtol=1e-6)


@pytest.fixture(scope="module")
def study():
    return qt.monte_carlo(flight, {"torque": 0.02 * np.ones(3), "tilt": [0.2, 0.2, 0.0]}, 48, key=3, block=32)


def test_the_last_error_is_the_steady_state_error_of_the_disturbance(study):
    """|2μ_v| tends to |d|/k₂, so only the torque matters."""
    size = np.linalg.norm(study.draws["torque"], axis=1)
    np.testing.assert_allclose(study.metric, size, rtol=0.05)
    influence = study.influence
    assert influence["torque"] > 0.99
    assert abs(influence["tilt"]) < 0.4
    worst = study.worst(3)
    assert [w.seed for w in worst] == np.argsort(-size)[:3].tolist()
    assert all(w.cause == "torque" and w.rank > 0.9 for w in worst)


def test_percentiles_settling_times_and_dataset(study):
    np.testing.assert_allclose(study.percentiles(100)[0], np.max(study.angle, axis=0))
    np.testing.assert_allclose(study.percentiles([50])[0], np.median(study.angle, axis=0))
    settles = np.asarray(study.angle)[:, -1] <= np.radians(1.0)
    np.testing.assert_array_equal(np.isfinite(study.settling_time), settles)
    data = study.to_xarray()
    assert data.sizes["seed"] == 48
    assert data["angle_percentiles"].dims == ("percent", "time")
    assert list(data["influence"]["spread"].values) == ["torque", "tilt"]
    assert "48 flights: 48 reached every instant" in repr(study)


def test_a_flight_is_repeated_and_does_not_depend_on_the_number(study):
    alone = flight(**study.draw(7))
    np.testing.assert_allclose(alone.angle, study.angle[7], atol=1e-6)
    fewer = qt.monte_carlo(flight, {"torque": 0.02 * np.ones(3), "tilt": [0.2, 0.2, 0.0]}, 8, key=jax.random.key(3))
    np.testing.assert_array_equal(fewer.draws["torque"], study.draws["torque"][:8])
    with pytest.raises(IndexError, match="0 to 7, but 8"):
        fewer.draw(8)


def test_refusals():
    with pytest.raises(TypeError, match="must have the arguments wind, one for each spread"):
        qt.monte_carlo(flight, {"wind": 1.0}, 4)
    with pytest.raises(ValueError, match="the spread 'tilt' must be a standard deviation"):
        qt.monte_carlo(flight, {"torque": 1.0, "tilt": -1.0}, 4)
    with pytest.raises(ValueError, match="n must be a positive integer, but 0"):
        qt.monte_carlo(flight, {"torque": 1.0, "tilt": 1.0}, 0)
    with pytest.raises(TypeError, match="must return the Solution of simulate"):
        qt.monte_carlo(lambda x: x, {"x": 1.0}, 2)
