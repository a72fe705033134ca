"""`tune_route` keeps a body clear of obstacles, on the better side."""

import numpy as np
import pytest

import qtraj as qt

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


def test_what_is_not_possible_is_named_at_once():
    route = straight()
    with pytest.raises(ValueError, match=r"at the start .* inside keep_out\[0\], by 0.5 m"):
        qt.tune_route(route, qt.Limits(keep_out=[qt.HalfSpace([0.0, 1.0, 0.0], 0.5)]))
    with pytest.raises(ValueError, match="move"):
        qt.tune_route(route, qt.Limits(keep_out=[qt.Ball([[20.0, 5.0, 0.0], [0.0, 1.0, 0.0]], 1.0)]))
    with pytest.raises(ValueError, match="retime does not support obstacles"):
        qt.retime(route, qt.Limits(speed=3.0, keep_out=[OBSTACLES["ball"]]))
