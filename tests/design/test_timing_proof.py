"""Excess of timings that `retime` did not compute: closed forms on a circle, dense samples on a turn."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from benchmarks.timing_proof import cells_of, exceeded

import qtraj as qt

CELLS = 64
RADIUS, RATE = 30.0, 0.1
CIRCLE = qt.SpiralHelix(np.array([RADIUS]), np.array([0.0, RATE]), np.array([0.0]), 20.0)
TURN = qt.SpiralHelix.hermite(
    qt.BoundaryState([30.0, 0, 0], [0, 10.0, 1]), qt.BoundaryState([0, 45.0, 8], [-12.0, 2, 0]), 6.0
)


def linear(values):
    """The powers of u̇² that is linear between the knots."""
    values = np.asarray(values, float)
    return np.stack([values[:-1], np.diff(values), 0 * values[1:], 0 * values[1:]], axis=1)


@pytest.mark.parametrize("over", [1e-6, 0.02])
def test_the_excess_on_a_circle_is_that_of_the_closed_form(over):
    """At the constant speed V(1 + e) the speed exceeds V by e, and the lateral acceleration V²/R by e(2 + e)."""
    speed = 6.0
    limits = qt.Limits(speed=speed, lateral_acceleration=speed**2 / RADIUS, longitudinal_acceleration=1.0)
    powers = linear(np.full(CELLS + 1, (speed * (1 + over) / (RADIUS * RATE)) ** 2))
    found = exceeded(cells_of(CIRCLE, CELLS), powers, (False, False), limits)
    assert found["longitudinal_acceleration"] == ("proved", 0.0)
    for name, expected in (("speed", over), ("lateral_acceleration", over * (2 + over))):
        status, excess = found[name]
        assert status == "broken"
        assert expected * (1 - 1e-4) <= excess <= expected * 1.011


def test_a_timing_that_satisfies_a_limit_at_the_knots_breaks_it_between():
    """u̇² at its upper bound at the knots and linear between them: the bound is not linear, and dense samples agree."""
    lateral, places = 3.0, 33
    cells = cells_of(TURN, CELLS)

    def per_square(times):
        r1, r2 = np.moveaxis(np.asarray(jax.vmap(lambda t: TURN.derivatives(t, 2)[1:])(jnp.asarray(times))), 1, 0)
        return np.linalg.norm(np.cross(r1, r2), axis=1) / np.linalg.norm(r1, axis=1)

    at_knots = lateral / per_square(cells.knots)
    found = exceeded(cells, linear(at_knots), (False, False), qt.Limits(lateral_acceleration=lateral))
    status, excess = found["lateral_acceleration"]
    assert status == "broken"
    near = np.linspace(cells.knots[:-1], cells.knots[1:], places, axis=1).ravel()
    sampled = np.max(per_square(near) * np.interp(near, cells.knots, at_knots)) / lateral - 1
    assert sampled * (1 - 1e-9) <= excess <= sampled * 1.02


def test_nothing_is_proved_where_the_squared_rate_is_negative():
    powers = linear(np.full(CELLS + 1, -1.0))
    found = exceeded(cells_of(CIRCLE, CELLS), powers, (False, False), qt.Limits(speed=6.0))
    assert found["speed"] == ("undecided", np.inf)
