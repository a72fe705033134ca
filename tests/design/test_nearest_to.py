"""The objective "nearest" to a path: the mean squared distance at equal fractions of the arc lengths."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.algebra.jets import Jet, variables
from qtraj.design.tuning.motions.registry import MOTIONS
from qtraj.design.tuning.objectives.nearest_to import NearestTo, quadrature
from qtraj.design.tuning.problem import pose
from qtraj.design.tuning.searches import searches_of
from qtraj.path.equal_arcs import equal_arcs

START = qt.BoundaryState([20.0, 0.0, 0.0], [1.0, 7.0, 0.3])
END = qt.BoundaryState([0.0, 28.0, 1.5], [-9.8, -1.0, 0.1])
DURATION = 4.6
LIMITS = qt.Limits(curvature=0.048)

initial = qt.SpiralHelix.hermite(START, END, DURATION)


def retimed(path, power=1.0):
    """The same shape with another timing, as a `Curve`."""

    def share(u):
        return u + power * u * (1 - u) * (0.3 + 0.2 * u)

    return qt.Curve(lambda t: path.position(path.duration * share(t / 3.0)), 3.0)


def by_definition(path, other, count=2000):
    """The mean of the squared distances at the middles of equal fractions of the arc length, by other quadrature."""

    def points(path):
        t = np.linspace(0.0, float(path.duration), 40001)
        r = np.asarray(path.sampled(jnp.asarray(t), 0)[0])
        chords = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(r, axis=0), axis=1))])
        wanted = (np.arange(count) + 0.5) / count * chords[-1]
        return np.stack([np.interp(wanted, chords, r[:, k]) for k in range(3)], axis=1)

    return np.mean(np.sum((points(path) - points(other)) ** 2, axis=1))


def tuned(path=initial, limits=LIMITS, **options):
    settings = {"motion": "hermite", "duration": DURATION, "fixed": ["duration"], "starts": 1} | options
    return qt.tune(START, END, limits, nearest_to=path, **settings)


def test_the_objective_is_the_one_defined():
    best = tuned()
    assert best.status == "converged", best.result
    assert best.certificate.holds
    assert float(best.objective) == pytest.approx(by_definition(best.path, initial), rel=1e-5)
    assert float(best.objective) > 0.01


def test_no_other_path_is_nearer():
    """Perturbed velocities with the same limit satisfied are never nearer."""
    best = tuned()
    random, nearer, admissible = np.random.default_rng(5), 0, 0
    for _ in range(100):
        change = 0.1 * random.standard_normal((2, 3))
        ends = zip((best.start, best.end), change, strict=True)
        states = [qt.BoundaryState(state.position, state.velocity + d) for state, d in ends]
        path = qt.SpiralHelix.hermite(*states, DURATION)
        if float(qt.peak(path, "curvature")[1]) <= 0.048:
            admissible += 1
            nearer += by_definition(path, initial, 400) < float(best.objective) - 1e-6
    assert admissible > 10
    assert nearer == 0


def test_the_timing_of_the_given_path_does_not_matter():
    reference = tuned()
    for other in (retimed(initial), retimed(initial, -1.0), qt.Route.from_path(initial, 1e-7)):
        best = tuned(other)
        assert best.status == "converged", best.result
        np.testing.assert_allclose(best.path.radius, reference.path.radius, rtol=1e-5)
        assert float(best.objective) == pytest.approx(float(reference.objective), rel=1e-5)


def test_a_shape_that_satisfies_the_limits_is_kept():
    """A slower drive along the given path, within a limit that its own timing violates."""
    limits = qt.Limits(lateral_acceleration=2.0, curvature=0.1)
    best = qt.tune(START, END, limits, nearest_to=initial, motion="hermite", duration=DURATION)
    assert best.status == "converged", best.result
    assert float(best.path.duration) > DURATION
    assert float(best.objective) < 1e-10
    np.testing.assert_allclose(equal_arcs(best.path, 8), equal_arcs(initial, 8), atol=1e-4)


def test_placements_do_not_matter():
    origin = np.array([500.0, -300.0, 20.0])
    start, end = (qt.BoundaryState(s.position + origin, s.velocity) for s in (START, END))
    moved = qt.SpiralHelix.hermite(*(qt.BoundaryState(s.position, s.velocity) for s in (START, END)), DURATION)
    moved = qt.SpiralHelix(moved.radius, moved.angle, moved.height, DURATION, qt.Placement(origin))
    options = {"motion": "hermite", "duration": DURATION, "fixed": ["duration"], "starts": 1}
    best = qt.tune(start, end, LIMITS, nearest_to=moved, placement=qt.Placement(origin), **options)
    np.testing.assert_allclose(best.path.radius, tuned().path.radius, rtol=1e-7)


@pytest.mark.parametrize("motion", ["uniform", "hermite"])
def test_jets_agree_with_jax(motion):
    """Value, gradient and Hessian of the formula, which NumPy and JAX share."""
    problem = pose(START, END, NearestTo(retimed(initial)), MOTIONS[motion], None, 0, None)
    z = 0.1 * np.random.default_rng(1).standard_normal(problem.size)
    both = jax.value_and_grad(problem.cost)
    (value, slope), (_, hessian) = jax.jit(lambda z: (both(z), jax.jacfwd(both)(z)))(jnp.asarray(z))
    batch = jax.tree.map(lambda x: np.asarray(x)[None], problem)
    bounds = np.ones((1, problem.size))
    jet = searches_of(batch, {}, -bounds, bounds).formulas.cost(variables(z[:, None]))
    assert isinstance(jet, Jet)
    np.testing.assert_allclose(jet.value[0], value, rtol=1e-12)
    np.testing.assert_allclose(jet.gradient[:, 0], slope, rtol=1e-10, atol=1e-11)
    np.testing.assert_allclose(jet.hessian[..., 0], hessian, rtol=1e-8, atol=1e-9)


def test_integrals_to_the_nodes():
    nodes, weights, matrix = quadrature()
    for power in range(8):
        np.testing.assert_allclose(matrix @ nodes**power, nodes ** (power + 1) / (power + 1), atol=1e-14)
        assert weights @ nodes**power == pytest.approx(1 / (power + 1), abs=1e-14)


@pytest.mark.slow
def test_lbfgs_agrees_with_sqp():
    best, reference = tuned(method="lbfgs"), tuned()
    assert best.converged, best.result
    assert float(best.objective) == pytest.approx(float(reference.objective), rel=1e-5)


@pytest.mark.slow
def test_the_derivative_with_respect_to_the_given_path():
    def radial(angular):
        start = qt.BoundaryState(START.position, jnp.asarray([1.0, angular, 0.3]))
        return tuned(qt.SpiralHelix.hermite(start, END, DURATION)).start.velocity[0]

    slope, step = float(jax.grad(radial)(7.0)), 1e-3
    expected = (float(radial(7.0 + step)) - float(radial(7.0 - step))) / (2 * step)
    assert abs(expected) > 1e-3
    assert slope == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize(
    ("options", "fragment"),
    [
        ({"objective": "fastest"}, "nearest_to belongs to objective='nearest', but the objective is 'fastest'"),
        ({"weights": {"end.V_h": 2.0}}, "weights apply to objective='nearest'"),
        ({"nearest_to": 3.0}, "path must be a path"),
        ({"nearest_to": jax.tree.map(lambda x: np.nan * x, initial)}, "a path with finite positions"),
        ({"nearest_to": jax.tree.map(lambda x: jnp.stack([x, x]), initial)}, "nearest_to must be one path"),
    ],
)
def test_invalid_arguments(options, fragment):
    with pytest.raises(ValueError, match=fragment):
        qt.tune(START, END, LIMITS, **({"nearest_to": initial} | options))
