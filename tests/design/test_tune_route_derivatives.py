"""Derivatives of tuned routes: against finite differences of the solved problem, forward against reverse mode."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.design.solve.iterate import Iterate
from qtraj.design.solve.polishing import polished
from qtraj.design.tuning_route import sensitivity
from qtraj.design.tuning_route.problem import RouteProblem
from qtraj.design.tuning_route.program import RouteProgram
from qtraj.design.tuning_route.solution import Data

NAMES = ("curvature", "speed", "lateral_acceleration")
STEP = 1e-5
"""The relative step of the finite differences."""


def position(t):
    s = 8 * t - 6 * np.sin(0.15 * t)
    return np.stack([s, 6 * np.sin(0.06 * s), 0.5 * np.cos(0.02 * s)], axis=-1)


def states(count=10, start=9.0, h=1e-3):
    """Joint states of a drive in bends, too fast in one of them."""
    t = start + np.arange(count + 1.0)
    before, here, after = position(t - h), position(t), position(t + h)
    return t - start, np.stack([here, (after - before) / (2 * h), (after - 2 * here + before) / h**2], axis=1)


TIMES, STATES = states()
THETA = (jnp.asarray(1.4), jnp.asarray(0.5), jnp.zeros((3, 3)), jnp.asarray(1.0))
"""The limit on the lateral acceleration, the half-width of the tube, a change of the state at the end, and a factor of
the times."""

DIRECTION = (
    jnp.asarray(1.0),
    jnp.asarray(0.3),
    jnp.asarray(np.random.default_rng(0).normal(0, 0.1, (3, 3))),
    jnp.asarray(0.05),
)


def arguments(theta):
    lateral, tube, end, slower = theta
    joints = jnp.asarray(STATES).at[-1].add(end)
    route = qt.Route(TIMES * slower, joints[:, 0], joints[:, 1], joints[:, 2])
    return route, qt.Limits(curvature=0.0212, speed=9.5, lateral_acceleration=lateral), tube


def tuned(theta):
    route, limits, tube = arguments(theta)
    result = qt.tune_route(route, limits, tube=tube)
    return result.path.coefficients, result.path.duration, result.objective, result.displacement, result.delay


@pytest.fixture(scope="module")
def forward():
    """Values and derivatives along `DIRECTION`, and the search behind them."""
    found = []
    change = sensitivity._change

    def seen(structure, searched, data, direction):
        found.append((structure, searched, data))
        return change(structure, searched, data, direction)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sensitivity, "_change", seen)
        values, slopes = jax.jvp(tuned, (THETA,), (DIRECTION,))
    return values, slopes, *found[0]


def test_derivatives_are_finite_differences_of_the_solved_problem(forward):
    """The problem of the last search, with its margins, is solved again for data on both sides."""
    _, slopes, structure, found, data = forward
    given = structure.problem(found.fields)
    length = sensitivity._length(given, data, structure)

    def solved(sign):
        theta = jax.tree.map(lambda x, d: x + sign * STEP * d, THETA, DIRECTION)
        route, limits, tube = jax.tree.map(jnp.asarray, arguments(theta))
        bounds = jnp.stack([limits.given()[name] for name in NAMES])
        data = Data(route.starts, route.coefficients, route.duration, bounds, (tube, tube), None)
        problem = sensitivity._with_data(given, data, structure, length)
        program = RouteProgram(
            RouteProblem(*(x if isinstance(x, tuple) or x is None else np.asarray(x) for x in problem))
        )
        flat = (program.flat(*x) for x in (found.slacks, found.multipliers, found.margins))
        at, _, done = polished(program, Iterate(found.z, *flat))
        assert done
        path, *rest = sensitivity._assembled(structure, found.fields, data, at.z, route.origin)
        return path.coefficients, path.duration, *rest

    for slope, above, below in zip(slopes, solved(1.0), solved(-1.0), strict=True):
        known = (above - below) / (2 * STEP)
        np.testing.assert_allclose(slope, known, rtol=1e-6, atol=1e-6 * np.abs(known).max())


def test_reverse_mode_agrees_with_forward_mode(forward):
    values, slopes, *_ = forward

    def number(theta):
        coefficients, duration, objective, displacement, delay = tuned(theta)
        return jnp.sum(coefficients**2) + duration + objective + jnp.sum(displacement**2) + delay

    gradient = jax.grad(number)(THETA)
    known = 2 * jnp.sum(values[0] * slopes[0]) + slopes[1] + slopes[2] + 2 * jnp.sum(values[3] * slopes[3]) + slopes[4]
    found = sum(float(jnp.sum(a * b)) for a, b in zip(gradient, DIRECTION, strict=True))
    assert found == pytest.approx(float(known), rel=1e-7)


def test_values_are_those_without_derivatives(forward):
    plain = tuned(THETA)
    for a, b in zip(forward[0], plain, strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-9)
    assert float(plain[2]) > 1e-4, "the limits change the route"
