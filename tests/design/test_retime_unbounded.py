"""Problems of `retime` in which no limit bounds the speed, and similar problems in which one does."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt

KNOTS, LENGTH = 64, 400.0
POWER = 1e5
STRAIGHT = qt.SpiralHelix([10.0, LENGTH / 20], [0.3], [0.0, 0.0], 20.0)
CIRCLE = qt.SpiralHelix([30.0], [0.0, 0.1], [0.0], 20.0)
PLAIN = qt.Vehicle(1500.0, friction=0.8)
DRAG = qt.Vehicle(1500.0, friction=0.8, drag_area=0.7, rolling_resistance=0.012)
STEEP = qt.Vehicle(1500.0, friction=0.8, bank=1.2)
UNBOUNDED = qt.ResultCode.speed_unbounded

MOVING = np.array([[20.0, 0, 0]] * 3)
ROUTE = qt.Route([0.0, 10, 20], [[0.0, 0, 0], [LENGTH / 2, 0, 0], [LENGTH, 0, 0]], MOVING, np.zeros((3, 3)))
STOPPING = qt.Route(  # to a stop, and on
    [0.0, 3, 8, 11],
    [[-12.0, 0, 0], [0, 0, 0], [0, 0, 0], [12, 0, 0]],
    [[6.0, 0, 0], [0, 0, 0], [0, 0, 0], [6, 0, 0]],
    np.zeros((4, 3)),
)
BETWEEN_STOPS = qt.Route([0.0, 10], [[0.0, 0, 0], [100, 0, 0]], np.zeros((2, 3)), np.zeros((2, 3)))


def code(path, ends=(None, None), **limits):
    return qt.retime(path, qt.Limits(**limits), start_speed=ends[0], end_speed=ends[1], knots=KNOTS).code


@pytest.mark.parametrize("vehicle", [PLAIN, DRAG])
@pytest.mark.parametrize("path", [STRAIGHT, ROUTE])
def test_friction_does_not_bound_a_free_speed_on_a_straight_path(path, vehicle):
    """The vehicle may start arbitrarily fast; drag only slows it down in proportion."""
    assert code(path, friction=1.0, vehicle=vehicle) == UNBOUNDED
    assert code(path, friction=1.0, power=POWER, vehicle=vehicle) == UNBOUNDED


@pytest.mark.parametrize("ends", [(10.0, None), (None, 10.0)])
def test_friction_bounds_the_speed_if_one_is_given(ends):
    assert code(STRAIGHT, ends, friction=1.0, vehicle=DRAG) == qt.ResultCode.successful


@pytest.mark.parametrize("vehicle", [PLAIN, DRAG])
def test_power_bounds_the_speed_only_after_a_given_start(vehicle):
    """A limit on power bounds only the increase of the speed, so braking at the end is not limited."""
    assert code(ROUTE, power=POWER, vehicle=vehicle) == UNBOUNDED
    assert code(STRAIGHT, (None, 10.0), power=POWER, vehicle=vehicle) == UNBOUNDED
    assert code(STRAIGHT, (10.0, None), power=POWER, vehicle=vehicle) == qt.ResultCode.successful


def test_braking_against_drag_bounds_the_speed_only_together_with_a_limit_on_the_deceleration():
    """From |v dv/ds| ≤ A and P ≥ m v (A_drag v² − A) follows a bound, which needs drag."""
    limits = {"power": POWER, "longitudinal_acceleration": 5.0}
    assert code(ROUTE, vehicle=DRAG, **limits) == qt.ResultCode.successful
    assert code(ROUTE, vehicle=PLAIN, **limits) == UNBOUNDED


def test_a_longitudinal_acceleration_needs_a_speed():
    assert code(STRAIGHT, (3.0, None), longitudinal_acceleration=2.0) == qt.ResultCode.successful
    assert code(STRAIGHT, lateral_acceleration=2.0, longitudinal_acceleration=2.0) == UNBOUNDED


def test_the_jerk_vanishes_at_every_constant_acceleration():
    limits = {"lateral_acceleration": 2.0, "jerk": 2.0}
    assert code(STRAIGHT, **limits) == UNBOUNDED
    assert code(STRAIGHT, (3.0, None), **limits) == UNBOUNDED
    assert code(STRAIGHT, (3.0, 3.0), **limits) == qt.ResultCode.successful
    assert code(ROUTE, power=POWER, jerk=2.0, vehicle=DRAG) == UNBOUNDED
    assert code(STRAIGHT, (3.0, None), **limits, longitudinal_acceleration=1.0) == qt.ResultCode.successful


def test_a_steep_bank_holds_the_vehicle_at_every_speed():
    """tan(β + arctan μ) is infinite, so friction bounds the speed from below only."""
    assert code(CIRCLE, friction=1.0, vehicle=STEEP) == UNBOUNDED
    assert code(CIRCLE, friction=1.0, vehicle=DRAG) == qt.ResultCode.successful


def test_stops_bound_the_speed_of_the_drives_between_them():
    assert code(STOPPING, friction=1.0, vehicle=DRAG) == qt.ResultCode.successful
    assert code(BETWEEN_STOPS, longitudinal_acceleration=2.0) == qt.ResultCode.successful


@pytest.mark.parametrize("length", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("pace", [1e-7, 1.0, 1e9])
def test_the_largest_speed_is_relative_to_the_limits(length, pace):
    """The code and the duration do not depend on the units of length and time, nor on the speed of the given path."""

    path = qt.SpiralHelix([10.0 * length, length * pace], [0.3], [0.0, 0.0], 1 / pace)
    limits = qt.Limits(speed=1e4 * length, longitudinal_acceleration=length)
    timed = qt.retime(path, limits, start_speed=0.0, end_speed=0.0, knots=KNOTS)
    assert timed.code == qt.ResultCode.successful
    np.testing.assert_allclose(float(timed.duration), 2.0, rtol=2e-4)


def test_each_element_of_a_batch_has_its_own_code():
    """The bank decides, inside jit and vmap."""

    @jax.jit
    @jax.vmap
    def codes(bank):
        limits = qt.Limits(friction=1.0, vehicle=qt.Vehicle(1500.0, friction=0.8, bank=bank))
        return qt.retime(CIRCLE, limits, knots=KNOTS).code

    assert codes(jnp.array([0.0, 1.2])).tolist() == [qt.ResultCode.successful, UNBOUNDED]


def test_the_advice_names_a_limit_on_speed():
    timed = qt.retime(STRAIGHT, qt.Limits(friction=1.0, power=POWER, vehicle=DRAG), knots=KNOTS)
    assert "Add a limit on speed" in timed.result
    assert "only if start_speed is given" in timed.result
