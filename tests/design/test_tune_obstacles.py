"""`tune_route` keeps a body clear of obstacles, on the better side."""

import numpy as np
import pytest
from tests.design.route_derivatives import compare_with_automatic

import qtraj as qt
from qtraj.design.obstacles.clear import clears
from qtraj.design.tuning_route import around, setup
from qtraj.design.tuning_route.program import RouteProgram

CAR = [(0.0, 0.5), (2.0, 0.5)]


def straight(count=5, length=10.0):
    """A straight route along x at 5 m/s."""
    x = length * np.arange(count)
    zero = np.zeros(count)
    states = [np.stack([v, zero, zero], axis=1) for v in (x, zero + 5.0, zero)]
    return qt.Route(x / 5.0, *states)


OBSTACLES = {
    "ball": qt.Ball([20.0, 0.3, 0.0], 1.0),
    "cylinder": qt.Cylinder([20.0, 0.3, 0.0], [0.0, 0.0, 1.0], 1.0),
    "ellipsoid": qt.Ellipsoid([20.0, 0.3, 0.0], [2.0, 1.0, 1.0]),
    "polygon": qt.ConvexPolygon([[19.0, -0.7], [21.0, -0.7], [21.0, 1.3], [19.0, 1.3]]),
}


@pytest.mark.parametrize("kind", OBSTACLES)
def test_it_passes_on_the_nearer_side(kind):
    """An obstacle that reaches 1.3 m to the left and 0.7 m to the right is passed on the right, at a touch."""
    limits = qt.Limits(speed=7.0, lateral_acceleration=3.0, keep_out=[OBSTACLES[kind]], body=CAR)
    best = qt.tune_route(straight(), limits, tube=3.0)
    assert best.certificate.holds
    assert qt.certify(best.path, limits).holds
    clearance = best.certificate.worst["keep_out[0]"][1]
    assert 0 <= clearance < 0.03
    y = np.asarray(qt.evaluate(best.path, np.linspace(0, 8, 200)).position)[:, 1]
    assert y.max() < 0.1
    assert -1.3 < y.min() < -1.15


def test_the_objective_is_that_of_the_better_side():
    """A second obstacle makes the right side longer, so that the left one is better; a tube without it, too."""
    near, beside = qt.Ball([20.0, 0.3, 0.0], 1.0), qt.Ball([20.0, -1.6, 0.0], 1.0)
    limits = qt.Limits(speed=7.0, keep_out=[near, beside])
    best = qt.tune_route(straight(), limits, tube=4.0)
    assert best.certificate.holds
    y = np.asarray(qt.evaluate(best.path, np.linspace(0, 8, 200)).position)[:, 1]
    assert y.max() == pytest.approx(1.3, abs=0.02)
    assert y.min() > -0.1


def test_a_slalom():
    """Two obstacles on both sides: a point passes on the right of the first and on the left of the second."""
    obstacles = [qt.Ball([20.0, 0.3, 0.0], 1.0), qt.Ball([40.0, -0.3, 0.0], 1.0)]
    best = qt.tune_route(straight(7), qt.Limits(speed=7.0, keep_out=obstacles), tube=3.0)
    assert best.certificate.holds
    # The mirror image of the optimum is its reverse.
    y = np.asarray(qt.evaluate(best.path, np.linspace(0, float(best.path.duration), 301)).position)[:, 1]
    assert y.min() == pytest.approx(-0.7, abs=0.01)
    assert y.max() == pytest.approx(0.7, abs=0.01)


def test_the_fastest_route_around_an_obstacle():
    """A lateral acceleration lets the route slow down little; the objective is the duration."""
    limits = qt.Limits(speed=6.0, lateral_acceleration=2.0, acceleration=3.0, keep_out=[OBSTACLES["ball"]])
    best = qt.tune_route(straight(), limits, tube=2.0, objective="fastest")
    assert best.certificate.holds
    assert 40.0 / 6.0 < best.objective < 8.0


@pytest.mark.parametrize("kind", ["step", "linear"])
def test_limits_along_the_way_together_with_obstacles(kind):
    speed = qt.Along([0.0, 15.0, 40.0], [7.0, 6.0, 5.5], kind=kind)
    limits = qt.Limits(speed=speed, lateral_acceleration=3.0, keep_out=[OBSTACLES["ball"]], body=CAR)
    best = qt.tune_route(straight(), limits, tube=3.0)
    assert set(best.certificate.status.values()) == {"proved"}
    assert 0 <= best.certificate.worst["keep_out[0]"][1] < 0.03


def test_a_contradiction_says_where():
    best = qt.tune_route(straight(), qt.Limits(speed=7.0, keep_out=[OBSTACLES["ball"]]), tube=0.5)
    assert not best.certificate.holds
    assert best.certificate.status == {"speed": "proved", "keep_out[0]": "broken"}
    assert "keep_out[0] from t = 2 to 6 s" in best.advice


