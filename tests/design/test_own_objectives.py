"""A user's objective: neither a constant nor a factor changes the path, and known optima are found."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from benchmarks.tuning.own_objectives import found, problems

import qtraj as qt

START = qt.BoundaryState([20.0, 0.0, 0.0], [1.0, 7.0, 0.3])
END = qt.BoundaryState([0.0, 28.0, 1.5], [-9.8, -1.0, 0.1])
DURATION = 4.6

MINIMUM = 0.1302426853
"""[m²] The least mean squared distance from the initial path, at equal fractions of the time."""

RTOL = {"sqp": 1e-7, "lbfgs": 1e-5}
"""Relative differences of coefficients: "lbfgs" ends where the scaled gradient is below 1e-6."""

OPTIMUM = {"sqp": 1e-6, "lbfgs": 1e-4}
"""Errors of the variables of an optimum: a gradient below 1e-6, divided by the smallest second derivative."""

CHANGES = {
    "sqp": [(1.0, 1.0), (0.0, 1e8), (0.0, 1e-8), (-1e4, 1e8), (1e8, 1.0), (1e8, 1e-8)],
    "lbfgs": [(-1e4, 1e8), (1e8, 1e-8)],
}
"""Constants and factors of the objective."""

STARTS = {"sqp": 2, "lbfgs": 1}
"""Numbers of starts: 600 steps of 8 starts take minutes in code that is compiled quickly rather than well."""

fractions = jnp.linspace(0.0, 1.0, 101)
initial = qt.SpiralHelix.hermite(START, END, DURATION)


def positions(path):
    return jax.vmap(lambda u: path.position(u * path.duration))(fractions)


def distance(constant, factor, path):
    """The mean squared distance from the initial path, which is 0 and has no gradient at the start of the search."""
    return factor * (jnp.mean(jnp.sum((positions(path) - positions(initial)) ** 2, axis=-1)) + constant)


def tuned(function, *numbers, limit=0.048, **options):
    """Numbers of a `Partial` are arguments of the compiled search: one compilation serves all of them."""
    objective = jax.tree_util.Partial(function, *map(jnp.asarray, numbers))
    return qt.tune(START, END, qt.Limits(curvature=limit), objective, "hermite", DURATION, **options)


@pytest.mark.parametrize("method", ["sqp", pytest.param("lbfgs", marks=pytest.mark.slow)])
def test_neither_a_constant_nor_a_factor_changes_the_path(method):
    options = {"method": method, "fixed": ["duration"], "starts": STARTS[method]}
    reference = tuned(distance, 0.0, 1.0, **options)
    assert reference.converged, reference.result
    assert float(reference.objective) == pytest.approx(MINIMUM, rel=1e-7)
    for constant, factor in CHANGES[method]:
        best = tuned(distance, constant, factor, **options)
        assert best.status == "converged", best.result
        for name in ("radius", "angle", "height"):
            got, right = (np.asarray(getattr(x.path, name)) for x in (best, reference))
            np.testing.assert_allclose(got, right, rtol=0, atol=RTOL[method] * np.abs(right).max())


@pytest.mark.slow
def test_an_infeasible_problem_has_one_verdict():
    speeds = {"start.V_phi": (5.0, 9.0), "end.V_phi": (8.0, 12.0), "start.V_rho": (-2.0, 2.0), "end.V_rho": (-2.0, 2.0)}
    options = {"method": "sqp", "fixed": ["duration"], "bounds": speeds, "starts": 2}
    reference = tuned(distance, 0.0, 1.0, limit=0.02, **options)
    assert reference.status == "infeasible"
    for constant, factor in ((1e8, 1.0), (-1.0, 1e8), (1.0, 1e-8)):
        best = tuned(distance, constant, factor, limit=0.02, **options)
        assert best.status == "infeasible"
        np.testing.assert_allclose(best.path.radius, reference.path.radius, rtol=1e-6)
        assert best.result == reference.result


def kinked(steepness, path):
    below = jax.nn.relu(4.7 - path.duration)
    return (path.duration - 6.0) ** 2 + steepness * below**2


@pytest.mark.parametrize("method", ["sqp", pytest.param("lbfgs", marks=pytest.mark.slow)])
def test_curvatures_that_differ_by_twelve_decades(method):
    """The search starts where the objective is steep, and ends where it is not."""
    for steepness in (0.0, 1e6, 1e12):
        best = tuned(kinked, steepness, limit=0.06, method=method, starts=2)
        assert best.status == "converged", best.result
        assert float(best.path.duration) == pytest.approx(6.0, rel=1e-7)


def power(exponent, path):
    return ((path.duration - 6.0) ** 2) ** exponent


def test_an_objective_without_curvature_at_its_minimum():
    """Newton's method converges linearly at a minimum of the fourth order."""
    best = tuned(power, 2.0, limit=0.06, method="sqp", starts=1)
    assert best.status == "converged", best.result
    assert float(best.path.duration) == pytest.approx(6.0, rel=1e-6)


def test_an_objective_that_is_not_finite_is_an_error():
    with pytest.raises(ValueError, match="the objective must be finite for the specified boundary states, but it is"):
        tuned(lambda c, path: c * path.duration / 0.0, 1.0, method="sqp")


def test_the_derivative_of_a_solution_does_not_depend_on_a_factor():
    """With a tiny factor, absolute tolerances on multipliers would make active limits inactive."""

    def duration(target, factor):
        objective = jax.tree_util.Partial(weighted, target, jnp.asarray(factor))
        return qt.tune(START, END, qt.Limits(speed=7.0), objective, method="sqp", starts=1).path.duration

    slopes = [
        float(jax.jvp(lambda target, factor=factor: duration(target, factor), (7.0,), (1.0,))[1])
        for factor in (1.0, 1e8, 1e-9)
    ]
    np.testing.assert_allclose(slopes, slopes[0], rtol=1e-6)
    step = 1e-3
    expected = (float(duration(7.0 + step, 1.0)) - float(duration(7.0 - step, 1.0))) / (2 * step)
    assert slopes[0] == pytest.approx(expected, rel=1e-4)


def weighted(target, factor, path):
    ends = jnp.stack([path.rotating_derivatives(t, 1)[1] for t in (jnp.zeros(()), path.duration)])
    return factor * ((path.duration - target) ** 2 + jnp.sum((ends - jnp.asarray([[1.0, 7.0, 0.3]])) ** 2))


@pytest.mark.parametrize("method", ["sqp", pytest.param("lbfgs", marks=pytest.mark.slow)])
def test_random_objectives_with_known_optima(method):
    """A small number of those of `python -m benchmarks.tuning.own_objectives`."""
    errors = found(problems(12, seed=3), method)
    assert errors.shape == (12,)
    assert np.all(errors < OPTIMUM[method]), errors
