"""The coefficients of the limits on friction and power at single nodes, and their derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.design.timing import rounds, search
from qtraj.design.timing.constraints import listed
from qtraj.design.timing.grid import uniform
from qtraj.design.timing.road import coefficients
from qtraj.design.timing.tables import tables

CAR = qt.Vehicle(1500.0, friction=0.8, drag_area=0.7, rolling_resistance=0.012, bank=0.1)
BOUNDS = {"friction": jnp.asarray(1.0), "power": jnp.asarray(1e5)}


@jax.jit
def slopes_in_the_direction(direction):
    """The derivatives of a sum of all coefficients in reverse and in forward mode."""

    def total(direction):
        road = CAR.parameters(jnp.float64)
        one = jnp.ones(1)
        found = coefficients(direction[:, None], (one, one, one), one, 0.5, road, BOUNDS)
        return sum(jnp.sum(x) for x in found)

    return jax.grad(total)(direction), jax.jacfwd(total)(direction)


@pytest.mark.parametrize("ahead", [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (0.6, 0.0, 0.8)])
def test_derivatives_are_finite_in_a_vertical_direction(ahead):
    """The horizontal part √(x² + y²) of the direction is not differentiable where it is zero."""
    for slope in slopes_in_the_direction(jnp.array(ahead)):
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


HILL = qt.SpiralHelix([10.0, 10.0], [0.3], [0.0, 1.0, 0.1], 10.0)  # straight ahead, with a slope of 0.1 to 0.3
CELLS = 32
ROWS = listed(("speed", "friction"), vehicle=True)


def satisfied(path, a, **limits):
    """The timing u̇² = a after the last search, with a limit for a car whose tyres carry its weight up the hill.

    Returns the factor on a, the usage before and after with the speed as its square, and the error.
    """
    given = qt.Limits(**limits)
    bounds = {name: np.asarray(x) for name, x in given.given().items()}
    road = jax.tree.map(np.asarray, given.road(np.float64))
    problem = search.Problem(path, np.zeros(()), np.asarray(path.duration), bounds, np.full(2, np.inf), road)
    own = tables(uniform(CELLS), (False, False))
    program, places = search._imposed(problem, own)
    coefficients = np.full(CELLS + 3, a)
    usage = rounds.between_nodes(places, own.within, coefficients)
    nodes, ones = np.ones_like(program.largest), np.ones((program.constraints.per_node, CELLS))
    last = rounds.Result(coefficients, nodes, nodes, np.zeros(()), np.asarray(1e-9), ones, usage, np.zeros((), bool))
    powers, after, error = search._satisfied(last, coefficients, own, places, ROWS)
    after[ROWS.index("speed")] **= 2
    return float(powers[0, 0] / a), usage, after, float(error)


def vehicle(friction):
    return qt.Vehicle(1500.0, friction=friction, drag_area=0.7)


def test_a_violation_that_does_not_depend_on_the_speed_slows_nothing_down():
    """At the top of the hill the tyres carry tan θ = 0.3 of the load at every speed, but have 0.29."""
    factor, usage, after, _ = satisfied(HILL, 0.05, friction=1.0, speed=100.0, vehicle=vehicle(0.29))
    assert factor == 1.0
    assert jnp.max(usage[ROWS.index("friction")]) > 1.03
    np.testing.assert_allclose(after, usage, rtol=1e-15)


def test_a_violation_of_the_friction_is_removed_by_a_slower_timing():
    """Only the part of the friction that overcomes the drag decreases, so the factor is less than 1/usage."""
    factor, usage, after, error = satisfied(HILL, 1.0, friction=1.0, speed=100.0, vehicle=vehicle(0.3032))
    largest = float(jnp.max(usage[ROWS.index("friction")]))
    assert 1 + 1e-4 < largest < 1.01
    assert factor < 1 / largest
    assert float(jnp.max(after)) < 1 + rounds.ALLOWED
    assert error > 5e-5  # half of the fraction by which u̇² was reduced


def test_friction_does_not_hide_a_violation_of_another_limit():
    factor, usage, after, error = satisfied(HILL, 1.0, friction=1.0, speed=10.0, vehicle=vehicle(0.29))
    largest = float(jnp.max(usage[ROWS.index("speed")]))
    assert 1.03 < largest**0.5 < float(jnp.max(usage[ROWS.index("friction")]))
    np.testing.assert_allclose(float(jnp.max(after[ROWS.index("speed")])), 1.0, rtol=1e-9)
    np.testing.assert_allclose(factor, 1 / largest, rtol=1e-9)
    assert error > 1e-2


def test_a_hill_that_is_too_steep_for_the_tyres_is_reported():
    """At 5 m/s the momentum is not enough for the 50 m that are steeper than the tyres allow."""
    timed = qt.retime(HILL, qt.Limits(friction=1.0, speed=5.0, vehicle=vehicle(0.2)), knots=CELLS)
    assert not timed.converged
    assert timed.certificate.unmet == ["speed", "friction"]
    assert "too steep" in timed.result


def test_an_allowed_power_is_not_slowed_down():
    """The vehicle brakes uphill, so a slower timing needs more power."""
    path = qt.SpiralHelix(
        [158.79335026771994, -3.8055770043342525, 0.30513911640229435, -0.0051013976383950535],
        [0.0, 0.04995980379798592, 0.00022001746453334355, -3.2343619013662055e-06],
        [0.0, 0.2635514475016157, -0.006196227524822687, -4.334406668184203e-05],
        29.289869239160026,
    )
    friction = (0.667770463229527, 0.8801657043906912)
    truck = qt.Vehicle(
        18208.13245228006, drag_area=0.294, rolling_resistance=0.0011049365132776566, friction=friction, bank=-0.0815200
    )
    limits = qt.Limits(speed=12.913592046655996, friction=0.5220001008331523, power=5927.955765836861, vehicle=truck)
    timed = qt.retime(path, limits, knots=64)
    assert timed.successful
    assert timed.certificate.holds
