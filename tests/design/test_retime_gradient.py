"""Derivatives of the minimum duration against finite differences of the problem that the last search solves."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.design.timing import search
from qtraj.design.timing.constraints import NAMES, tightened
from qtraj.design.timing.grid import uniform
from qtraj.design.timing.initial import initial
from qtraj.design.timing.interior_point import begun, continued, duration, solve
from qtraj.design.timing.spline import at_nodes

OWN = ("speed", "lateral_acceleration", "longitudinal_acceleration", "jerk")
CELLS, GAP, STEP = 64, 1e-10, 3e-5
PATH = qt.SpiralHelix.hermite(
    qt.BoundaryState([30.0, 0, 0], [0, 10.0, 1]), qt.BoundaryState([0, 45.0, 8], [-12.0, 2, 0]), 6.0
)
TABLES = search.tables(uniform(CELLS), (True, False))


def problem(values):
    """From rest to half the own speed of the path, with the limits `values` on `OWN`."""
    bounds = {name: jnp.asarray(np.inf) for name in NAMES} | dict(zip(OWN, values, strict=True))
    return search.Problem(PATH, jnp.asarray(0.0), PATH.duration, bounds, jnp.array([np.inf, 0.25]))


@jax.jit
def shortest(values, factors):
    """The minimum duration with the limits at the nodes tightened by given factors, to a small duality gap."""
    program = search._imposed(problem(values), TABLES)[0]
    program = program._replace(constraints=tightened(program.constraints, search._at_nodes(factors)))
    first = solve(program, begun(program, initial(program)), jnp.asarray(search.GAPS[0]))
    found = solve(program, continued(program, first), jnp.asarray(GAP))
    return duration(program, at_nodes(program.nodes, found.coefficients))


@pytest.mark.parametrize("values", [(20.0, 3.0, 2.5, 2.0), (9.0, 3.0, 2.5, 2.0)])
def test_derivatives_in_the_limits_agree_with_finite_differences(values):
    """The envelope theorem: the derivatives are exact for the factors of the last search, with every kind of limit.

    The step is small, because the derivatives change where a node becomes active.
    """
    at = np.array(values)
    program, places = search._imposed(problem(at), TABLES)
    found = search._searched(program, places, TABLES.within)
    exact = jax.grad(lambda v: search._sensitivity(search._imposed(problem(v), TABLES)[0], found))(jnp.asarray(at))
    pairs = [(shortest(at + d, found.used), shortest(at - d, found.used)) for d in STEP * np.diag(at)]
    slopes = np.array([float(a - b) for a, b in pairs]) / (2 * STEP * at)
    assert np.count_nonzero(slopes < -0.01) >= 3
    assert exact == pytest.approx(slopes, rel=1e-6, abs=1e-7)


def test_the_derivative_is_accurate_with_many_cells():
    """With a limit on the lateral acceleration only, the duration is proportional to its power −1/2."""
    lateral = 3.0

    def shortest_time(value):
        return qt.retime(PATH, qt.Limits(lateral_acceleration=value), knots=2048).duration

    found, slope = jax.value_and_grad(shortest_time)(lateral)
    assert slope == pytest.approx(-float(found) / (2 * lateral), rel=1e-6)
