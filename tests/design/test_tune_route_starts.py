"""`tune_route` from many starts: what one start misses, the same problem in JAX, and wrong arguments."""

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from tests.design.test_tune_obstacles import straight

import qtraj as qt
from qtraj.design.tuning.problem import broadcasting
from qtraj.design.tuning_route import many_starts
from qtraj.design.tuning_route.constraints import bounds, values
from qtraj.design.tuning_route.problem import objective, segments

BALLS = [qt.Ball([20.0, 0.7, 0.0], 1.0), qt.Ball([30.0, 0.7, 0.0], 1.0), qt.Ball([40.0, -0.15, 0.0], 1.0)]
"""Both sides of the first two are tried; the nearer side of the third one leads to a slalom."""

LIMITS = qt.Limits(speed=9.0, keep_out=BALLS)


class PosedError(Exception):
    """Raised instead of a search, with its problem."""


def problem_of(monkeypatch, route, limits, **more):
    def refuse(problem, *_):
        raise PosedError(problem)

    with monkeypatch.context() as patch:
        patch.setattr(many_starts.Many, "begins", lambda self, problem: refuse(problem))
        with pytest.raises(PosedError) as caught:
            qt.tune_route(route, limits, **more)
    return caught.value.args[0]


@pytest.mark.slow
@pytest.mark.parametrize("more", [{"starts": 4}, {"starts": 12, "method": optax.adam(1e-2)}], ids=["random", "adam"])
def test_more_starts_find_the_way_on_one_side(more):
    """All obstacles are passed on the right, which is far better than the slalom of the usual starts."""
    one = qt.tune_route(straight(7), LIMITS, tube=3.0, max_steps=60)
    best = qt.tune_route(straight(7), LIMITS, tube=3.0, max_steps=150, **more)
    assert best.converged, best.result
    assert qt.certify(best.path, LIMITS).holds
    assert float(best.objective) < 0.6 * float(one.objective)
    y = np.asarray(qt.evaluate(best.path, np.linspace(0, float(best.path.duration), 301)).position)[:, 1]
    assert y.max() < 0.1


@pytest.mark.parametrize("closed", [False, True])
def test_first_steps_see_the_problem_of_the_search(monkeypatch, closed):
    """Objective and constraints in JAX are those in NumPy; obstacles, a road and a closed route included."""
    if closed:
        t = np.linspace(0, 24, 9)
        circle = [
            np.stack([np.cos(t * np.pi / 12 + a), np.sin(t * np.pi / 12 + a), 0 * t], 1) for a in (0, np.pi / 2, np.pi)
        ]
        route = qt.Route(t, *(20 * (np.pi / 12) ** k * x for k, x in enumerate(circle)))
        limits = qt.Limits(speed=5.0, curvature=0.08, keep_out=[qt.Ball([20.3, 0.0, 0.0], 1.0)])
    else:
        route, limits = straight(7), qt.Limits(speed=4.0, curvature=0.2, keep_out=BALLS)
    problem = problem_of(monkeypatch, route, limits, tube=3.0, closed=closed)
    z = many_starts.random_starts(problem, 3)[2]
    s = segments(problem, many_starts.repeated(problem, z))
    with broadcasting():
        cost, g = many_starts._evaluated(problem, jnp.asarray(z))
    assert float(cost) == pytest.approx(float(objective(problem, s)), rel=1e-12)
    found, count = values(problem, s), len(problem.clear)
    ratio = 0.5 * np.log(np.maximum(found, many_starts.LEAST))
    limited = len(problem.names) - count
    expected = [ratio[k][problem.used[k]] for k in (*range(limited), -2, -1)]
    expected += [(found - 1)[k][problem.used[k]] for k in range(limited, limited + count)]
    expected.append(bounds(problem, s)[:, problem.moving > 0].ravel())
    assert count
    assert problem.used[limited : limited + count].any()
    np.testing.assert_allclose(g, np.concatenate(expected), rtol=1e-9, atol=1e-12)


def test_random_starts_are_within_the_tube_and_keep_what_is_fixed(monkeypatch):
    problem = problem_of(monkeypatch, straight(7), LIMITS, tube=3.0)
    z = many_starts.random_starts(problem, 20)
    assert np.all(z[:, ~problem.free] == 0)
    away = np.array([values(problem, segments(problem, x))[-2:].max() for x in z])
    assert 0.04 < away.min() < away.max() < 1.0
    assert np.ptp(z[:, 3, 1]) > 1.0, "both sides"


def test_first_steps_leave_an_obstacle(monkeypatch):
    """Starts close to the route enter the obstacle deeply, and the final points almost do not."""
    limits = qt.Limits(speed=7.0, keep_out=BALLS[:1])
    problem = problem_of(monkeypatch, straight(5), limits, tube=3.0)
    begins = 0.02 * many_starts.random_starts(problem, 6)
    optimiser = optax.with_extra_args_support(optax.adam(1e-2))
    after = many_starts.first_steps(problem, begins, optimiser, steps=300)
    before, found = ([values(problem, segments(problem, z)).max() for z in x] for x in (begins, after))
    assert min(before) > 1.4
    assert len(found) == many_starts.REFINED
    assert max(found) < 1.1
    assert np.all(after[:, ~problem.free] == 0)


@pytest.mark.slow
def test_more_starts_do_no_harm_where_one_is_enough():
    limits = qt.Limits(speed=7.0, keep_out=BALLS[:1])
    one, more = (qt.tune_route(straight(5), limits, tube=3.0, starts=n) for n in (1, 2))
    assert more.converged, more.result
    assert float(more.objective) <= float(one.objective) * (1 + 1e-6)


@pytest.mark.slow
def test_it_is_the_same_search_inside_jit():
    def tuned(speed):
        return qt.tune_route(straight(5), qt.Limits(speed=speed), tube=1.0, objective="fastest", starts=2).objective

    assert float(jax.jit(tuned)(5.5)) == pytest.approx(float(tuned(5.5)), rel=1e-9)


@pytest.mark.parametrize(
    ("change", "fragment"),
    [
        ({"starts": 0}, "starts must be an integer, 1 or more, but 0 was given"),
        ({"starts": 2.5}, "starts must be an integer, 1 or more, but 2.5 was given"),
        ({"starts": True}, "but True was given"),
        ({"method": "sqp", "starts": 8}, "'interior_point', 'lbfgs' or 'adam', or an optax optimiser"),
        ({"method": 3, "starts": 8}, "but 3 was given"),
        ({"method": optax.adam(1e-2)}, "pass starts=64, for example, or omit method"),
    ],
)
def test_wrong_arguments_are_named(change, fragment):
    with pytest.raises(ValueError) as caught:
        qt.tune_route(straight(), LIMITS, **change)
    assert fragment in str(caught.value)


def test_obstacles_that_move_are_refused_by_the_first_steps():
    """Before any search, and for a route that would satisfy the limits without one."""
    limits = qt.Limits(speed=9.0, keep_out=[qt.Ball([[20.0, 50.0, 0.0], [0.0, 0.1, 0.0]], 1.0)])
    with pytest.raises(ValueError, match="do not support obstacles that move: omit method"):
        qt.tune_route(straight(7), limits, tube=3.0, starts=8, method=optax.adam(1e-2))
