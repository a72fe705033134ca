"""Proofs that a body stays clear of obstacles, against dense sampling, closed forms and contacts."""

import numpy as np
import pytest
from benchmarks.random_obstacles import random_helix, random_obstacle, random_route, sampled_clearance

import qtraj as qt

POINT, CAR, FRAME = [(0.0, 0.0)], [(0.0, 0.6), (1.5, 0.6)], [((0.8, 0.3, -0.2), 0.4)]


def cases(rng):
    """A path, its obstacles and a body."""
    kind = rng.integers(4)
    if kind < 2:
        path, moves = random_route(rng, septic=kind == 1), rng.random() < 0.3
    else:
        path, moves = random_helix(rng, kind == 2), rng.random() < 0.3
    near = np.asarray(path.position(float(path.duration) * rng.uniform(0.2, 0.8)))
    body = [POINT, POINT, CAR, FRAME][rng.integers(4)]
    return path, random_obstacle(rng, near, moves), body


@pytest.mark.parametrize("seed", range(3))
def test_no_status_contradicts_dense_samples(seed):
    """20 random obstacles: the value is that of dense samples, and the status follows its sign."""
    rng, decided = np.random.default_rng(seed), 0
    for _ in range(20):
        path, obstacle, body = cases(rng)
        found = qt.certify(path, qt.Limits(keep_out=[obstacle], body=body))
        time, value, limit = found.worst["keep_out[0]"]
        status, sampled = found.status["keep_out[0]"], sampled_clearance(path, obstacle, body)
        step = 2e-3 * float(path.length())  # between two samples the clearance changes by less
        assert limit == 0
        assert sampled - step < value <= sampled + 1e-9
        at_time = qt.clearance(path, time, qt.Limits(keep_out=[obstacle], body=body))["keep_out[0]"]
        assert at_time == pytest.approx(value, abs=1e-8)
        if status == "proved":
            assert min(value, sampled) > -1e-9
        elif status == "broken":
            assert value < 1e-9
        decided += status == ("broken" if value < 0 else "proved")
    assert decided == 20


@pytest.mark.parametrize("body", [POINT, CAR, FRAME], ids=["point", "car", "frame"])
@pytest.mark.parametrize("make", [random_route, random_helix])
def test_contacts_are_decided_rightly(make, body):
    """With a radius at the exact distance times 1 ± 1e-9, the status is that of the sign."""
    rng = np.random.default_rng(7)
    for _ in range(2):
        path = make(rng)
        centre = np.asarray(path.position(float(path.duration) * 0.4)) + rng.normal(0, 2, 3) + [0, 0, 4.0]
        probe = qt.Limits(keep_out=[qt.Ball(centre, 1e-3)], body=body)
        distance = qt.certify(path, probe).worst["keep_out[0]"][1] + 1e-3
        for factor, status in ((1 - 1e-9, "proved"), (1 + 1e-9, "broken")):
            limits = qt.Limits(keep_out=[qt.Ball(centre, distance * factor)], body=body)
            assert qt.certify(path, limits).status["keep_out[0]"] == status


@pytest.mark.parametrize("kind", ["cylinder", "ellipsoid", "half space", "polygon"])
def test_contacts_of_a_body_with_a_radius(kind):
    """The radius of a ball of the body at the exact clearance times 1 ± 1e-9."""
    path = random_route(np.random.default_rng(3))
    near = np.asarray(path.position(float(path.duration) * 0.5)) + np.array([0.3, 4.0, 1.0])
    obstacle = {
        "cylinder": lambda: qt.Cylinder(near, [0.2, 0.1, 1.0], 1.0),
        "ellipsoid": lambda: qt.Ellipsoid(near, [2.0, 1.0, 0.5]),
        "half space": lambda: qt.HalfSpace([0.1, -1.0, 0.2], -near[1]),
        "polygon": lambda: qt.ConvexPolygon(near[:2] + np.array([[-1.0, 0.0], [1.0, 0.2], [0.0, 2.0]])),
    }[kind]()
    distance = qt.certify(path, qt.Limits(keep_out=[obstacle])).worst["keep_out[0]"][1]
    assert distance > 0.1
    for factor, status in ((1 - 1e-9, "proved"), (1 + 1e-9, "broken")):
        limits = qt.Limits(keep_out=[obstacle], body=[(0.0, distance * factor)])
        assert qt.certify(path, limits).status["keep_out[0]"] == status


def test_a_circle_around_a_ball():
    """A circle touches the ball whose radius is its own everywhere: undecided; a little smaller is proved."""
    circle = qt.SpiralHelix([5.0], [0.3, 0.5], [0.0], 8.0)
    for radius, status in ((5.0 - 1e-9, "proved"), (5.0 + 1e-9, "broken"), (5.0, "undecided")):
        found = qt.certify(circle, qt.Limits(keep_out=[qt.Ball([0.0, 0.0, 0.0], radius)]))
        assert found.status["keep_out[0]"] == status
        assert found.worst["keep_out[0]"][1] == pytest.approx(5.0 - radius, abs=1e-12)
    # A disc at the distance a ahead is on the circle with the radius √(25 + a²).
    ahead = qt.Limits(keep_out=[qt.Ball([0.0, 0.0, 0.0], 5.5)], body=[(3.0, 0.25)])
    assert qt.certify(circle, ahead).worst["keep_out[0]"][1] == pytest.approx(np.sqrt(34.0) - 5.75, abs=1e-12)


