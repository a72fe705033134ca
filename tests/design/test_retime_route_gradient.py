"""Derivatives of the fastest timing with respect to the states of the joints of a route."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.design.solve.convex import begun, continued, solve
from qtraj.design.timing import rounds, search
from qtraj.design.timing.constraint_values import tightened
from qtraj.design.timing.grid import of_segments
from qtraj.design.timing.initial import initial
from qtraj.design.timing.program import duration
from qtraj.design.timing.tables import tables

TIMES = np.array([0.0, 2.1, 3.9, 6.0])
STATES = np.array(
    [
        [[-12.0, 0, 0], [0, 0.5, 0], [10, 3, 1], [18, 9, 0.5]],
        [[6.0, 0.3, 0], [6, 1, 0.1], [5, 3, 0.2], [3, 5, 0.2]],
        [[0.0, 0, 0], [0.1, 0.4, 0], [-0.4, 0.8, 0.1], [0, 0.2, 0]],
    ]
)
LIMITS = {"speed": 7.0, "lateral_acceleration": 2.0, "longitudinal_acceleration": 1.5}
GAP, STEP = 1e-10, 1e-5
DIRECTION = np.random.default_rng(3).normal(size=STATES.shape)


def timed(states, knots=64, **limits):
    return qt.retime(qt.Route(TIMES, *states), qt.Limits(**(limits or LIMITS)), knots=knots)


TABLES = tables(of_segments(TIMES, 0, 64, (False, False)), (False, False), False, np.full(63, 2))


def imposed(states, limits):
    bounds = {name: np.asarray(x) for name, x in limits.items()}
    route = qt.Route(TIMES, *states)
    return search._imposed(search.Problem(route, TIMES[0], TIMES[-1], bounds, np.full(2, np.inf)), TABLES)


def shortest(states, limits, factors):
    """The minimum duration, and the coefficients, with the limits at the nodes tightened by given factors."""
    program = imposed(states, limits)[0]
    program = program._replace(constraints=tightened(program.constraints, rounds.at_nodes(factors)))
    own = jax.tree.map(lambda x: x[..., None, :, :], program[1:])  # a batch of one problem
    program = program.__class__(program.nodes, *own)
    first = solve(program, begun(program, initial(program)), np.full(1, rounds.GAPS[0]))
    found = solve(program, continued(program, first), np.full(1, GAP))
    return np.append(duration(program, program.at_nodes(found.z)), found.z[0])


@pytest.mark.parametrize("limits", [LIMITS, {"speed": 7.0, "acceleration": 2.5, "jerk": 6.0}], ids=["convex", "jerk"])
def test_derivatives_agree_with_finite_differences(limits):
    """The derivatives are exact for the factors of the last search."""
    given = jax.tree.map(lambda x: x[None], [x if k else x[1:] for k, x in enumerate(imposed(STATES, limits))])
    found = rounds.Result(*(x[0] for x in rounds.searched(TABLES, np.zeros(2, bool), None, *given)))

    def differentiable(x):
        coefficients, change = search._differentiable(imposed(STATES + x * DIRECTION, limits)[0], found)
        return jnp.append(change, coefficients)

    exact = jax.jacfwd(differentiable)(0.0)
    after, before = (shortest(STATES + x * DIRECTION, limits, found.used) for x in (STEP, -STEP))
    differences = (after - before) / (2 * STEP)
    assert abs(differences[0]) > 0.1
    assert float(exact[0]) == pytest.approx(differences[0], rel=1e-6)
    np.testing.assert_allclose(exact[1:], differences[1:], rtol=1e-4, atol=1e-4 * np.abs(differences[1:]).max())
    assert float(jax.grad(lambda x: differentiable(x)[0])(0.0)) == pytest.approx(float(exact[0]), rel=1e-9)


def test_the_duration_grows_with_the_root_of_the_size():
    """With a limit on the lateral acceleration only, the duration is proportional to the root of the length."""
    value, slope = jax.value_and_grad(lambda x: timed(STATES * x, lateral_acceleration=2.0).duration)(1.0)
    assert float(slope) == pytest.approx(float(value) / 2, rel=1e-4)


def test_a_displaced_or_turned_route_takes_the_same_time():
    slope = np.asarray(jax.grad(lambda x: timed(x).duration)(jnp.asarray(STATES)))
    size = np.linalg.norm(slope[0])
    assert size > 0.1
    np.testing.assert_allclose(slope[0].sum(axis=0), 0.0, atol=1e-6 * size)
    turning = np.cross(STATES.reshape(-1, 3), slope.reshape(-1, 3)).sum(axis=0)
    np.testing.assert_allclose(turning, 0.0, atol=1e-4 * size)


@pytest.mark.slow
def test_forward_and_reverse_derivatives_of_the_path_agree():
    def along(x):
        return timed(STATES + x * DIRECTION).path.position(2.0)[0]

    forward, reverse = jax.jacfwd(along)(0.0), jax.grad(along)(0.0)
    assert float(reverse) == pytest.approx(float(forward), rel=1e-8)
    assert abs(float(forward)) > 0.1


def test_a_drive_with_a_stop_is_differentiable():
    """Two drives with a stop between them; only the second one becomes longer, in the direction of travel."""
    times = [0.0, 3, 8, 11]
    position = np.array([[-12.0, 0, 0], [0, 0, 0], [0, 0, 0], [12, 0, 0]])
    velocity = np.array([[0.0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]])
    limits = qt.Limits(speed=50.0, longitudinal_acceleration=2.0)

    def shortest_time(x):
        route = qt.Route(times, position + x * np.outer([0.0, 0, 0, 1], [1.0, 0, 0]), velocity, 0 * velocity)
        return qt.retime(route, limits, knots=128).duration

    value, slope = jax.value_and_grad(shortest_time)(0.0)
    assert float(value) == pytest.approx(5 + 2 * 2 * np.sqrt(12 / 2), rel=2e-2)
    assert float(slope) == pytest.approx(np.sqrt(12 / 2) / 12, rel=3e-2)


def test_what_has_no_derivative_is_refused():
    with pytest.raises(ValueError, match="no derivatives with respect to the times"):
        jax.grad(lambda x: qt.retime(qt.Route(TIMES * x, *STATES), qt.Limits(**LIMITS)).duration)(1.0)
    with pytest.raises(ValueError, match="outside jit and vmap"):
        jax.jit(lambda x: timed(STATES * x).duration)(1.0)
