"""Derivatives of the fastest timing against finite differences, also of the problem that the last search solves."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.design.solve.convex import begun, continued, solve
from qtraj.design.timing import rounds, search
from qtraj.design.timing.constraint_values import tightened
from qtraj.design.timing.constraints import NAMES
from qtraj.design.timing.grid import uniform
from qtraj.design.timing.initial import initial
from qtraj.design.timing.program import duration
from qtraj.design.timing.road import LOADS
from qtraj.design.timing.sided import SLOWEST
from qtraj.design.timing.tables import tables
from qtraj.path.quantity import quantity

OWN = ("speed", "lateral_acceleration", "longitudinal_acceleration", "jerk")
CELLS, GAP, STEP = 64, 1e-10, 3e-5
PATH = qt.SpiralHelix.hermite(
    qt.BoundaryState([30.0, 0, 0], [0, 10.0, 1]), qt.BoundaryState([0, 45.0, 8], [-12.0, 2, 0]), 6.0
)
TABLES = tables(uniform(CELLS), (True, False))


def problem(values):
    """From rest to half the own speed of the path, with the limits `values` on `OWN`."""
    absent = {
        name: np.asarray(-np.inf if quantity(name).lower else np.inf) for name in NAMES if name not in (SLOWEST, *LOADS)
    }
    bounds = absent | dict(zip(OWN, values, strict=True))
    return search.Problem(PATH, np.zeros(()), np.asarray(PATH.duration), bounds, np.array([np.inf, 0.25]))


def shortest(values, factors):
    """The fastest timing with the limits at the nodes tightened by given factors, to a small duality gap.

    Returns the minimum duration and the coefficients.
    """
    program = search._imposed(problem(values), TABLES)[0]
    program = program._replace(constraints=tightened(program.constraints, rounds.at_nodes(factors)))
    own = jax.tree.map(lambda x: x[..., None, :, :], program[1:])  # a batch of one problem
    program = program.__class__(program.nodes, *own)
    first = solve(program, begun(program, initial(program)), np.full(1, rounds.GAPS[0]))
    found = solve(program, continued(program, first), np.full(1, GAP))
    return duration(program, program.at_nodes(found.z)), found.z[0]


@pytest.mark.parametrize("values", [(20.0, 3.0, 2.5, 2.0), (9.0, 3.0, 2.5, 2.0)])
def test_derivatives_in_the_limits_agree_with_finite_differences(values):
    """The derivatives are exact for the factors of the last search, with every kind of limit.

    The step is small, because the derivatives change where a node becomes active.
    """
    at = np.array(values)
    given = jax.tree.map(
        lambda x: x[None], [x if k else x[1:] for k, x in enumerate(search._imposed(problem(at), TABLES))]
    )
    found = rounds.Result(*(x[0] for x in rounds.searched(TABLES, np.zeros(2, bool), None, *given)))

    def differentiable(v):
        return search._differentiable(search._imposed(problem(v), TABLES)[0], found)

    exact = jax.jit(jax.grad(lambda v: differentiable(v)[1]))(jnp.asarray(at))
    pairs = [(shortest(at + d, found.used), shortest(at - d, found.used)) for d in STEP * np.diag(at)]
    slopes, of_timing = (np.array([np.asarray(a[k] - b[k]) for a, b in pairs]).T / (2 * STEP * at) for k in range(2))
    assert np.count_nonzero(slopes < -0.01) >= 3
    assert exact == pytest.approx(slopes, rel=1e-6, abs=1e-7)
    timing = jax.jit(jax.jacfwd(lambda v: differentiable(v)[0]))(jnp.asarray(at))
    np.testing.assert_allclose(timing, of_timing, rtol=1e-4, atol=1e-4 * np.abs(of_timing).max())


def test_the_derivative_is_accurate_with_many_cells():
    """With a limit on the lateral acceleration only, the duration is proportional to its power −1/2."""
    lateral = 3.0

    def shortest_time(value):
        return qt.retime(PATH, qt.Limits(lateral_acceleration=value), knots=2048).duration

    found, slope = jax.value_and_grad(shortest_time)(lateral)
    assert slope == pytest.approx(-float(found) / (2 * lateral), rel=1e-6)


def test_quantities_along_the_path_are_differentiable():
    """With a limit x on the lateral acceleration only, the motion at the time t is the motion for x = 1 at t√x."""
    lateral = 3.0

    def along(x):
        timed = qt.retime(PATH, qt.Limits(lateral_acceleration=lateral * x), knots=CELLS)
        path = timed.path
        motion = path.position(1.0), path.velocity(1.0)
        return jnp.concatenate([*motion, timed.speeds, jnp.stack([path.duration, timed.duration])])

    path = qt.retime(PATH, qt.Limits(lateral_acceleration=lateral), knots=CELLS).path
    (value, forward), reverse = jax.jit(lambda x: (jax.jvp(along, (x,), (1.0,)), jax.jacrev(along)(x)))(1.0)
    velocity = path.velocity(1.0)
    exact = jnp.concatenate([velocity, velocity + path.acceleration(1.0), value[6:8], -value[8:]]) / 2
    np.testing.assert_allclose(forward, exact, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(reverse, forward, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("second", [lambda f: jax.jacrev(jax.jacrev(f)), lambda f: jax.jacfwd(jax.jacfwd(f))])
def test_second_derivatives(second):
    """With a limit x on the lateral acceleration only, the duration T is proportional to 1/√x, so T″ = ¾ T at x = 1."""

    def durations(x):
        timed = qt.retime(PATH, qt.Limits(lateral_acceleration=3.0 * x), knots=CELLS)
        return jnp.stack([timed.duration, timed.path.duration])

    np.testing.assert_allclose(second(durations)(1.0), 0.75 * durations(1.0), rtol=1e-4)


TRUCK = qt.Vehicle(12e3, None, 6.0, 0.007, (0.6, 0.5), 0.05)
WIDE = qt.SpiralHelix([20.0, 1.0, 0.3, -0.05], [0.2, 0.35, 0.02, -0.004], [1.0, 0.4, 0.05, -0.01], 4.5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("limits", "speed"),
    [
        (lambda x: qt.Limits(speed=12.0, lateral_acceleration=3.0 * x, longitudinal_acceleration=2.0 * x), 0.0),
        (lambda x: qt.Limits(speed=12.0, friction=0.5 * x, power=60e3 * x, vehicle=TRUCK), 3.0),
    ],
    ids=["rest", "road"],
)
def test_positions_agree_with_finite_differences(limits, speed):
    """The search tightens no limit here, so finite differences of the whole computation are accurate."""

    def along(x):
        path = qt.retime(WIDE, limits(x), speed, speed, knots=512).path  # chosen cells would change with x
        return jnp.append(path.position(1.0), path.duration)

    differences = (along(1.0 + STEP) - along(1.0 - STEP)) / (2 * STEP)
    np.testing.assert_allclose(jax.jacrev(along)(1.0), differences, rtol=1e-5, atol=1e-6)


def test_the_timing_is_differentiable_in_the_path_and_in_batches():
    """A path with another unit of time has the same fastest timing; a larger path needs more time."""

    def along(scale, unit):
        path = qt.SpiralHelix(scale * PATH.radius, PATH.angle, scale * PATH.height, PATH.duration)
        shorter = qt.SpiralHelix(
            *(c * unit ** -jnp.arange(4.0) for c in (path.radius, path.angle, path.height)), unit * PATH.duration
        )
        timed = qt.retime(shorter, qt.Limits(speed=9.0, lateral_acceleration=3.0), 3.0, 3.0, knots=CELLS)
        return timed.path.position(1.0)[1], timed.path.duration

    (by_scale, by_unit), (slower, same) = jax.jacfwd(along, (0, 1))(1.0, 1.0)
    assert abs(float(by_unit)) < 1e-6 * abs(float(by_scale))
    assert abs(float(same)) < 1e-6 * float(slower)
    batch = jax.vmap(jax.grad(lambda scale: along(scale, 1.0)[1]))(jnp.asarray([1.0, 1.1]))
    assert float(batch[0]) == pytest.approx(float(slower), rel=1e-6)
    assert np.all(np.isfinite(batch))


def test_the_duration_of_a_drive_with_a_stop_is_differentiable():
    """The search tightens limits beside the stop, so differences of the whole computation are only close."""
    position = [[-12.0, -0.6, -0.2], [0, 0, 0], [0, 0, 0], [12, 1, 1]]
    velocity = [[6.0, 0.3, 0.1], [0, 0, 0], [0, 0, 0], [6, 0.8, 0.2]]
    route = qt.Route([0.0, 3, 8, 11], position, velocity, np.zeros((4, 3)))

    def shortest_time(x):
        return qt.retime(route, qt.Limits(speed=7.0, acceleration=2.0 * x), knots=CELLS).duration

    slope, step = float(jax.grad(shortest_time)(1.0)), 1e-3
    difference = (float(shortest_time(1 + step)) - float(shortest_time(1 - step))) / (2 * step)
    assert slope == pytest.approx(difference, rel=2e-3)


def timing(factor, rest):
    """The timing u̇² = k(1 − u), which ends at rest, or u̇² = ku, which starts at rest; 0 ≤ u ≤ 1."""
    coefficients = {"end": [factor, -factor], "start": [0 * factor, factor]}[rest]
    powers = jnp.stack([*coefficients, 0 * factor, 0 * factor])
    return qt.Timing(powers[None], jnp.array([0.0, 1.0]), (rest == "start", rest == "end"))


CLOSED = {
    "end": lambda k, t: (jnp.sqrt(k) * t - k * t**2 / 4, jnp.sqrt(k) - k * t / 2),
    "start": lambda k, t: (k * t**2 / 4, k * t / 2),
}


def slope(function):
    """The derivatives with respect to both arguments."""
    both = jax.jit(jax.jacfwd(function, (0, 1)))
    return lambda k, t: jnp.stack(both(k, t))


@functools.cache
def derivatives_of_motion(rest):
    """The motions (found, exact) as functions of the factor and the time, and three derivatives of them, compiled."""
    found, exact = lambda k, t: jnp.stack(timing(k, rest).motion(t)), lambda k, t: jnp.stack(CLOSED[rest](k, t))
    functions = [(jax.jit(found), jax.jit(exact))]
    for _ in range(3):
        functions.append(tuple(map(slope, functions[-1])))
    return functions


@pytest.mark.parametrize("rest", CLOSED)
@pytest.mark.parametrize("place", [0.0, 0.6, 1.0])
def test_three_derivatives_of_the_motion_near_rest(rest, place):
    """The parameter and its rate at a fixed time, which may be the very end, against closed forms."""
    at = jnp.asarray(1.0), jnp.asarray(place * timing(jnp.asarray(1.0), rest).duration)
    for found, exact in derivatives_of_motion(rest):
        np.testing.assert_allclose(found(*at), exact(*at), atol=1e-12)


@pytest.mark.parametrize("rest", CLOSED)
def test_velocity_and_acceleration_agree_at_rest(rest):
    path = qt.RetimedPath(PATH, timing(jnp.asarray(1.0), rest))
    time = 0.0 if rest == "start" else float(path.duration)
    for order in (1, 2):
        expected = path.derivatives(time, order + 1)[order + 1]
        found = jax.jit(jax.jacfwd(lambda t, order=order: path.derivatives(t, order)[order]))(time)
        np.testing.assert_allclose(found, expected, atol=1e-12)
    assert np.linalg.norm(path.acceleration(time)) > 0.1


def test_the_ends_at_rest_do_not_depend_on_the_unit_of_time():
    """The state at both ends at rest, whatever the duration of the original path."""

    def ends(unit):
        shape = (c * unit ** -jnp.arange(4.0) for c in (PATH.radius, PATH.angle, PATH.height))
        path = qt.SpiralHelix(*shape, unit * PATH.duration)
        timed = qt.retime(path, qt.Limits(speed=9.0, acceleration=3.0), 0.0, 0.0, knots=CELLS).path
        times = jnp.stack([jnp.zeros_like(timed.duration), timed.duration])
        return jax.vmap(timed.position)(times), jax.vmap(timed.velocity)(times), jax.vmap(timed.acceleration)(times)

    for change in jax.jit(lambda x: jax.jvp(ends, (x,), (1.0,))[1])(1.0):
        np.testing.assert_allclose(change, 0.0, atol=1e-5)