CROSSING = qt.Ball([[20.0, -8.4, 0.0], [0.0, 2.0, 0.0]], 1.0)
"""Crosses a route at 2 m/s, 4.2 s after the start."""


@pytest.mark.parametrize("objective", ["nearest", "smoothest", "fastest"])
def test_an_obstacle_that_crosses_the_route(objective):
    """The given route would hit it; the tuned one is proved, and clear of it at every instant by the closed form."""
    limits = qt.Limits(speed=7.0, longitudinal_acceleration=(-3, 2), keep_out=[CROSSING], body=CAR)
    route = straight(9, 5.0)
    assert qt.certify(route, limits).status["keep_out[0]"] == "broken"
    best = qt.tune_route(route, limits, tube=2.0, objective=objective)
    assert best.code == 0
    assert best.certificate.holds
    t = np.linspace(0, float(best.path.duration), 4001)
    r, v = np.asarray(best.path.sampled(t, 1))
    ahead = r + 2.0 * v / np.linalg.norm(v, axis=1)[:, None]
    ball = np.array([20.0, -8.4, 0.0]) + t[:, None] * np.array([0.0, 2.0, 0.0])
    least = min(np.linalg.norm(x - ball, axis=1).min() for x in (r, ahead)) - 1.5
    assert least >= 0
    assert least == pytest.approx(best.certificate.worst["keep_out[0]"][1], abs=1e-3)
    if objective != "smoothest":  # there, the duration does not change
        assert abs(best.delay) > 0.01


def test_it_passes_before_an_obstacle_that_blocks_the_whole_tube():
    """A long bar closes the tube from one side at 3.4 s, so that the nearest route passes before."""
    bar = qt.Cylinder([[15.0, 0.0, -6.8], [0.0, 0.0, 2.0]], [0.0, 1.0, 0.0], 1.0)  # rises through the road
    limits = qt.Limits(speed=8.0, keep_out=[bar])
    route = straight(17, 2.5)
    assert qt.certify(route, limits).status["keep_out[0]"] == "broken"
    best = qt.tune_route(route, limits, tube=(1.0, 0.05))
    assert best.certificate.holds
    t = np.linspace(0, float(best.path.duration), 4001)
    r = np.asarray(best.path.sampled(t, 0))[0]
    distance = np.hypot(r[:, 0] - 15.0, r[:, 2] + 6.8 - 2.0 * t)
    assert 1.0 <= distance.min() < 1.02
    given = np.interp(15.0, np.asarray(route.sampled(t[t < 8], 0))[0][:, 0], t[t < 8])
    assert np.interp(15.0, r[:, 0], t) < given


@pytest.mark.parametrize("kind", ["nearest", "fastest"])
def test_derivatives_of_clearances_are_those_of_automatic_differentiation(kind):
    """With an obstacle at rest and one whose centre is quadratic in the time, and a body in front of the position."""
    drift = qt.Ellipsoid([[12.0, 3.0, 0.0], [0.5, -1.0, 0.1], [0.0, 0.1, 0.0]], [2.0, 1.0, 1.5])
    limits = qt.Limits(speed=7.0, acceleration=9.0, keep_out=[OBSTACLES["ball"], drift], body=CAR)
    own = clears(limits.keep_out, limits.body)
    given, rng = setup.parts(straight(4)), np.random.default_rng(3)
    names, held = ("speed", "acceleration", *(x.name for x in own)), np.zeros((4, 3), bool)
    bounds = np.array([7.0, 9.0, *np.ones(len(own))])
    args = given, names, bounds, np.full((4, 2), 3.0), held, kind, False
    problem = around.with_obstacles(setup.problem_of(*args, origin=np.zeros(3)), own, given.h)
    program = RouteProgram(problem)
    z, direction, linear = compare_with_automatic(program, rng, 0.1)
    step = 1e-6
    both = [program.evaluate(z + sign * step * direction)[1] for sign in (1, -1)]
    change = linear.pushed(direction)
    np.testing.assert_allclose((both[0] - both[1]) / (2 * step), change, rtol=0, atol=1e-6 * np.abs(change).max())


def test_what_is_not_possible_is_named_at_once():
    route = straight()
    with pytest.raises(ValueError, match=r"at the start .* inside keep_out\[0\], by 0.5 m"):
        qt.tune_route(route, qt.Limits(keep_out=[qt.HalfSpace([0.0, 1.0, 0.0], 0.5)]))
    stops = np.array([1.0, 1.0, 0.0, 1.0, 1.0])[:, None]
    x, v, a = np.moveaxis(np.asarray(route.joints()), 1, 0)
    with pytest.raises(ValueError, match="obstacles that move on a route with stops in between"):
        qt.tune_route(qt.Route(route.times, x, v * stops, a), qt.Limits(keep_out=[CROSSING]))
    with pytest.raises(ValueError, match="retime does not support obstacles that move"):
        qt.retime(route, qt.Limits(speed=3.0, keep_out=[CROSSING]))
