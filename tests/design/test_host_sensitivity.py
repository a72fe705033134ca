"""Derivatives of solutions by jets on the host agree with those of compiled code and with differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.design.tuning import host_sensitivity

START = qt.BoundaryState([20.0, 0.0, 0.0], [1.0, 7.0, 0.3])
END = qt.BoundaryState([0.0, 28.0, 1.5], [-9.8, -1.0, 0.1])
VEHICLE = qt.Vehicle(1.2e4, friction=0.8, drag_area=6.0, bank=0.02)
X = np.array([1.0, 1.01, 0.99, 1.0])


def tuned(limits, numbers, **options):
    """A solution as a function of two boundary velocities, a position and the limits."""
    start = qt.BoundaryState(START.position, START.velocity * numbers[0])
    end = qt.BoundaryState(END.position * numbers[1], END.velocity * numbers[2])
    best = qt.tune(start, end, limits(numbers[3]), starts=1, **options)
    return jnp.concatenate([best.path.radius, best.path.angle, best.path.duration[None], best.objective[None]])


CASES = {
    "uniform": ((lambda x: qt.Limits(curvature=0.06 * x, speed=10.5)), {}),
    "smoothest": (lambda x: qt.Limits(lateral_acceleration=2.9 * x), {"objective": "smoothest"}),
    "fastest": (
        lambda x: qt.Limits(friction=0.35 * x, speed=9.0, vehicle=VEHICLE),
        {"motion": "hermite", "objective": "fastest", "duration": 4.6, "fixed": ["start.heading", "end.V_h"]},
    ),
    "corridor and bound": (
        lambda x: qt.Limits(curvature=0.06 * x),
        {"motion": "hermite", "duration": 4.0, "corridor": 1.3, "bounds": {"duration": (None, 4.5)}},
    ),
    "sides": (lambda x: qt.Limits(longitudinal_acceleration=(-0.5, 0.8 * x), speed=9.5), {"motion": "hermite"}),
}


@pytest.mark.parametrize("name", CASES)
def test_derivatives_agree_with_differences(name):
    limits, options = CASES[name]
    function = lambda x: tuned(limits, x, **options)  # noqa: E731
    found = np.asarray(jax.jacfwd(function)(jnp.asarray(X)))
    assert np.any(found[:, 3] != 0.0)
    scale = np.abs(np.asarray(function(jnp.asarray(X))))
    for direction in ([1.0, -0.7, 0.6, 0.0], [0.0, 0.5, 0.8, 1.0]):
        step = 1e-6 * np.array(direction)
        difference = (np.asarray(function(jnp.asarray(X + step))) - np.asarray(function(jnp.asarray(X - step)))) / 2e-6
        np.testing.assert_allclose(found @ direction, difference, rtol=1e-5, atol=1e-5 * scale.max())


def test_the_objective_and_the_placement_may_be_differentiated():
    """Their derivatives are those of compiled code, because jets do not have these operations."""

    def height(x):
        near = qt.SpiralHelix(x * jnp.array([20.0, 1.0]), [0.0, 0.3], [0.0, 0.3], 5.0)
        return tuned(lambda y: qt.Limits(curvature=0.06 * y), jnp.ones(4), nearest_to=near, fixed=["duration"])[1]

    step = 1e-5
    difference = (float(height(1.0 + step)) - float(height(1.0 - step))) / (2 * step)
    assert float(jax.grad(height)(1.0)) == pytest.approx(difference, rel=1e-3)


def test_an_ill_posed_element_does_not_change_the_others():
    def total(x):
        velocities = jnp.stack([START.velocity, 0 * START.velocity, START.velocity * 1.01])
        start = jax.vmap(lambda v: qt.BoundaryState(START.position, v))(velocities)
        end = jax.vmap(lambda v: qt.BoundaryState(END.position, v))(jnp.stack([END.velocity] * 3))
        best = qt.tune(start, end, qt.Limits(curvature=0.06 * x, speed=10.5), starts=1)
        return best.path.duration[0] + best.path.duration[2]

    step = 1e-6
    difference = (float(total(1.0 + step)) - float(total(1.0 - step))) / (2 * step)
    assert float(jax.grad(total)(1.0)) == pytest.approx(difference, rel=1e-5)


def test_an_undetermined_solution_has_no_derivative():
    def heights(x):
        return qt.tune(START, END, qt.Limits(curvature=0.06), "smoothest", duration=4 * x, starts=1).path.height

    assert np.isnan(jax.jacfwd(heights)(1.0)).any()


@pytest.mark.slow
def test_compiled_code_gives_the_same_derivatives(monkeypatch):
    limits, options = CASES["corridor and bound"]
    derivative = jax.jacrev(lambda x: tuned(limits, x, **options))
    found = derivative(jnp.asarray(X))
    monkeypatch.setattr(host_sensitivity, "MAX_COUNT", 0)
    np.testing.assert_allclose(found, derivative(jnp.asarray(X)), rtol=1e-9, atol=1e-9)


def test_few_derivatives_compile_little(compiled):
    limits, options = CASES["uniform"]
    jax.grad(lambda x: tuned(limits, x, **options)[0])(jnp.asarray(X))
    assert len(compiled) < 60
