"""Fastest timings of shapes: open ones, and laps against closed forms, the middle of three, and finite differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.race_track import race_track

import qtraj as qt
from qtraj.design.timing import seam

RACE = qt.Limits(speed=60.0, lateral_acceleration=15.0, longitudinal_acceleration=8.0)
WITH_JERK = qt.Limits(speed=40.0, acceleration=9.0, jerk=12.0)


def circle(radius=50.0, count=100):
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return qt.Shape.through(radius * np.stack([np.cos(angle), np.sin(angle)], axis=1))


def oval(count=160, start=0.0):
    angle = start + np.linspace(0, 2 * np.pi, count, endpoint=False)
    return qt.Shape.through(np.stack([150 * np.cos(angle), 50 * np.sin(angle)], axis=1))


@pytest.fixture(scope="module")
def race():
    points, widths = race_track()
    shape = qt.Shape.through(points, widths=widths)
    return shape, qt.retime(shape, RACE)


def ends(timing):
    """u̇² and its first two derivatives at both ends."""
    c, h = np.asarray(timing.coefficients), np.diff(np.asarray(timing.knots))
    last = [c[-1].sum(), c[-1] @ [0, 1, 2, 3] / h[-1], c[-1] @ [0, 0, 2, 6] / h[-1] ** 2]
    return np.array([c[0, 0], c[0, 1] / h[0], 2 * c[0, 2] / h[0] ** 2]), np.array(last)


@pytest.mark.parametrize("limit", ["lateral_acceleration", "acceleration", "yaw_rate", "speed"])
def test_circle_is_driven_at_constant_speed(limit):
    radius, value = 50.0, {"yaw_rate": 0.4, "speed": 20.0}.get(limit, 9.0)
    speed = {"yaw_rate": value * radius, "speed": value}.get(limit, np.sqrt(value * radius))
    shape = circle(radius)
    timed = qt.retime(shape, qt.Limits(**{limit: value}, longitudinal_acceleration=2.0))
    assert timed.converged, timed.result
    assert float(timed.duration) == pytest.approx(float(shape.length) / speed, rel=2e-5)
    speeds = np.linalg.norm(qt.evaluate(timed.path, np.linspace(0, float(timed.duration), 300)).velocity, axis=1)
    assert np.ptp(speeds) < 1e-4 * speed


def test_race_track_is_proved_and_closed_at_the_seam(race):
    shape, timed = race
    assert timed.converged, timed.result
    assert timed.certificate.status == dict.fromkeys(RACE.given(), "proved")
    np.testing.assert_allclose(*ends(timed.timing), rtol=1e-9)
    assert timed.speeds[0] == pytest.approx(timed.speeds[1], rel=1e-9)
    first, last = (np.asarray(timed.path.derivatives(t, 2)) for t in (0.0, float(timed.duration)))
    np.testing.assert_allclose(first, last, atol=1e-6 * np.abs(first[0]).max())
    again = qt.certify(timed.path, RACE)
    assert again.holds
    assert float(np.asarray(timed.timing.knots)[-1]) == float(shape.route.duration)


@pytest.mark.parametrize("limits", [RACE, WITH_JERK], ids=["accelerations", "jerk"])
def test_lap_is_the_middle_one_of_three(limits):
    """In the middle of three laps, the free ends have no influence, so it takes as long as the flying lap."""
    shape = oval()
    lap = qt.retime(shape, limits, knots=512)
    assert lap.converged, lap.result
    route = shape.route + shape.route + shape.route
    three = qt.retime(route, limits, knots=2048, stop_speed=0.0)
    u = float(shape.route.duration)
    middle = float(three.timing.time(2 * u)) - float(three.timing.time(u))
    assert float(lap.duration) == pytest.approx(middle, rel=2e-4)


@pytest.mark.parametrize("limits", [RACE, WITH_JERK], ids=["accelerations", "jerk"])
def test_lap_does_not_depend_on_its_start(limits):
    durations = [float(qt.retime(oval(start=start), limits).duration) for start in (0.0, 0.7, 2.0)]
    assert max(durations) == pytest.approx(min(durations), rel=1e-3)


def test_lap_is_slower_than_a_single_one_with_free_ends():
    """The oval ends in a braking zone; without a next lap, it need not brake there."""
    shape = oval(start=np.pi / 2 + 0.3)
    free = qt.retime(shape, RACE, periodic=False)
    lap = qt.retime(shape, RACE)
    assert float(free.duration) < float(lap.duration) * (1 - 1e-3)
    assert np.ptp(np.asarray(lap.speeds)) < 1e-6


def test_start_on_a_straight_is_bounded_by_the_curves():
    """With free ends, no limit bounds the speed on a straight at the start; in a lap, the curves do."""
    straight, half = np.linspace(-100, 100, 40, endpoint=False), np.linspace(0, np.pi, 25, endpoint=False)
    upper = np.stack([straight, 0 * straight - 30], axis=1)
    bend = np.stack([100 + 30 * np.sin(half), -30 * np.cos(half)], axis=1)
    points = np.vstack([upper, bend, -upper, -bend])
    shape = qt.Shape.through(np.roll(points, -20, axis=0))
    limits = qt.Limits(lateral_acceleration=9.0, longitudinal_acceleration=4.0)
    assert qt.retime(shape, limits).converged


@pytest.mark.parametrize("limits", [qt.Limits(longitudinal_acceleration=3.0, friction=1.0, vehicle=qt.Vehicle(1000.0))])
def test_friction_on_a_circle(limits):
    shape = circle(40.0)
    timed = qt.retime(shape, limits)
    assert timed.converged, timed.result
    friction, g = np.asarray(limits.vehicle.friction)[1], 9.80665
    assert float(timed.duration) == pytest.approx(float(shape.length) / np.sqrt(float(friction) * g * 40.0), rel=1e-3)


@pytest.mark.parametrize(("limits", "step", "rtol"), [(RACE, 0.05, 1e-3), (WITH_JERK, 0.5, 2e-2)], ids=["a", "jerk"])
def test_derivatives_with_respect_to_a_limit(limits, step, rtol):
    """With a limit on the jerk, the rounds of tightening change the duration by about 1e-5, so the step is larger.

    The cells are given, because the cells that retime chooses change with the limit.
    """
    shape, value = oval(), 25.0

    def durations(speed):
        timed = qt.retime(shape, qt.Limits(**(dict(limits.given()) | {"speed": speed})), knots=512)
        return jnp.stack([jnp.asarray(timed.duration), jnp.asarray(timed.path.duration)])

    known = (float(durations(value + step)[0]) - float(durations(value - step)[0])) / (2 * step)
    _, forward = jax.linearize(durations, value)
    reverse = jax.linear_transpose(forward, value)
    for k, allowed in ((0, rtol), (1, max(rtol, 1e-2))):
        assert float(forward(1.0)[k]) == pytest.approx(known, rel=allowed)
        assert float(reverse(jnp.eye(2)[k])[0]) == pytest.approx(known, rel=allowed)


def test_batch_of_limits():
    shape = circle()
    values = np.array([4.0, 9.0, 16.0])
    found = jax.vmap(
        lambda a: qt.retime(shape, qt.Limits(lateral_acceleration=a, longitudinal_acceleration=2.0)).duration
    )(values)
    np.testing.assert_allclose(found, float(shape.length) / np.sqrt(50 * values), rtol=2e-5)


def test_open_shape_is_timed_between_given_speeds():
    x = np.linspace(0, 200, 40)
    shape = qt.Shape.through(np.stack([x, 0 * x], axis=1))
    timed = qt.retime(shape, qt.Limits(acceleration=2.0, speed=100.0), start_speed=0.0, end_speed=0.0)
    assert timed.converged, timed.result
    assert float(timed.duration) == pytest.approx(2 * np.sqrt(200 / 2), rel=1e-3)
    standing = qt.retime(circle(), RACE, start_speed=0.0)
    assert standing.converged
    assert float(standing.speeds[0]) == 0


@pytest.mark.parametrize("seed", [14, 16, 35, 36])
def test_sharp_turns_are_not_taken_for_reversals(seed):
    """Between few points that turn back, the spline turns by more than 90° within a few percent of a segment."""
    rng = np.random.default_rng(seed)
    sharp = np.array([[0.0, 0], [10, 0.3], [0.4, 1.0], [12, 2.0]]) + rng.normal(0, 0.05, (4, 2))
    shape = qt.Shape.through(sharp)
    timed = qt.retime(shape, qt.Limits(speed=20.0, acceleration=5.0), start_speed=0.0, end_speed=0.0)
    assert timed.converged, timed.result
    assert timed.certificate.holds


def test_closed_path_that_is_no_shape():
    route = circle().route
    limits = qt.Limits(lateral_acceleration=9.0, longitudinal_acceleration=2.0)
    timed = qt.retime(route, limits, periodic=True)
    assert timed.converged
    assert float(timed.duration) == pytest.approx(float(route.length()) / np.sqrt(450), rel=2e-5)


def test_paths_that_are_no_laps_are_refused():
    with pytest.raises(ValueError, match="position of the path"):
        qt.retime(circle().route.window(0.0, 100.0), RACE, periodic=True)
    with pytest.raises(ValueError, match="omit start_speed and end_speed"):
        qt.retime(circle(), RACE, start_speed=3.0, periodic=True)
    there = qt.Route([0.0, 10.0], [[0.0, 0, 0], [50, 0, 0]], *np.zeros((2, 2, 3)))
    with pytest.raises(ValueError, match="no stops"):
        qt.retime(there + there.reversed(), RACE, periodic=True)
    with pytest.raises(ValueError, match="retime supports limits only on"):
        qt.retime(circle(), qt.Limits(lateral_jerk=1.0, speed=3.0))


@pytest.mark.parametrize("count", [16, 17])
def test_folded_matrix_is_the_cyclic_matrix(count):
    """The band of the folded order, unfolded, is the dense matrix with repeated coefficients added."""
    rng = np.random.default_rng(count)
    full = np.zeros((count + 3, count + 3))
    diagonals = []
    for d in range(4):
        entries = rng.normal(size=(1, count + 3))
        entries[:, :d] = 0
        diagonals.append(entries)
        at = np.arange(d, count + 3)
        full[at, at - d] = full[at - d, at] = entries[0, d:]
    expand = np.eye(count)[np.arange(count + 3) % count]
    dense = expand.T @ full @ expand
    band = seam.folded(tuple(diagonals))[0]
    order = seam.order(count)
    found = np.zeros((count, count))
    for i in range(count):
        for k in range(min(i, 6) + 1):
            found[order[i], order[i - k]] = found[order[i - k], order[i]] = band[i, -1 - k]
    np.testing.assert_allclose(found, dense, atol=1e-12)
    x = rng.normal(size=count)
    np.testing.assert_allclose(seam.repeated(np.append(x, np.zeros(3)), 1.0), expand @ x)
    y = rng.normal(size=count + 3)
    np.testing.assert_allclose(seam.added(y, 1.0), np.append(expand.T @ y, np.zeros(3)))
