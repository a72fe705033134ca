"""Derivatives of routes that are tuned within limits by speed."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.design.route_derivatives import compared
from tests.design.test_tune_route_derivatives import STATES, TIMES

import qtraj as qt

GRIP = qt.BySpeed([0.0, 6.0, 12.0], magnitude=[2.2, 1.8, 1.0])
LIMITS = {
    "lateral": {"lateral_acceleration": GRIP},
    "two sides": {
        "lateral_acceleration": GRIP,
        "longitudinal_acceleration": qt.BySpeed([0.0, 12.0], lower=[-1.0, -0.5], upper=[0.8, 0.3]),
    },
    "ellipse": {"combined_acceleration": qt.Ellipse(1.5, qt.BySpeed([0.0, 12.0], magnitude=[1.0, 0.6]), GRIP)},
}
THETA = jnp.asarray([0.0, 1.0, 9.5, 0.5])
"""A shift of the fourth joint [m], a factor of the times, the limit on the speed, the tube."""
DIRECTION = jnp.asarray([0.2, 0.05, 0.2, 0.1])


def arguments(theta, kind):
    joints = jnp.asarray(STATES).at[3, 0, 1].add(theta[0])
    route = qt.Route(TIMES * theta[1], joints[:, 0], joints[:, 1], joints[:, 2])
    return route, qt.Limits(speed=theta[2], **LIMITS[kind]), theta[3]


@pytest.mark.slow
@pytest.mark.parametrize("kind", LIMITS)
def test_derivatives_are_finite_differences_of_the_solved_problem(kind, monkeypatch):
    values = compared(lambda x: arguments(x, kind), THETA, DIRECTION, monkeypatch)
    assert float(values[2]) > 1e-4, "the limits change the route"


@pytest.mark.slow
def test_compiled_searches_agree():
    def number(theta):
        return qt.tune_route(*arguments(theta, "ellipse")).objective

    value, slope = jax.jvp(number, (THETA,), (DIRECTION,))
    own, gradient = jax.jit(jax.value_and_grad(number))(THETA)
    assert float(own) == pytest.approx(float(value), rel=1e-6)
    assert float(gradient @ DIRECTION) == pytest.approx(float(slope), rel=1e-6)


def test_each_limit_has_its_own_derivatives():
    """What JAX has traced for one limit by speed must not serve another one."""

    times = np.linspace(0.0, 8.0, 5)
    angle, zero = 0.3 * times, 0.0 * times
    circle = 20 * np.stack([np.sin(angle), np.cos(angle), zero], 1)
    velocities = 6 * np.stack([np.cos(angle), -np.sin(angle), zero], 1)

    def objective(size, end):
        route = qt.Route(times, circle * size, velocities * size, -0.09 * circle * size)
        limits = qt.Limits(lateral_acceleration=qt.BySpeed([0.0, 10.0], magnitude=[3.0, end]))
        return qt.tune_route(route, limits, 2.0, fixed=np.zeros(5, bool)).objective

    for end in (0.9, 0.3):
        rise = (float(objective(1 + 1e-5, end)) - float(objective(1 - 1e-5, end))) / 2e-5
        assert float(jax.grad(objective)(1.0, end)) == pytest.approx(rise, rel=1e-3)


def test_what_is_refused():
    route, _, tube = arguments(THETA, "lateral")

    def by_speed(x):
        limit = qt.BySpeed([0.0, 10.0], upper=jnp.stack([2 * x, x]))
        return qt.tune_route(route, qt.Limits(lateral_acceleration=limit), tube).objective

    def along(x):
        return qt.tune_route(route, qt.Limits(speed=qt.Along([0.0, 10.0], [9.0, 8.0]), curvature=x), tube).objective

    with pytest.raises(ValueError, match="must have concrete values"):
        jax.grad(by_speed)(1.0)
    with pytest.raises(ValueError, match="change along the way"):
        jax.grad(along)(0.03)
