"""The constraints of tuning: ln(value/limit) of every quantity, their peaks, and their derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.design.tuning import model as tuning_model
from qtraj.design.tuning.constraints import ABSENT, MARGIN
from qtraj.design.tuning.model import build, costs
from qtraj.design.tuning.motions.registry import MOTIONS
from qtraj.design.tuning.objectives.registry import OBJECTIVES
from qtraj.design.tuning.peaks import Peaks, find_peaks
from qtraj.design.tuning.problem import broadcasting, pose
from qtraj.design.tuning.searches import Curves, Searches, searches_of
from qtraj.design.tuning.task import Task, constraint_values
from qtraj.path.quantity import CORRIDOR, QUANTITIES
from qtraj.path.values import value

START = qt.BoundaryState([20.0, 0.0, 0.0], [-3.0, 7.0, 0.3])
END = qt.BoundaryState([0.0, 28.0, 1.5], [-9.8, -3.0, 0.1])
AXIS = qt.Placement([1.0, -2.0, 0.5], [0.99, 0.02, -0.03, 0.1])
VEHICLE = qt.Vehicle(2.0, (3.0, 5.0, 4.0), 0.7, 0.02, (0.7, 0.5), wheelbase=2.7)
LIMIT, BATCH = 1.7, 3


def make_searches(motion, names, placement=None, objective="nearest"):
    """Three paths with different variables, with the same limit on each quantity."""
    duration = 4.0 if objective == "smoothest" else None
    states = (jax.tree.map(lambda x: jnp.stack([x] * BATCH), state) for state in (START, END))
    road = VEHICLE.parameters()
    problem = pose(*states, OBJECTIVES[objective], MOTIONS[motion], duration, 0, placement, road=road)
    limits = {name: np.full(BATCH, LIMIT) for name in names}
    wide = np.full((BATCH, problem.size), 10.0)
    z = 0.03 * np.random.default_rng(5).normal(size=(problem.size, BATCH))
    return searches_of(problem, limits, -wide, wide), z


def values_of_all(path, times):
    """The quantities of a path at some instants."""
    return {name: value(path, times, name, VEHICLE.parameters()) for name in QUANTITIES}


@pytest.mark.parametrize("placement", [None, AXIS])
@pytest.mark.parametrize("motion", MOTIONS)
def test_constraints_are_the_logarithms_of_the_ratios(motion, placement):
    searches, z = make_searches(motion, tuple(QUANTITIES), placement)
    u, k = np.array([0.0, 0.3, 1.0])[:, None], 1
    rows = Curves(searches, z).values(tuple(QUANTITIES), u, searches.order)
    path = jax.tree.map(lambda x: np.asarray(x[k]), searches.problem.path(z))
    every = values_of_all(path, u[:, 0] * float(path.duration))
    for (name, entry), g in zip(QUANTITIES.items(), rows, strict=True):
        scale = float(entry.scale(VEHICLE.parameters()))
        values = entry.tangent(np.asarray(every[name]) / scale)
        least = -30.0 if name == "height" else 2 * ABSENT  # the start has the height 0, to rounding errors
        expected = np.where(values > 0, np.log(np.where(values > 0, values, 1.0) / LIMIT), least)
        if name == "height":
            expected = np.maximum(expected + MARGIN * (4 * u * (1 - u))[:, 0], least)
        own = np.broadcast_to(g, (3, BATCH))[:, k]
        np.testing.assert_allclose(np.maximum(own, least), expected, rtol=1e-9, atol=1e-9, err_msg=name)


def test_the_corridor_is_the_distance_from_the_initial_path():
    searches, z = make_searches("hermite", (CORRIDOR.name,))
    u = np.linspace(0.0, 1.0, 5)[1:-1, None]
    own = Curves(searches, z).values((CORRIDOR.name,), u, 0)[0]
    for k in range(BATCH):
        paths = [jax.tree.map(lambda x, k=k: x[k], searches.problem.path(x)) for x in (z, np.zeros_like(z))]
        coordinates = [
            [np.polynomial.polynomial.polyval(u[:, 0] * p.duration, c) for c in (p.radius, p.angle, p.height)]
            for p in paths
        ]
        (r, phi, h), (r0, phi0, h0) = coordinates
        squared = (r - r0) ** 2 + r * r0 * (phi - phi0) ** 2 + (h - h0) ** 2
        np.testing.assert_allclose(own[:, k], 0.5 * np.log(squared) - np.log(LIMIT), rtol=1e-9)


@pytest.mark.parametrize("motion", MOTIONS)
def test_jax_gives_the_same_values(motion):
    names = ("corridor", "curvature", "friction", "power", "yaw_acceleration")  # sorted, as in JAX
    searches, z = make_searches(motion, names, AXIS)
    u = np.array([0.1, 0.6])
    own = Curves(searches, z).values(names, u[:, None], searches.order)
    task = Task(searches.problem, searches.limits, searches.low.T, searches.high.T)
    one = jax.tree.map(lambda x: jnp.asarray(x[0]), task)
    with broadcasting():
        values = jax.jit(constraint_values)(one, z[:, 0], jnp.stack([jnp.asarray(u)] * len(names)))
    np.testing.assert_allclose(values, [g[:, 0] for g in own], rtol=1e-10, atol=1e-10)


def largest(searches, z):
    return find_peaks(searches, Curves(searches, z))[1]


@pytest.mark.parametrize("name", ["curvature", "jerk", "speed", "acceleration", "slope", "friction", "power"])
@pytest.mark.parametrize("motion", MOTIONS)
def test_the_highest_peak_is_exact_and_its_derivatives_agree_with_differences(motion, name):
    searches, z = make_searches(motion, (name,))
    for _ in range(3):  # only peaks near the limit are refined
        limit = searches.limits[name] * np.exp(largest(searches, z))
        searches = Searches(searches.problem, {name: limit}, searches.low, searches.high, searches.weight, True)
    peaks, highest = find_peaks(searches, Curves(searches, z))
    np.testing.assert_allclose(highest, 0.0, atol=1e-9)
    dense = Curves(searches, z).values((name,), np.linspace(0.0, 1.0, 20001)[:, None], searches.order)[0]
    np.testing.assert_allclose(np.broadcast_to(dense, (20001, BATCH)).max(axis=0), highest, atol=1e-6)
    model, step = build(searches, z, peaks), 1e-5
    for k in range(len(z)):
        shift = step * np.eye(len(z))[k][:, None]
        above, below = (largest(searches, z + sign * shift) for sign in (1, -1))
        np.testing.assert_allclose(model.slopes[0, k], (above - below) / (2 * step), rtol=2e-5, atol=2e-5)
        moved = [build(searches, x, find_peaks(searches, Curves(searches, x))[0]) for x in (z + shift, z - shift)]
        bend = (moved[0].slopes[0] - moved[1].slopes[0]) / (2 * step)
        np.testing.assert_allclose(model.curvatures[0, k], bend, rtol=1e-4, atol=1e-3)


def test_a_constraint_without_hessian_does_not_depend_on_the_batch_size(monkeypatch):
    """The values above 500 are so high that constraints with Hessians have no derivatives."""
    searches, z = make_searches("hermite", ("curvature",))
    owner, zeros = np.array([0, 0, 1, 1]), np.zeros(4, int)
    value, fixed = np.array([600.0, 550.0, 0.02, -2.0]), np.array([False, True, False, True])
    peaks = Peaks(owner, np.array([0, 1, 0, 1]), zeros, np.linspace(0.3, 0.6, 4), value, fixed, fixed & False)
    with np.errstate(over="ignore"):
        together = build(searches, z, peaks)
        monkeypatch.setattr(tuning_model, "TOGETHER", 0)
        apart = build(searches, z, peaks)
    for x, y in zip(together, apart, strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-12, atol=1e-12)
    assert np.all(np.abs(together.slopes[1, :, :2]).max(axis=0) > 0)


@pytest.mark.parametrize("name", ["torsion", "angular_acceleration"])
def test_a_narrow_peak_is_not_missed(name):
    """Where the path is almost straight, the peak may lie between 20 001 samples."""
    searches, z = make_searches("hermite", (name,))
    dense = Curves(searches, z).values((name,), np.linspace(0.0, 1.0, 20001)[:, None], searches.order)[0]
    assert np.all(dense.max(axis=0) <= largest(searches, z) + 1e-6)


@pytest.mark.parametrize("objective", OBJECTIVES)
@pytest.mark.parametrize("motion", MOTIONS)
def test_the_derivatives_of_the_objectives_agree_with_jax(motion, objective):
    searches, z = make_searches(motion, ("curvature",), objective=objective)
    model = build(searches, z, find_peaks(searches, Curves(searches, z))[0])
    problem = jax.tree.map(lambda x: jnp.asarray(x[0]), searches.problem)
    with broadcasting():
        cost, x = jax.jit(lambda z: problem.cost(z)), jnp.asarray(z[:, 0])
        np.testing.assert_allclose(costs(searches, z)[0], cost(x), rtol=1e-12)
        np.testing.assert_allclose(model.slope[:, 0], jax.grad(cost)(x), rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(model.curvature[..., 0], jax.hessian(cost)(x), rtol=1e-9, atol=1e-9)
