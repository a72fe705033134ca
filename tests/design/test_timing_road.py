"""The coefficients of the limits on friction and power at single nodes, and their derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.design.timing.road import coefficients

CAR = qt.Vehicle(1500.0, friction=0.8, drag_area=0.7, rolling_resistance=0.012, bank=0.1)
BOUNDS = {"friction": jnp.asarray(1.0), "power": jnp.asarray(1e5)}


@pytest.mark.parametrize("ahead", [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (0.6, 0.0, 0.8)])
def test_derivatives_are_finite_in_a_vertical_direction(ahead):
    """The horizontal part √(x² + y²) of the direction is not differentiable where it is zero."""

    def total(direction):
        road = CAR.parameters(jnp.float64)
        one = jnp.ones(1)
        found = coefficients(direction[:, None], (one, one, one), one, 0.5, road, BOUNDS)
        return sum(jnp.sum(x) for x in found)

    for slope in (jax.grad(total)(jnp.array(ahead)), jax.jacfwd(total)(jnp.array(ahead))):
        assert np.isfinite(slope).all()


def test_the_duration_of_a_vertical_climb_has_derivatives():
    """At constant power against gravity alone, the vehicle climbs with v = P/mg, and the duration is m g h/P."""

    def duration(height, power):
        path = qt.SpiralHelix([10.0], [0.3], jnp.stack([0.0 * height, height / 20]), 20.0)
        vehicle = qt.Vehicle(1500.0, drag_area=0.7)
        limits = qt.Limits(speed=power / (1500.0 * 9.80665), power=2e5, vehicle=vehicle)
        return qt.retime(path, limits, knots=64).duration

    by_height, by_power = jax.grad(duration, (0, 1))(60.0, 1e5)
    expected = 1500.0 * 9.80665 / 1e5
    np.testing.assert_allclose(float(by_height), expected, rtol=1e-4)
    np.testing.assert_allclose(float(by_power), -60.0 * expected / 1e5, rtol=1e-4)
