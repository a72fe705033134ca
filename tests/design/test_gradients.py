"""Derivatives outside jit: the same searches as without derivatives, nothing compiled twice, and second derivatives."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt

START = qt.BoundaryState([20.0, 0.0, 0.0], [1.0, 7.0, 0.3])
END = qt.BoundaryState([0.0, 28.0, 1.5], [-9.8, -1.0, 0.1])
TIMES = np.linspace(0.0, 4.5, 50)


def path(x):
    return qt.SpiralHelix(x * jnp.asarray([20.0, 1.0, 0.3, -0.05]), [0.2, 0.35, 0.02, -0.004], [1.0, 0.4, 0.05], 4.5)


def tuned(x):
    limits = qt.Limits(curvature=0.06 * x, speed=9.0)
    return qt.tune(START, END, limits, motion="hermite", duration=4.0, starts=2)


@jax.custom_vjp
def squared(duration):
    """A part of an objective that has derivatives in reverse mode only."""
    return duration**2


squared.defvjp(lambda duration: (duration**2, duration), lambda duration, weight: (2 * duration * weight,))


def cost(weight, path):
    return weight * squared(path.duration) + jnp.sum((path.velocity(0.0) - START.velocity) ** 2)


def weighted(objective, **options):
    limits = qt.Limits(speed=9.0)
    best = qt.tune(START, END, limits, objective, motion="hermite", duration=4.0, starts=1, method="sqp", **options)
    return best.path.duration


def several(x):
    """A batch in which a bound is active in the first element, and the corridor in both."""
    position, velocity = (jnp.stack([getattr(s, name) for s in (START, END)]) for name in ("position", "velocity"))
    faster = velocity[:, None] * jnp.asarray([[[1.0], [1.15]]])
    start, end = (jax.vmap(lambda v, k=k: qt.BoundaryState(position[k], v))(faster[k]) for k in (0, 1))
    bounds, limits = {"duration": (None, 4.5 * x)}, qt.Limits(curvature=0.06, speed=9.0)
    best = qt.tune(
        start, end, limits, motion="hermite", duration=4.0, starts=2, corridor=1.3 * jnp.sqrt(x), bounds=bounds
    )
    return jnp.sum(best.path.duration) + jnp.sum(best.start.velocity)


@functools.cache
def timing():
    return qt.retime(path(1.0), qt.Limits(speed=12.0, acceleration=3.0), 3.0, 3.0).path.timing


def largest(x):
    return jnp.sum(qt.certify(qt.RetimedPath(path(x), timing()), qt.Limits(jerk=50.0, curvature=1.0)).values)


FUNCTIONS = {
    "certify": lambda x: jnp.sum(qt.certify(path(x), qt.Limits(curvature=0.1, speed=20.0)).values),
    "corridor": lambda x: qt.certify(path(x), qt.Limits(), corridor=1.0, reference=path(1.01)).values[0],
    "batch": lambda x: jnp.sum(qt.certify(jax.vmap(path)(x * jnp.ones(3)), qt.Limits(speed=20.0)).values),
    "retimed": largest,
    "tune": lambda x: tuned(x).path.duration,
    "objective": lambda x: weighted(jax.tree_util.Partial(cost, jnp.asarray(0.3 * x))),
    "several": several,
    "table": lambda x: jnp.sum(qt.evaluate(path(x), TIMES, ("curvature",)).values["curvature"]),
    "maximum": lambda x: qt.evaluate(path(x), TIMES, ("curvature",), reduce="max").values["curvature"],
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_second_gradient_compiles_nothing(name, compiled):
    function, step = FUNCTIONS[name], 1e-5
    jax.value_and_grad(function)(0.99)
    compiled.clear()
    value, slope = jax.value_and_grad(function)(1.0)
    assert not compiled
    difference = (float(function(1.0 + step)) - float(function(1.0 - step))) / (2 * step)
    assert float(slope) == pytest.approx(difference, rel=1e-4)
    assert float(value) == pytest.approx(float(function(1.0)), rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("wrap", [lambda f: f, jax.jit])
def test_an_objective_may_use_differentiated_numbers_of_its_scope(wrap):
    expected = jax.grad(FUNCTIONS["objective"])(1.0)
    found = wrap(jax.grad(lambda x: weighted(lambda path: cost(0.3 * x, path))))(1.0)
    assert float(found) == pytest.approx(float(expected), rel=1e-9)


def test_other_numbers_in_an_objective_compile_nothing(compiled):
    class Cost(eqx.Module):
        weight: jax.Array

        def __call__(self, path):
            return cost(self.weight, path)

    first = float(weighted(Cost(jnp.asarray(0.3))))
    compiled.clear()
    assert float(weighted(Cost(jnp.asarray(0.6)))) < first
    assert not compiled


@pytest.mark.slow
def test_the_second_derivative_of_a_solution():
    def duration(x):
        return qt.tune(START, END, qt.Limits(curvature=0.048 * x), starts=1).path.duration

    slope, step = jax.grad(duration), 1e-4
    difference = (float(slope(1.0 + step)) - float(slope(1.0 - step))) / (2 * step)
    assert float(jax.grad(slope)(1.0)) == pytest.approx(difference, rel=1e-3)


@pytest.mark.parametrize("argument", ["limit", "duration", "mass"])
def test_a_python_number_is_differentiated(argument):
    """Under grad, its constant is not an array."""

    def total(x):
        numbers = {"limit": 20.0, "duration": 4.5, "mass": 1.2e4} | {argument: x}
        path = qt.SpiralHelix([20.0, 1.0], [0.0, 0.2, 0.05], [0.0, 0.1], numbers["duration"])
        vehicle = qt.Vehicle(numbers["mass"], friction=0.8)
        found = qt.certify(path, qt.Limits(speed=numbers["limit"], power=6e5, vehicle=vehicle))
        assert found.status["speed"] == "proved"
        return jnp.sum(found.values) + jnp.sum(found.limits)

    at = {"limit": 20.0, "duration": 4.5, "mass": 1.2e4}[argument]
    step = 1e-5 * at
    difference = (float(total(at + step)) - float(total(at - step))) / (2 * step)
    assert float(jax.grad(total)(at)) == pytest.approx(difference, rel=1e-6)


def test_an_ill_posed_problem_raises_under_grad():
    with pytest.raises(ValueError, match="limit curvature must be positive"):
        jax.grad(FUNCTIONS["tune"])(-1.0)


def test_a_problem_without_a_solution_has_its_status_and_path_under_grad():
    def duration(x):
        outcome = qt.tune(START, END, qt.Limits(curvature=0.001 * x), starts=1)
        assert outcome.status == "infeasible"
        return outcome.path.duration

    assert float(jax.value_and_grad(duration)(1.0)[0]) == pytest.approx(float(duration(1.0)), rel=1e-12)


def test_the_derivative_where_a_limited_quantity_is_singular():
    """On a plane path, the square of the torsion is a product of invariants that are zero."""
    start = qt.BoundaryState([20.0, 0.0, 0.0], [1.0, 7.0, 0.0])

    def climbs(height):
        end = qt.BoundaryState(jnp.asarray([0.0, 28.0, 0.0]).at[2].set(height), [-9.8, -1.0, 0.0])
        best = qt.tune(start, end, qt.Limits(angular_rate=0.33), starts=1)
        return jnp.stack([best.start.velocity[2], best.end.velocity[2]])

    step = 1e-3
    slopes = jax.jvp(climbs, (0.0,), (1.0,))[1]
    np.testing.assert_allclose(slopes, (climbs(step) - climbs(-step)) / (2 * step), rtol=1e-5)
