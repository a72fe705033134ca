"""Paths, frames and boundary problems in NumPy and in JAX: the same values, and no compilation in NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.design import peaks
from qtraj.path.values import value

START = qt.BoundaryState([20, 0, 0], [0.1, 3, 1.0], [0.1, 0.2, 0])
END = qt.BoundaryState([0, 25, 5], [-3, 1.0, 0.2], [0, 0.1, 0.2])
HELIX = qt.SpiralHelix.hermite(START, END, 10.0)
PLACED = qt.SpiralHelix(HELIX.radius, HELIX.angle, HELIX.height, 10.0, qt.Placement([1, 2, 3], [1, 0.1, -0.2, 0.3]))
ROUTE = qt.Route.from_path(HELIX, 0.01)
STOPS = qt.Route(
    [0, 5, 8, 12],
    [[0, 0, 0], [10, 0, 1], [10, 0, 1], [5, 3, 1]],
    [[2, 0, 0], [0, 0, 0], [0, 0, 0], [-1, 1, 0]],
    np.zeros((4, 3)),
)
PATHS = {"helix": HELIX, "placed": PLACED, "route": ROUTE}
FRAMES = [qt.Natural(), qt.Upright(), qt.Upright([0.1, 0, 1]), qt.ThrustAligned(), qt.ThrustAligned(0.3)]
VEHICLE = qt.Vehicle(1000.0, [10, 20, 30], 0.5, 0.01, [1.0, 0.8])
TIMES = np.linspace(0.0, 10.0, 5)


def assert_equal(found, expected, tolerance=1e-9):
    leaves = zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True)
    for x, y in leaves:
        assert isinstance(x, np.ndarray | np.generic)
        assert isinstance(y, jax.Array)
        np.testing.assert_allclose(x, y, rtol=tolerance, atol=tolerance)


def of_path(path, t):
    """Everything that is computed of a path at one instant."""
    frames = [qt.trihedral(path, t, frame, axes="inertial") for frame in FRAMES]
    return frames, [frame.quaternion() for frame in frames], path.derivatives(t, 4), path.length()


@pytest.mark.parametrize("name", PATHS)
def test_trihedra_derivatives_and_lengths(name, compiled):
    path = PATHS[name]
    found = [of_path(path, t) for t in TIMES]
    assert not compiled
    expected = jax.jit(jax.vmap(of_path, (None, 0)))(path, TIMES)
    for k in range(len(TIMES)):
        assert_equal(found[k], jax.tree.map(lambda x: x[k], expected))  # noqa: B023


def test_a_frame_with_stops_and_reversals(compiled):
    frame = qt.Driving.along(STOPS)
    times = np.linspace(0.0, 12.0, 7)
    found = [qt.trihedral(STOPS, t, frame) for t in times]
    assert not compiled
    expected = jax.jit(jax.vmap(lambda t: qt.trihedral(STOPS, t, frame)))(times)
    for k in range(len(times)):
        assert_equal(found[k], jax.tree.map(lambda x: x[k], expected))  # noqa: B023


def test_values_and_gradients_of_quantities(compiled):
    def friction(position):
        start = qt.BoundaryState(position, START.velocity)
        path = qt.SpiralHelix.hermite(start, qt.BoundaryState(END.position, END.velocity), 10.0)
        return value(path, 3.0, "friction", VEHICLE.parameters()) + qt.trihedral(path, 2.0).torsion + path.length()

    position = np.array([20.0, 1.0, 0.5])
    found = friction(position)
    slopes = [(friction(position + h) - friction(position - h)) / 2e-5 for h in 1e-5 * np.eye(3)]
    assert not compiled
    expected, gradient = jax.jit(jax.value_and_grad(friction))(position)
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    np.testing.assert_allclose(slopes, gradient, rtol=1e-6, atol=1e-9)


def test_boundary_problems(compiled):
    first, last = qt.BoundaryState([20, 0, 0], [0.5, 4, 1.0]), qt.BoundaryState([0, 20, 3], [-4, 0.2, 1])
    problems = [
        lambda a, b: qt.SpiralHelix.from_boundary(a, b, turns=1),
        lambda a, b: qt.SpiralHelix.hermite(a, b, 10.0, turns=-1),
        lambda a, b: qt.SpiralHelix.between(a, b, 10.0),
    ]
    found = [solve(first, last) for solve in problems]
    assert not compiled
    for path, solve in zip(found, problems, strict=True):
        assert_equal(path, jax.jit(solve)(first, last))


def test_arc_lengths_and_the_nearest_point_of_a_route(compiled):
    found = ROUTE.length(), ROUTE.arc_length(4.0), ROUTE.time_at(12.0), ROUTE.nearest([1.0, 2, 3])
    assert not compiled
    expected = jax.jit(lambda r: (r.length(), r.arc_length(4.0), r.time_at(12.0), r.nearest([1.0, 2, 3])))(ROUTE)
    assert_equal(found, expected)


def test_evaluation_of_few_instants(compiled):
    outputs = ("position", "jerk", "dcm", "quaternion", "gibbs", "torsion", "force", "moment", "friction", "defined")

    def table(path, times):
        return qt.evaluate(path, times, outputs, vehicle=VEHICLE, axes="inertial", continuous=True).values

    paths = (PLACED, STOPS)
    found = [table(path, TIMES) for path in paths]
    assert not compiled
    for path, values in zip(paths, found, strict=True):
        frame = qt.Driving.along(path) if path is STOPS else None
        expected = jax.jit(
            lambda path, t, frame=frame: (
                qt.evaluate(path, t, outputs, frame, vehicle=VEHICLE, axes="inertial", continuous=True).values
            )
        )(path, TIMES)
        assert_equal(values, expected)


@pytest.mark.parametrize("name", ["curvature", "friction", "angular_acceleration"])
def test_peaks(name, compiled):
    road = VEHICLE.parameters()
    found = [qt.peak(path, name, VEHICLE) for path in PATHS.values()]
    assert not compiled
    for path, (time, largest) in zip(PATHS.values(), found, strict=True):
        assert largest >= peaks._compiled_peak(path, name, road)[1] * (1 - 1e-12)
        np.testing.assert_allclose(value(path, time, name, road), largest, rtol=1e-12)


def test_jax_arrays_stay_jax_arrays(compiled):
    path = jax.tree.map(jax.device_put, HELIX)
    compiled.clear()
    found = qt.trihedral(path, 3.0), path.length(), qt.evaluate(path, TIMES), qt.FrameProgram(path)(3.0)
    assert all(isinstance(x, jax.Array) for x in jax.tree.leaves(found[:2]))
    assert isinstance(found[2].curvature, jax.Array)
    assert isinstance(found[3].rate, jax.Array)
    assert not compiled


def test_a_path_given_as_a_function_is_computed_by_jax():
    curve = qt.Curve(lambda t: jnp.stack([jnp.cos(t), jnp.sin(t), 0.1 * t]), 2.0)
    assert isinstance(qt.trihedral(curve, 1.0).tangent, jax.Array)
