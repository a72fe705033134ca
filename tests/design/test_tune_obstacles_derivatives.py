"""Derivatives of routes that are tuned around obstacles, against finite differences of the solved problem."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.design.route_derivatives import compared

import qtraj as qt

CAR = [(0.0, 0.5), (2.0, 0.5)]
OBSTACLES = {
    "ball": qt.Ball([20.0, 0.3, 0.0], 1.0),
    "crossing": qt.Ball([[20.0, -8.4, 0.0], [0.0, 2.0, 0.0]], 1.0),
    "polygon": qt.ConvexPolygon([[19.0, -0.7], [21.0, -0.7], [21.0, 1.3], [19.0, 1.3]]),
}
THETA = jnp.asarray([0.0, 1.0, 7.0, 3.0])
"""A shift of the fourth and fifth joint to the left [m], a factor of the times, the limit on the speed, the tube."""
DIRECTION = jnp.asarray([1.0, 0.05, 0.2, 0.1])


def arguments(theta, kind):
    x = 5.0 * np.arange(9.0)
    zero = np.zeros(9)
    position, velocity, acceleration = (np.stack([v, zero, zero], axis=1) for v in (x, zero + 5.0, zero))
    position = jnp.asarray(position).at[3:5, 1].add(theta[0])
    limits = qt.Limits(speed=theta[2], lateral_acceleration=3.0, keep_out=[OBSTACLES[kind]], body=CAR)
    return qt.Route(x / 5.0 * theta[1], position, velocity, acceleration), limits, theta[3]


def tuned(theta, kind):
    route, limits, tube = arguments(theta, kind)
    return qt.tune_route(route, limits, tube=tube)


@pytest.mark.parametrize("kind", [x if x == "crossing" else pytest.param(x, marks=pytest.mark.slow) for x in OBSTACLES])
def test_derivatives_are_finite_differences_of_the_solved_problem(kind, monkeypatch):
    """The problem of the last search, with its margins, is solved again for data on both sides."""
    values = compared(lambda x: arguments(x, kind), THETA, DIRECTION, monkeypatch)
    assert float(values[2]) > 1e-3, "the obstacle changes the route"


@pytest.mark.slow
def test_reverse_mode_and_compiled_searches_agree():
    """The gradient times a direction is the derivative in this direction, also inside jit."""
    kind = "crossing"

    def number(theta):
        best = tuned(theta, kind)
        return best.objective + jnp.sum(best.displacement**2)

    value, slope = jax.jvp(number, (THETA,), (DIRECTION,))
    own, gradient = jax.jit(jax.value_and_grad(number))(THETA)
    assert float(own) == pytest.approx(float(value), rel=1e-6)
    assert float(gradient @ DIRECTION) == pytest.approx(float(slope), rel=1e-6)


def test_results_inside_jit_are_those_outside():
    inside = jax.jit(lambda x: tuned(x, "ball"))(THETA)
    outside = tuned(THETA, "ball")
    assert inside.certificate.status == outside.certificate.status
    assert set(outside.certificate.status.values()) == {"proved"}
    np.testing.assert_allclose(inside.path.coefficients, outside.path.coefficients, rtol=0, atol=1e-6)


def test_traced_obstacles_are_refused():
    def number(radius):
        route, _, _ = arguments(THETA, "ball")
        return qt.tune_route(route, qt.Limits(speed=7.0, keep_out=[qt.Ball([20.0, 0.3, 0.0], radius)])).objective

    with pytest.raises(ValueError, match="obstacles and a body with concrete values"):
        jax.grad(number)(1.0)