def test_a_straight_line_past_a_wall():
    """A touching body is clear: a line at 2 m from a wall, and a body with the radius 2 m."""
    line = qt.Route([0.0, 4.0], [[0.0, 2.0, 0.0], [20.0, 2.0, 0.0]], [[5.0, 0.0, 0.0]] * 2, [[0.0] * 3] * 2)
    wall = qt.ConvexPolygon([[4.0, -3.0], [9.0, -3.0], [9.0, 0.0], [4.0, 0.0]])
    for radius, status in ((2.0, "proved"), (2.0 + 1e-9, "broken")):
        found = qt.certify(line, qt.Limits(keep_out=[wall, qt.HalfSpace([0, 1, 0], 0.0)], body=[(1.5, radius)]))
        assert set(found.status.values()) == {status}
        assert found.worst["keep_out[0]"][1] == pytest.approx(2.0 - radius, abs=1e-12)


def test_a_ball_that_moves_is_met_at_a_time():
    """A ball crosses the path behind the body, or hits it, if it comes earlier."""
    line = qt.Route([0.0, 4.0], [[0.0] * 3, [20.0, 0.0, 0.0]], [[5.0, 0.0, 0.0]] * 2, [[0.0] * 3] * 2)
    for start, status in ((-8.0, "proved"), (-4.0, "broken")):
        ball = qt.Ball([[10.0, start, 0.0], [0.0, 2.0, 0.0]], 1.0)
        assert qt.certify(line, qt.Limits(keep_out=[ball])).status["keep_out[0]"] == status
    timed = qt.retime(line, qt.Limits(speed=5.0, acceleration=2.0)).path
    assert qt.certify(timed, qt.Limits(keep_out=[ball])).status["keep_out[0]"] == "broken"
    with pytest.raises(ValueError, match="no times"):
        qt.certify(qt.Shape(line), qt.Limits(keep_out=[ball]))


def test_timings_and_shapes_have_the_statuses_of_their_path():
    """Proofs do not depend on the timing."""
    route = random_route(np.random.default_rng(5))
    near = np.asarray(route.position(3.0))
    limits = qt.Limits(keep_out=[qt.Ball(near + np.array([0.0, 3.0, 0.0]), 1.0), qt.Ball(near, 1.0)], body=CAR)
    whole = qt.certify(route, limits)
    timed = qt.retime(route, qt.Limits(speed=3.0, acceleration=2.0)).path
    found = qt.certify(timed, limits)
    assert found.status == whole.status == {"keep_out[0]": "proved", "keep_out[1]": "broken"}
    time, value, _ = found.worst["keep_out[1]"]
    assert qt.clearance(timed, time, limits)["keep_out[1]"] == pytest.approx(value, abs=1e-9)
    assert qt.certify(qt.Shape(route), limits).status == whole.status
    (start, end), *_ = whole.intervals("keep_out[1]")
    assert qt.clearance(route, start, limits)["keep_out[1]"] < 1e-9 < end - start


def test_a_car_that_reverses_keeps_its_front():
    """The offset is along the forward axis: in reverse it is behind the direction of the velocity."""
    x, v = [[0.0, 0, 0], [10.0, 0, 0], [0.0, 0, 0]], np.zeros((3, 3))
    route = qt.Route([0.0, 4.0, 8.0], x, v, v)
    ahead = qt.Ball([13.0, 0.0, 0.0], 0.5)
    behind = qt.Ball([-3.0, 0.0, 0.0], 0.5)
    limits = qt.Limits(keep_out=[ahead, behind], body=[(2.0, 0.4)])
    found = qt.certify(route, limits)
    assert found.status == {"keep_out[0]": "proved", "keep_out[1]": "proved"}
    assert found.worst["keep_out[0]"][1] == pytest.approx(0.1, abs=1e-9)
    assert found.worst["keep_out[1]"][1] == pytest.approx(4.1, abs=1e-9)
    assert qt.clearance(route, [0.0, 6.0], limits)["keep_out[0]"][0] == pytest.approx(10.1, abs=1e-9)


def test_a_path_that_is_not_polynomial_is_sampled():
    import jax.numpy as jnp

    wave = qt.Curve(lambda t: jnp.stack([t, jnp.sin(t), 0.0 * t]), 10.0)
    for y, status in ((3.0, "sampled"), (2.2, "broken")):
        limits = qt.Limits(keep_out=[qt.Ball([np.pi / 2, y, 0.0], 1.0)], body=[(0.0, 0.5)])
        found = qt.certify(wave, limits)
        assert found.status["keep_out[0]"] == status
        assert found.worst["keep_out[0]"][1] == pytest.approx(y - 2.5, abs=1e-9)
