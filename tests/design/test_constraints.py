"""The constraints of tuning: limits in unit time, and their derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.design.tuning import constraints, corridor
from qtraj.design.tuning.curves import cubics, curve_derivatives, reference_cubics
from qtraj.design.tuning.expansions import expansions, slopes
from qtraj.design.tuning.model import make_setting, setting
from qtraj.design.tuning.motions.registry import MOTIONS
from qtraj.design.tuning.objectives.registry import OBJECTIVES
from qtraj.design.tuning.problem import pose
from qtraj.path.quantity import QUANTITIES
from qtraj.path.values import squared
from qtraj.path.vehicle import RoadParameters

START = qt.BoundaryState([20.0, 0.0, 0.0], [-3.0, 7.0, 0.3])
END = qt.BoundaryState([0.0, 28.0, 1.5], [-9.8, -3.0, 0.1])
AXIS = qt.Placement([1.0, -2.0, 0.5], [0.99, 0.02, -0.03, 0.1])
LIMIT = jnp.asarray(1.7)
INDEX = {name: np.uint32(k) for k, name in enumerate(QUANTITIES)} | {"corridor": np.uint32(constraints.CORRIDOR_INDEX)}
PLACES = jnp.asarray([0.0, 0.3, 1.0])
VEHICLE = qt.Vehicle(2.0, drag_area=0.7, rolling_resistance=0.02, friction=(0.7, 0.5), bank=0.2)
ROAD = RoadParameters(*map(jnp.asarray, VEHICLE.parameters()))


def make_problem(motion, placement=None, objective="nearest"):
    duration = 4.0 if objective == "smoothest" else None
    problem = pose(START, END, OBJECTIVES[objective], MOTIONS[motion], duration, 0, placement, road=ROAD)
    return problem, 0.01 * jnp.asarray(np.random.default_rng(5).normal(size=problem.size))


def constraint(problem, z, u, name, limit):
    """The constraint g = ½((value/limit)² − 1) at the fraction `u` of the duration, by its definition."""
    if name == "corridor":
        place = cubics(problem, problem.slopes(z)[0])
        return 0.5 * (corridor.value(place, reference_cubics(problem), u[None])[0] / limit**2 - 1.0)
    path = problem.path(z)
    return 0.5 * (squared(path, u * path.duration, name, problem.road) / limit**2 - 1.0)


@pytest.mark.parametrize("placement", [None, AXIS], ids=["upright", "tilted"])
@pytest.mark.parametrize("motion", MOTIONS)
def test_values_match_the_definition(motion, placement):
    problem, z = make_problem(motion, placement)
    values = constraints.of_one_path(constraints.values)
    constraint_values = jax.jit(lambda index: values(make_setting(problem, z), index, LIMIT, PLACES))
    for name, index in INDEX.items():
        exact = [constraint(problem, z, u, name, LIMIT) for u in PLACES]
        np.testing.assert_allclose(constraint_values(index), exact, rtol=1e-9, atol=1e-12, err_msg=name)


def exact_derivatives(problem, z, name):
    """The value and its derivatives z, zz, zu, u, uu at all places, by differentiation of the definition."""

    def of_both(x):
        return constraint(problem, x[:-1], x[-1], name, LIMIT)

    x = jnp.concatenate([jnp.broadcast_to(z, (len(PLACES), len(z))), jnp.asarray(PLACES)[:, None]], axis=1)
    value, slope, second = jax.jit(jax.vmap(lambda x: (of_both(x), jax.grad(of_both)(x), jax.hessian(of_both)(x))))(x)
    n = len(z)
    parts = value, slope[:, :n], second[:, :n, :n], second[:, :n, n], slope[:, n], second[:, n, n]
    return [np.moveaxis(np.asarray(part), 0, -1) for part in parts]


@pytest.mark.parametrize(
    ("motion", "placement", "objective", "names"),
    [
        (
            "hermite",
            AXIS,
            "nearest",
            ["curvature", "angular_acceleration", "yaw_acceleration", "corridor", "friction", "power"],
        ),
        *(
            pytest.param(motion, placement, objective, list(INDEX), marks=pytest.mark.slow)
            for motion, placement, objective in [
                ("uniform", None, "nearest"),
                ("hermite", None, "smoothest"),
                ("hermite", AXIS, "nearest"),
            ]
        ),
    ],
)
def test_derivatives_match_the_definition(motion, placement, objective, names):
    problem, z = make_problem(motion, placement, objective)

    @jax.jit
    def compute(index):
        at, derivatives = curve_derivatives(problem, z, problem.slopes(z)[0])
        here = setting(problem, at, problem.slopes(z)[1])
        arguments = here, derivatives, index, LIMIT, PLACES
        return tuple(constraints.of_one_path(function)(*arguments) for function in (expansions, slopes))

    for name in names:
        index = INDEX[name]
        exact = exact_derivatives(problem, z, name)
        expansion, (value, slope) = compute(index)
        for field, ours, expected in zip(expansion._fields, expansion, exact, strict=True):
            scale = 1e-9 * (1 + np.abs(expected).max())
            np.testing.assert_allclose(ours, expected, rtol=1e-8, atol=scale, err_msg=f"{name} {field}")
        np.testing.assert_allclose(value, exact[0], rtol=1e-8, atol=1e-9, err_msg=name)
        np.testing.assert_allclose(slope, exact[1], rtol=1e-8, atol=1e-9 * (1 + np.abs(exact[1]).max()), err_msg=name)
